"""From the lines a solver found to its answer: what may be claimed, and what must be said with it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import Caution, in_metres
from polymap_ros.geometry.lines import feet_on_edges
from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.straightness import path_axis, path_half_width

MIN_PINGS = 3
"""Fewer pings than a polygon has edges at least cannot have heard all of them."""

_STRAIGHT_M = 0.0005
"""Half the width of a path [m] that rounds to 0 mm."""


def conclude(
    method: str,
    snapshot: Snapshot,
    lines: NDArray[np.float64],
    likelihood: NDArray[np.float64],
    cost: float | None = None,
) -> Estimate:
    """The answer of a solver that cannot tell a wall from its mirror image about a straight path.

    Parameters
    ----------
    method : str
        Name of the solver.
    snapshot : Snapshot
        What it looked at.
    lines : ndarray, shape (k, 2)
        r [m] and theta [rad] of the lines found.
    likelihood : ndarray, shape (k,)
        L / max L of each.
    cost : float, optional
        Value of eq. (5).
    """
    pings, width = int(snapshot.pings.sum()), path_half_width(snapshot)
    answer = Estimate('open', method, snapshot.stamp_ns, cost=cost)
    if pings < MIN_PINGS:
        return _with(answer, too_few_pings(pings))
    candidate = _polygon(snapshot, lines, likelihood)
    if width is not None:
        if candidate:
            both = candidate, candidate.mirrored(*path_axis(snapshot.positions))
            answer = replace(answer, status='ambiguous', alternatives=both)
        return replace(answer, cautions=(straight_path(snapshot, width),))
    if snapshot.region.area == 0.0:
        return _with(answer, Caution('no_free_area', f'none of {pings} pings has an echo that stands out of its noise'))
    if candidate is None:
        return _with(answer, Caution('not_closed', 'the walls that were found enclose no area'))
    answer = replace(answer, status='closed', polygon=candidate, iou_free_area=snapshot.region.iou(candidate.vertices))
    if outside := _outside(snapshot, candidate):
        return _with(answer, Caution('path_outside', f'{outside} of {pings} pings lie outside the polygon'))
    return answer


def too_few_pings(count: int) -> Caution:
    """Say that fewer pings could be used than a polygon has edges at least."""
    return Caution('too_few_pings', f'{count} {"ping" if count == 1 else "pings"} could be used, and a polygon takes '
                                    f'at least {MIN_PINGS}')


def straight_path(snapshot: Snapshot, half_width_m: float) -> Caution:
    """Say that the path keeps so close to a straight line [m], or to one place."""
    extent_m = float(np.max(np.ptp(snapshot.positions, axis=0)))
    if extent_m <= snapshot.r_m[1] - snapshot.r_m[0]:
        return Caution(
            'straight_path', f'all pings are from one place, within {in_metres(extent_m)}: walls cannot be told from '
            'their mirror images', 'drive while pinging, and drive a turn; if the robot did drive, the odometry does '
            'not tell of it: look at its topic and its stamps')
    near = 'is' if half_width_m < _STRAIGHT_M else f'keeps within {in_metres(half_width_m)} of'
    return Caution('straight_path', f'the path {near} one straight line, about which walls cannot be told from their '
                                    'mirror images')


def _with(answer: Estimate, caution: Caution) -> Estimate:
    return replace(answer, cautions=(*answer.cautions, caution))


def _polygon(
    snapshot: Snapshot, lines: NDArray[np.float64], likelihood: NDArray[np.float64]
) -> Candidate | None:
    vertices, which = half_plane_polygon(lines)
    if len(which) == 0:
        return None
    pings = feet_on_edges(vertices, snapshot.positions, snapshot.pings)
    edges = tuple(
        Edge(float(lines[k, 0]), float(lines[k, 1]), float(likelihood[k]), pings=int(count))
        for k, count in zip(which, pings, strict=True))
    return Candidate(vertices, edges)


def _outside(snapshot: Snapshot, candidate: Candidate) -> int:
    """How many pings lie beyond an edge by more than a step of the range axis."""
    r, theta = np.array([(edge.r, edge.theta) for edge in candidate.edges]).T
    beyond = snapshot.positions @ np.array((np.cos(theta), np.sin(theta))) - r
    step = snapshot.r_m[1] - snapshot.r_m[0]
    return int(snapshot.pings[np.any(beyond > step, axis=1)].sum())
