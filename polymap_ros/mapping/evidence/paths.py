"""Paths between the walls of a convex polygon given by its lines: corners, lengths and their derivatives."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.image_sources import trace_images
from polymap_ros.jit import kernel

CAPACITY = 512
"""Paths kept per ping: an octagon of order 5 has about 110."""

_SHORTEST = 1e-4
"""Shortest edge relative to the polygon's size: a shorter one has no foot of any ping on it."""


@kernel
def corners_of(lines: NDArray[np.float64]) -> tuple[bool, NDArray[np.float64]]:
    """Corners of the polygon whose edges are all of `lines` (n, 2), sorted by theta; corner i starts edge i.

    The answer's first part is False where the lines bound no polygon or where one of them makes no edge of it.
    """
    n = len(lines)
    corners = np.empty((n, 2))
    if n < 3:
        return False, corners
    size = 0.0
    for i in range(n):
        r, theta = lines[i - 1]
        q, phi = lines[i]
        sine = np.sin(phi - theta)
        if sine <= 1e-6:
            return False, corners
        corners[i, 0] = (r * np.sin(phi) - q * np.sin(theta)) / sine
        corners[i, 1] = (q * np.cos(theta) - r * np.cos(phi)) / sine
        size = max(size, abs(corners[i, 0]) + abs(corners[i, 1]))
    for i in range(n):
        j = (i + 1) % n
        theta = lines[i, 1]
        length = (corners[j, 1] - corners[i, 1]) * np.cos(theta) - (corners[j, 0] - corners[i, 0]) * np.sin(theta)
        if length <= _SHORTEST * size:
            return False, corners
    return True, corners


@kernel
def path_derivatives(
    lines: NDArray[np.float64], x: float, y: float, walls: NDArray[np.int64], order: int, out: NDArray[np.float64]
) -> None:
    """Derivatives of half a path's length by r and theta of each wall it hits, into out (order, 2).

    A path is shortest over its points of reflection b, so only the wall's own motion along its normal n counts:
    half the length grows by cos(incidence) per unit of it, and b moves by dr - dtheta (b . t), t along the wall.
    """
    px, py = np.empty(order + 1), np.empty(order + 1)
    px[0], py[0] = x, y
    for level in range(order):
        r, theta = lines[walls[level]]
        c, s = np.cos(theta), np.sin(theta)
        step = 2.0 * (r - (px[level] * c + py[level] * s))
        px[level + 1], py[level + 1] = px[level] + step * c, py[level] + step * s
    bx, by = x, y
    for level in range(order, 0, -1):
        r, theta = lines[walls[level - 1]]
        c, s = np.cos(theta), np.sin(theta)
        dx, dy = px[level] - bx, py[level] - by
        towards = dx * c + dy * s
        step = (r - (bx * c + by * s)) / towards
        bx, by = bx + step * dx, by + step * dy
        cosine = towards / np.hypot(dx, dy)
        out[level - 1, 0] = cosine
        out[level - 1, 1] = -cosine * (by * c - bx * s)


@kernel
def trace_paths(
    corners: NDArray[np.float64],
    x: float,
    y: float,
    order: int,
    range_max: float,
    found: NDArray[np.float64],
    walls: NDArray[np.int64],
    half: NDArray[np.float64],
    hits: NDArray[np.int64],
) -> int:
    """Audible paths with half their length up to `range_max`: `half` and `hits` (reflections) are filled.

    Returns their number; `walls` is compacted to match.
    """
    count = min(trace_images(corners, x, y, order, found, walls), len(found))
    kept = 0
    for m in range(count):
        d = 0.5 * np.hypot(found[m, 0] - x, found[m, 1] - y)
        if d > range_max:
            continue
        half[kept] = d
        hits[kept] = 0
        for level in range(order):
            walls[kept, level] = walls[m, level]
            if walls[m, level] >= 0:
                hits[kept] += 1
        kept += 1
    return kept
