"""Rings of lines judged by first echoes alone: quick, to sort out which outlines the likelihoods are asked about.

The evidence of a ring is that of the feet that pings have on its edges in plain sight, each echo counted once, less
what every edge costs, every metre of edge that no ping heard, and every ping whose first echo no edge explains. No echo
comes from a corner that points inwards, so that a wall may well be nearer to a ping than its first echo.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import corners_of, inside
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.proposals import foot_evidence

_NO_OUTLINE = -1e12
"""Evidence of what is no outline, or has a ping outside."""

PRICE_OF_EDGE = 30.0
"""Nats that an edge costs, more than it has to bring to a likelihood: first echoes are explained by images of walls,
too. With 17, of 27 outlines that are not convex (nine kinds, even seeds) 20 had no better ring than the true one; with
this, 23."""

UNEXPLAINED = 10.0
"""Nats that a ping costs whose first echo no edge explains. Without, in 19 of the 27 a better ring than the true one
was met, of images of the walls."""

_UNHEARD_METRE = 40.0
"""Nats that a metre of edge costs before the first and after the last foot that was heard on it. Without, rings close
far away, where nothing is asked of them: with the true lines among the candidates, 18 of the 27 had no better ring than
the true one, and 23 with this."""

HEARD = 1.0
"""Evidence of a foot [nats] from which it was heard."""

_LIMITS = -6.0, 12.0
"""Least and most evidence of one foot [nats]: several walls have to speak for a ring, not one that is loud."""

FIRST_WIDTHS = 1.5
"""Pulse widths within which an edge explains a first echo."""


class RingFeet(NamedTuple):
    """What rings are judged by.

    Attributes
    ----------
    positions : ndarray, shape (N, 2)
        Of the pings [m].
    evidence : ndarray, shape (N, n_cells)
        Of one foot at every range [nats].
    cell : float
        Step of the cells [m].
    first : ndarray, shape (N,)
        Range of each ping's first echo [m].
    near : float
        How far from it an edge explains it [m].
    shortest : float
        Length of the shortest edge [m].
    """

    positions: NDArray[np.float64]
    evidence: NDArray[np.float64]
    cell: float
    first: NDArray[np.float64]
    near: float
    shortest: float


def ring_feet(data: EchoData, expected: NDArray[np.float64], strength: float) -> RingFeet:
    """Return the feet of all pings, with `expected` power (broadcast) without them."""
    evidence = np.clip(foot_evidence(data, expected, strength), *_LIMITS)
    return RingFeet(data.positions, evidence, data.cell_m, data.first_m, FIRST_WIDTHS * data.pulse.width_m,
                    data.shortest_m)


@kernel
def ring_evidence(lines: NDArray[np.float64], feet: RingFeet) -> float:
    """Return the evidence of a ring of lines (n, 2) less its costs [nats]."""
    valid, corners = corners_of(lines, feet.shortest)
    if not valid:
        return _NO_OUTLINE
    n = len(lines)
    # Of each edge: cos and sin of its normal, where along its line it starts and ends, and the feet heard on it do.
    edges = np.empty((n, 6))
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        c, s = np.cos(lines[k, 1]), np.sin(lines[k, 1])
        edges[k, 0], edges[k, 1] = c, s
        edges[k, 2], edges[k, 3] = corners[k, 1] * c - corners[k, 0] * s, corners[j, 1] * c - corners[j, 0] * s
        edges[k, 4], edges[k, 5] = np.inf, -np.inf
    heard, total = np.empty((n, 2)), -PRICE_OF_EDGE * n
    for i in range(len(feet.positions)):
        if not inside(corners, feet.positions[i, 0], feet.positions[i, 1]):
            return _NO_OUTLINE
        total += _of_ping(lines, corners, edges, feet, i, heard)
    for k in range(n):
        total -= _UNHEARD_METRE * (edges[k, 3] - edges[k, 2] - max(edges[k, 5] - edges[k, 4], 0.0))
    return total


@kernel
def _of_ping(
    lines: NDArray[np.float64], corners: NDArray[np.float64], edges: NDArray[np.float64], feet: RingFeet, ping: int,
    heard: NDArray[np.float64],
) -> float:
    """Return what a ping's feet are worth, and note where they are on the edges."""
    x, y = feet.positions[ping, 0], feet.positions[ping, 1]
    total, count, explained = 0.0, 0, False
    for k in range(len(lines)):
        c, s = edges[k, 0], edges[k, 1]
        away, along = lines[k, 0] - x * c - y * s, y * c - x * s
        if away <= 0.0 or along < edges[k, 2] or along > edges[k, 3]:
            continue
        at = away / feet.cell
        q = int(at)
        if q >= feet.evidence.shape[1] - 1 or _hidden(corners, k, x, y, x + away * c, y + away * s):
            continue
        explained = explained or abs(away - feet.first[ping]) <= feet.near
        value = feet.evidence[ping, q] + (at - q) * (feet.evidence[ping, q + 1] - feet.evidence[ping, q])
        if value > HEARD:
            edges[k, 4], edges[k, 5] = min(edges[k, 4], along), max(edges[k, 5], along)
        same = -1
        for other in range(count):
            if abs(heard[other, 0] - away) < feet.near:
                same = other
                break
        if same < 0:
            heard[count, 0], heard[count, 1] = away, value
            count += 1
            total += value
        elif value > heard[same, 1]:  # an echo counts once
            total += value - heard[same, 1]
            heard[same, 1] = value
    return total if explained else total - UNEXPLAINED


@kernel
def _hidden(corners: NDArray[np.float64], own: int, x: float, y: float, foot_x: float, foot_y: float) -> bool:
    """Return whether an edge, other than its own, is in the way from a ping to its foot."""
    n = len(corners)
    dx, dy = foot_x - x, foot_y - y
    for k in range(n):
        if k == own:
            continue
        j = k + 1 if k + 1 < n else 0
        start = dx * (corners[k, 1] - y) - dy * (corners[k, 0] - x)
        end = dx * (corners[j, 1] - y) - dy * (corners[j, 0] - x)
        if start * end >= 0.0:
            continue
        ex, ey = corners[j, 0] - corners[k, 0], corners[j, 1] - corners[k, 1]
        ping = ex * (y - corners[k, 1]) - ey * (x - corners[k, 0])
        foot = ex * (foot_y - corners[k, 1]) - ey * (foot_x - corners[k, 0])
        if ping * foot < 0.0:
            return True
    return False
