"""From the lines a solver found to its answer: what may be claimed, and what must be said with it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.estimate import Candidate, Caution, Edge, Estimate
from polymap_ros.mapping.lines import feet_on_edges, half_plane_polygon, polygon_lines
from polymap_ros.mapping.snapshot import Snapshot

MIN_PINGS = 3
"""Fewer pings than a polygon has edges at least cannot have heard all of them."""

STRAIGHTNESS = 0.02
"""A path is straight if it is no wider than this share of its length, or than one step of the range axis: no wall's
distance then differs by more from that of its mirror image than twice the width."""

_FEW = 0.05
"""Share of the pings, those furthest aside, that make no path less straight: of a mirror image the others explain more
than the 0.95 of the echoes that a right polygon has to."""


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
        return _with(answer, 'too_few_pings',
                     f'pings that could be used: {pings}; a polygon takes at least {MIN_PINGS}')
    candidate = _polygon(snapshot, lines, likelihood)
    if width is not None:
        if candidate:
            both = candidate, mirrored(candidate, snapshot.positions)
            answer = replace(answer, status='ambiguous', alternatives=both)
        return _with(answer, 'straight_path', f'the sensor stayed within {width:.3g} m of one straight line, about '
                                              'which walls cannot be told from their mirror images; drive a turn')
    if snapshot.region.area == 0.0:
        return _with(answer, 'no_free_area', 'no ping has an echo that stands out')
    if candidate is None:
        return _with(answer, 'not_closed', 'the walls found bound no area')
    answer = replace(answer, status='closed', polygon=candidate, iou_free_area=snapshot.region.iou(candidate.vertices))
    if outside := _outside(snapshot, candidate):
        return _with(answer, 'path_outside', f'{outside} of {pings} pings lie outside the polygon')
    return answer


def _with(answer: Estimate, code: str, text: str) -> Estimate:
    return replace(answer, cautions=(*answer.cautions, Caution(code, text)))


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


def path_half_width(snapshot: Snapshot) -> float | None:
    """Half the width [m] of a path too straight to tell sides, else None."""
    if len(snapshot.positions) == 0:
        return None
    positions = _without_few(snapshot.positions)
    middle, along = _axis(positions)
    offsets = positions - middle
    length, width = np.ptp(offsets @ along), np.ptp(offsets @ (-along[1], along[0]))
    step = snapshot.r_m[1] - snapshot.r_m[0]
    return float(width / 2.0) if width <= max(step, STRAIGHTNESS * length) else None


def _without_few(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The positions without the few that are furthest aside of the line along which the others lie."""
    kept = positions
    for _ in range(2):  # those that are aside turn the line, too
        middle, along = _axis(kept)
        aside = np.abs((positions - middle) @ (-along[1], along[0]))
        nearest = np.argsort(aside, kind='stable')[:len(positions) - int(_FEW * len(positions))]
        kept = positions[np.sort(nearest)]
    return kept


def _axis(positions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middle of the positions and the unit vector along which they spread most."""
    middle = positions.mean(axis=0)
    offsets = positions - middle
    _, directions = np.linalg.eigh(offsets.T @ offsets)
    return middle, directions[:, -1]


def mirrored(candidate: Candidate, positions: NDArray[np.float64]) -> Candidate:
    """The mirror image about the path, counter-clockwise again."""
    middle, along = _axis(_without_few(positions))
    offsets = candidate.vertices - middle
    vertices = (middle + 2.0 * np.outer(offsets @ along, along) - offsets)[::-1]
    # Reversed, the edge from corner j runs between the images of corners n - 1 - j and n - 2 - j.
    edges = candidate.edges[-2::-1] + candidate.edges[-1:]
    lines = polygon_lines(vertices)
    return Candidate(vertices, tuple(
        Edge(float(r), float(theta), edge.likelihood, pings=edge.pings)
        for (r, theta), edge in zip(lines, edges, strict=True)))


def _outside(snapshot: Snapshot, candidate: Candidate) -> int:
    """How many pings lie beyond an edge by more than a step of the range axis."""
    r, theta = np.array([(edge.r, edge.theta) for edge in candidate.edges]).T
    beyond = snapshot.positions @ np.array((np.cos(theta), np.sin(theta))) - r
    step = snapshot.r_m[1] - snapshot.r_m[0]
    return int(snapshot.pings[np.any(beyond > step, axis=1)].sum())
