"""How far echoes are explained: walls that reflect everything are heard for ever, paths are followed for a few orders.

In a plate without losses, power does not decay once the wave has gone to and fro a few times: the later half of a ping
is made of paths of more reflections than the waveform has. They begin where the shortest of them is; beyond that the
walls say little, and what is heard there is nothing that they leave unexplained.
"""


import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.path_room import room_for_paths
from polymap_ros.geometry.paths import trace_paths
from polymap_ros.geometry.sides import Sides
from polymap_ros.geometry.storey import Storey
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
from polymap_ros.solvers.evidence.walls import Walls

_SOONER = 0.1
"""Share of the pings whose shortest path of one reflection more may be nearer than what is kept."""

_LAST, _STILL = 0.25, 0.8
"""Nothing decays where this last part of the range holds that share of the power that it would hold then."""

_SIDES = 1.5
"""Roots of the area that is known to be free, beyond which more reflections than are explained come from: 1.4 to 1.8 in
convex plates, 1.0 to 1.4 in those that are not (eight, even seeds)."""


def up_to_horizon(data: EchoData, walls: Walls) -> EchoData:
    """Return echoes up to where those of more reflections than the waveform has begin."""
    bound, sides = walls.sides(data.soft_m, data.shortest_m)
    if not bound:
        return data
    nearest = _nearest(sides, data.ends, FULL_ORDER + 1, data.range_max_m, data.soft_m,
                       Storey().images(FULL_ORDER + 1, data.level))
    return data.up_to(float(np.quantile(nearest, _SOONER)))


def up_to_sides(data: EchoData, area_m2: float) -> EchoData:
    """Return the same, before any walls are known, by the area that is known to be free; all where power decays."""
    by_cell = np.sum(data.power[:, data.first_cell:] - 1.0, axis=0)
    last = by_cell[-round(_LAST * len(by_cell)):]
    still = float(np.sum(last)) > _STILL * _LAST * float(np.sum(by_cell))
    return data.up_to(_SIDES * float(np.sqrt(area_m2))) if still else data


@kernel
def _nearest(
    sides: Sides, ends: NDArray[np.float64], order: int, range_max: float, soft: float, storey: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return half the length of the shortest path of so many reflections for every ping, shape (N,), or `range_max`."""
    paths, found = room_for_paths(order), np.full(len(ends), range_max)
    for i in range(len(ends)):
        for m in range(trace_paths(sides, ends[i], order, range_max, soft, False, storey, paths)):
            if paths.hits[m] == order:
                found[i] = min(found[i], paths.half[m])
    return found
