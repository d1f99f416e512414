"""Outlines: what lines of eq. (2) bound.

A line stands for the half-plane x cos(theta) + y sin(theta) <= r: theta is the direction of the outward normal. An
outline is a ring of such lines, counter-clockwise: edge k lies on line k and corner k is where line k - 1 meets line k.
Where the lines are sorted by theta, it is the convex polygon that their half-planes have in common.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.jit import kernel

PARALLEL = 1e-9
"""Sine of the angle [rad] between two lines below which they are taken as parallel."""

_ROUNDING = 1e-12
"""Length of an edge, relative to its distance from the foot of the origin, below which it is rounding."""

_SHORTEST = 1e-4
"""Length of an edge, relative to the outline's size, below which it bounds nothing: no ping has a foot on it."""

_TURN = 1e-6
"""Sine of the angle between neighbouring lines below which their corner is too far away or too vague."""


def half_plane_polygon(lines: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the intersection of half-planes.

    Parameters
    ----------
    lines : array_like, shape (k, 2)
        r [m] and theta [rad] of each line.

    Returns
    -------
    vertices : ndarray, shape (n, 2)
        Counter-clockwise [m]; no rows where the intersection is empty or unbounded.
    which : ndarray, shape (n,)
        Index of the line that makes edge i, from vertex i to vertex i + 1. Lines that make no edge are missing.
    """
    table = np.asarray(lines, dtype=float).reshape(-1, 2)
    starts, _, which = edges_of(table)
    order = np.argsort(np.mod(table[which, 1], 2.0 * np.pi), kind='stable')
    return starts[order], which[order]


def bounding_lines(lines: NDArray[np.float64], shortest_m: float) -> NDArray[np.float64]:
    """Return the lines that make an edge of their convex polygon, sorted by theta; none where they bound none.

    Of edges no longer than `shortest_m`, the shortest is taken away first.
    """
    while True:
        _, along, which = edges_of(np.ascontiguousarray(lines))
        lines = lines[which]
        if len(lines) == 0:
            return lines
        lengths = np.linalg.norm(along, axis=1)
        if lengths.min() > shortest_m:
            return lines[np.argsort(lines[:, 1], kind='stable')]
        lines = np.delete(lines, np.argmin(lengths), 0)


@kernel
def part_within(
    r: float, nx: float, ny: float, others: NDArray[np.float64], left_out: int
) -> tuple[float, float]:
    """Return where the part of a line inside all half-planes begins and ends, along it, counter-clockwise, from the
    foot of the origin.

    `others` (k, 3) are r, cos(theta) and sin(theta) of the half-planes; number `left_out` is skipped, and of lines that
    coincide only the first counts. Where nothing of the line is inside, it ends before it begins.
    """
    low, high = -np.inf, np.inf
    for j in range(len(others)):
        if j == left_out:
            continue
        sine, cosine = nx * others[j, 2] - ny * others[j, 1], nx * others[j, 1] + ny * others[j, 2]
        gap = others[j, 0] - r * cosine
        if sine >= PARALLEL:
            high = min(high, gap / sine)
        elif sine <= -PARALLEL:
            low = max(low, gap / sine)
        elif (cosine > 0.0 and (others[j, 0] < r or (others[j, 0] == r and j < left_out))) or (
                cosine < 0.0 and others[j, 0] <= -r):
            high = -np.inf
    return low, high


@kernel
def normals_of(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return r, cos(theta) and sin(theta) of lines (k, 2), shape (k, 3)."""
    table = np.empty((len(lines), 3))
    for i in range(len(lines)):
        table[i, 0], table[i, 1], table[i, 2] = lines[i, 0], np.cos(lines[i, 1]), np.sin(lines[i, 1])
    return table


def crossings(lines: NDArray[np.float64], least_sine: float) -> NDArray[np.float64]:
    """Return where along line i it is crossed by line j, from the foot of the origin (k, k) [m]; nan where they do not
    cross, or at an angle whose sine is smaller.
    """
    table = normals_of(lines)
    c, s = table[:, 1], table[:, 2]
    sine, cosine = np.outer(c, s) - np.outer(s, c), np.outer(c, c) + np.outer(s, s)
    along = np.full(sine.shape, np.nan)
    np.divide(table[None, :, 0] - table[:, None, 0] * cosine, sine, out=along, where=np.abs(sine) >= least_sine)
    return along


@kernel
def edges_of(
    lines: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]:
    """Return the edges of the intersection of half-planes (k, 2), in the order of the lines.

    Every line is cut by all other half-planes; what is left of it is its edge.

    Returns
    -------
    starts, along : ndarray, shape (n, 2)
        First corner of each edge and the way to its second, counter-clockwise [m]; no rows where the intersection
        is empty or unbounded.
    which : ndarray, shape (n,)
        Index of the line that makes the edge.
    """
    k, table = lines.shape[0], normals_of(lines)
    starts, along, which = np.empty((k, 2)), np.empty((k, 2)), np.empty(k, np.intp)
    n = 0
    for i in range(k):
        r, nx, ny = table[i, 0], table[i, 1], table[i, 2]
        low, high = part_within(r, nx, ny, table, i)
        if high <= low:
            continue
        if low == -np.inf or high == np.inf:
            return starts[:0], along[:0], which[:0]
        if high - low <= _ROUNDING * max(abs(r), max(abs(low), abs(high))):
            continue
        starts[n, 0], starts[n, 1] = r * nx - low * ny, r * ny + low * nx
        along[n, 0], along[n, 1] = (low - high) * ny, (high - low) * nx
        which[n] = i
        n += 1
    if n < 3:
        n = 0
    return starts[:n], along[:n], which[:n]


@kernel
def corners_of(lines: NDArray[np.float64], shortest: float = 0.0) -> tuple[bool, NDArray[np.float64]]:
    """Return the corners (n, 2) [m] of a ring of lines (n, 2), and whether they are an outline.

    They are none where an edge runs backwards or is no longer than `shortest` [m], where neighbouring lines are
    parallel, or where edges cross.
    """
    return ring_corners(lines, shortest, 1.0)


@kernel
def ring_corners(
    lines: NDArray[np.float64], shortest: float, around: float
) -> tuple[bool, NDArray[np.float64]]:
    """The same of a ring that goes `around` once counter-clockwise (1), as an outline, or clockwise (-1), as a hole."""
    n = len(lines)
    corners = np.empty((n, 2))
    if n < 3:
        return False, corners
    size, convex = 0.0, True
    for i in range(n):
        r, theta = lines[i - 1]
        q, phi = lines[i]
        sine = np.sin(phi - theta)
        if abs(sine) <= _TURN:
            return False, corners
        convex = convex and around * sine > 0.0
        corners[i, 0] = (r * np.sin(phi) - q * np.sin(theta)) / sine
        corners[i, 1] = (q * np.cos(theta) - r * np.cos(phi)) / sine
        size = max(size, abs(corners[i, 0]) + abs(corners[i, 1]))
    turned = 0.0
    for i in range(n):
        j = (i + 1) % n
        theta = lines[i, 1]
        length = (corners[j, 1] - corners[i, 1]) * np.cos(theta) - (corners[j, 0] - corners[i, 0]) * np.sin(theta)
        if length <= max(_SHORTEST * size, shortest):
            return False, corners
        turn = lines[j, 1] - theta
        turned += turn - 2.0 * np.pi * np.floor(turn / (2.0 * np.pi) + 0.5)
    once_around = abs(around * turned - 2.0 * np.pi) < 1e-6
    return once_around and (convex or not _crosses_itself(corners)), corners


@kernel
def inside(corners: NDArray[np.float64], x: float, y: float) -> bool:
    """Return whether a place is inside a simple polygon (n, 2)."""
    n, odd = len(corners), False
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        if (corners[k, 1] > y) != (corners[j, 1] > y):
            share = (y - corners[k, 1]) / (corners[j, 1] - corners[k, 1])
            if x < corners[k, 0] + share * (corners[j, 0] - corners[k, 0]):
                odd = not odd
    return odd


@kernel
def are_inside(corners: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which places (m, 2) are inside a simple polygon (n, 2)."""
    found = np.zeros(len(places), np.bool_)
    for i in range(len(places)):
        found[i] = inside(corners, places[i, 0], places[i, 1])
    return found


@kernel
def is_convex(corners: NDArray[np.float64]) -> bool:
    """Return whether a counter-clockwise outline turns left at every corner."""
    n = len(corners)
    for i in range(n):
        j, k = (i + 1) % n, (i + 2) % n
        ax, ay = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        bx, by = corners[k, 0] - corners[j, 0], corners[k, 1] - corners[j, 1]
        if ax * by - ay * bx <= 0.0:
            return False
    return True


@kernel
def _crosses_itself(corners: NDArray[np.float64]) -> bool:
    """Return whether two edges that are no neighbours meet."""
    n = len(corners)
    for i in range(n):
        a, b = corners[i], corners[(i + 1) % n]
        for k in range(i + 2, n if i > 0 else n - 1):
            c, d = corners[k], corners[(k + 1) % n]
            apart = False  # as two edges on one line are, which are on no side of each other
            for axis in range(2):
                apart = apart or max(a[axis], b[axis]) < min(c[axis], d[axis]) or (
                    max(c[axis], d[axis]) < min(a[axis], b[axis]))
            if not apart and side(a, b, c) * side(a, b, d) <= 0.0 and side(c, d, a) * side(c, d, b) <= 0.0:
                return True
    return False


@kernel
def side(a: NDArray[np.float64], b: NDArray[np.float64], p: NDArray[np.float64]) -> float:
    """Return twice the area of a, b, p: positive where p is on the left of the way from a to b."""
    return float((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]))
