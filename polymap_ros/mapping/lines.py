"""Lines of eq. (2), x cos(theta) + y sin(theta) = r, and the convex polygons they bound.

A line stands for the half-plane x cos(theta) + y sin(theta) <= r: theta is the direction of the outward normal.
"""

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from polymap_ros.jit import kernel

_PARALLEL = 1e-9
"""Sine of the angle [rad] between two lines below which they are taken as parallel."""

_SHORTEST = 1e-12
"""An edge is at least this long relative to its distance from the foot of the origin: what is shorter is rounding."""


def half_plane_polygon(lines: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """The intersection of half-planes.

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


@kernel
def edges_of(
    lines: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]:
    """Edges of the intersection of half-planes (k, 2), in the order of the lines.

    Every line is cut by all other half-planes; what is left of it is its edge.

    Returns
    -------
    starts, along : ndarray, shape (n, 2)
        First corner of each edge and the way to its second, counter-clockwise [m]; no rows where the intersection
        is empty or unbounded.
    which : ndarray, shape (n,)
        Index of the line that makes the edge.
    """
    k = lines.shape[0]
    r = lines[:, 0]
    nx, ny = np.cos(lines[:, 1]), np.sin(lines[:, 1])
    starts, along, which = np.empty((k, 2)), np.empty((k, 2)), np.empty(k, np.intp)
    n = 0
    for i in range(k):
        low, high = -np.inf, np.inf  # the part of line i inside, measured counter-clockwise from the origin's foot
        for j in range(k):
            if j == i:
                continue
            sine, cosine = nx[i] * ny[j] - ny[i] * nx[j], nx[i] * nx[j] + ny[i] * ny[j]
            gap = r[j] - r[i] * cosine
            if sine >= _PARALLEL:
                high = min(high, gap / sine)
            elif sine <= -_PARALLEL:
                low = max(low, gap / sine)
            elif (cosine > 0.0 and (r[j] < r[i] or (r[j] == r[i] and j < i))) or (cosine < 0.0 and r[j] <= -r[i]):
                high = -np.inf
        if high <= low:
            continue
        if low == -np.inf or high == np.inf:
            return starts[:0], along[:0], which[:0]
        if high - low <= _SHORTEST * max(abs(r[i]), max(abs(low), abs(high))):
            continue
        starts[n, 0], starts[n, 1] = r[i] * nx[i] - low * ny[i], r[i] * ny[i] + low * nx[i]
        along[n, 0], along[n, 1] = (low - high) * ny[i], (high - low) * nx[i]
        which[n] = i
        n += 1
    if n < 3:
        n = 0
    return starts[:n], along[:n], which[:n]


def polygon_lines(vertices: ArrayLike) -> NDArray[np.float64]:
    """r [m] and theta [rad] of the edges of a counter-clockwise polygon (n, 2), shape (n, 2)."""
    corners = np.asarray(vertices, dtype=float)
    along = np.roll(corners, -1, axis=0) - corners
    theta = np.arctan2(-along[:, 0], along[:, 1])
    return np.column_stack((corners[:, 0] * np.cos(theta) + corners[:, 1] * np.sin(theta), theta))


def mirrored_lines(lines: ArrayLike, middle: ArrayLike, along: ArrayLike) -> NDArray[np.float64]:
    """r [m] and theta [rad] of lines (n, 2) mirrored in the line through `middle` along a unit vector, shape (n, 2)."""
    r, theta = np.asarray(lines, dtype=float).reshape(-1, 2).T
    (x, y), (c, s) = np.asarray(middle, dtype=float), np.asarray(along, dtype=float)
    turned = 2.0 * np.arctan2(s, c) - theta
    turned = np.arctan2(np.sin(turned), np.cos(turned))
    # Each keeps its distance from the middle.
    return np.column_stack((r + x * (np.cos(turned) - np.cos(theta)) + y * (np.sin(turned) - np.sin(theta)), turned))


def feet_on_edges(vertices: ArrayLike, points: ArrayLike, weights: ArrayLike = 1) -> NDArray[np.intp]:
    """How many of the points (m, 2), each counted `weights` times, have their foot on each edge; shape (n,)."""
    corners, points = np.asarray(vertices, dtype=float), np.asarray(points, dtype=float)
    along = np.roll(corners, -1, axis=0) - corners
    share = np.einsum('mnk,nk->mn', points[:, None] - corners, along) / np.sum(along**2, axis=1)
    inside = (share >= 0.0) & (share <= 1.0)
    count: NDArray[np.intp] = np.sum(inside * np.reshape(np.asarray(weights, np.intp), (-1, 1)), axis=0)
    return count


def iou(first: ArrayLike, second: ArrayLike) -> float:
    """Intersection over union of two polygons given by their vertices; 0 if either has none."""
    a, b = (np.asarray(vertices, dtype=float).reshape(-1, 2) for vertices in (first, second))
    if len(a) < 3 or len(b) < 3:
        return 0.0
    one, other = shapely.Polygon(a), shapely.Polygon(b)
    both = float(one.intersection(other).area)
    return both / float(one.area + other.area - both)
