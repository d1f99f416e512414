"""Compile before the first message what is compiled on first use."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import RecordedPulse, make_pulse
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.evidence.rehearsal import rehearse


def warm_up(parameters: Parameters, recorded_pulse: RecordedPulse | ArrayLike | None = None) -> None:
    """Take four pings of noise around a corner and some steps of a solve through a mapper of its own.

    Afterwards every kernel that the parameters ask for is compiled, or loaded from numba's cache.
    """
    if parameters.localises:  # the same kernels, without a map
        parameters = parameters.replaced({'slam.mode': 'auto'})
    speed_m_s = float(group_speed(make_medium(parameters.medium), parameters.pulse.frequency_hz))
    reach_m, period_s = parameters.grid.range_max_m, 0.125 / parameters.pulse.frequency_hz
    if parameters.pulse.kind == 'file':  # of which all pings have the sample period
        own_s = recorded_pulse.period_s if isinstance(recorded_pulse, RecordedPulse) else 0.0
        period_s = own_s or parameters.echo.sample_period_s or period_s
        if not isinstance(recorded_pulse, RecordedPulse):
            recorded_pulse = RecordedPulse(np.asarray(recorded_pulse))
        # Where its period is not known yet, it may be too long for this one, and right for that of the pings.
        if not (own_s or parameters.echo.sample_period_s):
            fits = recorded_pulse.recorded[:int(reach_m / speed_m_s / period_s)]
            recorded_pulse = dataclasses.replace(recorded_pulse, recorded=fits)
    mapper = PolygonMapper(parameters, recorded_pulse)
    pulse = make_pulse(parameters.pulse, recorded_pulse, period_s)
    least = int(pulse.duration_s / period_s)
    samples = np.random.default_rng(0).normal(size=least + int(4.0 * reach_m / speed_m_s / period_s) + 64)
    for stamp_ns, (x, y) in enumerate(((0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1))):
        mapper.add_pose(stamp_ns, Pose(x * reach_m, y * reach_m))
        mapper.add_ping(Ping(stamp_ns, samples.astype(np.float32), period_s))
    mapper.finish()  # where pings wait for more of them
    if parameters.solver.method == 'evidence':
        rehearse(mapper.evidence, parameters)
    else:
        mapper.configure(mapper.parameters.replaced({'solver.iterations': 1}))
        mapper.solve()
