"""Compile before the first message what is compiled on first use."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.mapping.evidence.solver import rehearse
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.pose import Pose
from polymap_ros.parameters import Parameters


def warm_up(parameters: Parameters, recorded_pulse: NDArray[np.float64] | None = None) -> None:
    """Take four pings of noise around a corner and the first step of a solve through a mapper of its own.

    Afterwards every kernel that the parameters ask for is compiled, or loaded from numba's cache.
    """
    mapper = PolygonMapper(parameters, recorded_pulse)
    speed_m_s = float(group_speed(make_medium(parameters.medium), parameters.pulse.frequency_hz))
    reach_m, period_s = parameters.grid.range_max_m, 0.125 / parameters.pulse.frequency_hz
    least = 0 if recorded_pulse is None else len(recorded_pulse)
    samples = np.random.default_rng(0).normal(size=least + int(4.0 * reach_m / speed_m_s / period_s) + 64)
    for stamp_ns, (x, y) in enumerate(((0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1))):
        mapper.add_pose(stamp_ns, Pose(x * reach_m, y * reach_m))
        mapper.add_ping(Ping(stamp_ns, samples.astype(np.float32), period_s))
    mapper.finish()  # where pings wait for more of them
    mapper.begin_solve()
    mapper.advance(1)
    mapper.preview()
    if parameters.solver.method == 'evidence':
        rehearse(mapper.evidence, parameters)
