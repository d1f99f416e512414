"""Sides of a convex outline that are curved a little, and the paths over them.

A curved side is a parabola, an arc for all that is asked here: at t from where it touches its line it is c t^2 / 2 in
front of it, so that with c above 0 the room bulges. A path over it is where the length of the way over one point of
each side is stationary, found by Newton's method from where straight sides reflect it.
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.sides import Sides
from polymap_ros.jit import kernel, within_kernels

_UNBENT_STEPS = 3
"""Steps of Newton's method: a wall of a metre with a radius of 20 m moves points by centimetres; after three steps half
a path's length is right to a nanometre (`test_curved`)."""

_LONGER = 0.1
"""By this share of its length a curved outline's side is taken to be longer, at each end, where images are looked for:
its paths may be where those of straight sides miss by as much."""


@kernel
def curved_sides(sides: Sides, bend: NDArray[np.float64]) -> Sides:
    """Return the sides of a convex outline with curvatures [1/m] and where they touch their lines [m], (n, 2).

    Their ends are where they meet, to the first order.
    """
    rows, n = sides.rows.copy(), len(sides.rows)
    for one in range(n):
        two = (one + 1) % n
        c, s = sides.rows[one, 0], sides.rows[one, 1]
        cosine = c * sides.rows[two, 0] + s * sides.rows[two, 1]
        sine = c * sides.rows[two, 1] - s * sides.rows[two, 0]
        end, start = sides.rows[one, 4] - bend[one, 1], sides.rows[two, 3] - bend[two, 1]
        before, after = 0.5 * bend[one, 0] * end * end, 0.5 * bend[two, 0] * start * start
        rows[one, 4] += (before * cosine - after) / sine
        rows[two, 3] += (before - after * cosine) / sine
    for one in range(n):
        longer = _LONGER * (sides.rows[one, 4] - sides.rows[one, 3])
        rows[one, 5] += longer * rows[one, 1]
        rows[one, 6] -= longer * rows[one, 0]
        rows[one, 7] -= longer * rows[one, 1]
        rows[one, 8] += longer * rows[one, 0]
    return Sides(rows, sides.corners, sides.wall, sides.forward, sides.passed, bend, sides.convex)


@within_kernels
def over_curves(
    sides: Sides, ends: NDArray[np.float64], hits: int, derive: bool, sequence: NDArray[np.int64],
    along: NDArray[np.float64], slopes: NDArray[np.float64], moves: NDArray[np.float64],
) -> tuple[float, float]:
    """Return half a path's length in the plane, and how far inside the ends of its sides it stays.

    `ends` are those of `trace_paths`; `along` (hits,) is where straight sides, by their `sequence`, reflect it, from
    the foot of the origin, and is changed to where curved ones do; `slopes` and `moves` are filled if to `derive`.
    """
    rows, bend = sides.rows, sides.bend
    points, tangents, unit = np.empty((hits + 2, 2)), np.empty((hits, 2)), np.empty((hits + 1, 2))
    length, slope, diagonal, beside = np.empty(hits + 1), np.empty(hits), np.empty(hits), np.empty(hits)
    points[0, 0], points[0, 1], points[hits + 1, 0], points[hits + 1, 1] = ends[0], ends[1], ends[2], ends[3]
    for step in range(_UNBENT_STEPS + 1):
        for k in range(hits):
            c, s, r = rows[sequence[k], 0], rows[sequence[k], 1], rows[sequence[k], 2]
            curvature, aside = bend[sequence[k], 0], along[k] - bend[sequence[k], 1]
            away = r - 0.5 * curvature * aside * aside
            points[k + 1, 0], points[k + 1, 1] = away * c - along[k] * s, away * s + along[k] * c
            tangents[k, 0], tangents[k, 1] = -s - curvature * aside * c, c - curvature * aside * s
        for k in range(hits + 1):
            x, y = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
            length[k] = np.sqrt(x * x + y * y) + 1e-12
            unit[k, 0], unit[k, 1] = x / length[k], y / length[k]
        if step == _UNBENT_STEPS:
            break
        for k in range(hits):
            x, y = unit[k, 0] - unit[k + 1, 0], unit[k, 1] - unit[k + 1, 1]
            before = tangents[k, 0] * unit[k, 0] + tangents[k, 1] * unit[k, 1]
            after = tangents[k, 0] * unit[k + 1, 0] + tangents[k, 1] * unit[k + 1, 1]
            square = tangents[k, 0] ** 2 + tangents[k, 1] ** 2
            slope[k] = before - after
            diagonal[k] = (square - before * before) / length[k] + (square - after * after) / length[k + 1] - (
                bend[sequence[k], 0] * (x * rows[sequence[k], 0] + y * rows[sequence[k], 1]))
            if k + 1 < hits:
                on = tangents[k + 1, 0] * unit[k + 1, 0] + tangents[k + 1, 1] * unit[k + 1, 1]
                both = tangents[k, 0] * tangents[k + 1, 0] + tangents[k, 1] * tangents[k + 1, 1]
                beside[k] = (after * on - both) / length[k + 1]
        if not _solved(diagonal, beside, slope):
            return 0.0, -np.inf
        for k in range(hits):
            along[k] -= slope[k]
    inside = np.inf
    for k in range(hits):
        wall = sequence[k]
        inside = min(inside, along[k] - rows[wall, 3], rows[wall, 4] - along[k])
        if derive:
            x, y = 0.5 * (unit[k, 0] - unit[k + 1, 0]), 0.5 * (unit[k, 1] - unit[k + 1, 1])
            slopes[k, 0] = x * rows[wall, 0] + y * rows[wall, 1]
            slopes[k, 1] = y * points[k + 1, 0] - x * points[k + 1, 1]
    if derive:
        moves[0], moves[1] = -0.5 * unit[0, 0], -0.5 * unit[0, 1]
        moves[2], moves[3] = 0.5 * unit[hits, 0], 0.5 * unit[hits, 1]
    return 0.5 * np.sum(length), inside


@within_kernels
def _solved(diagonal: NDArray[np.float64], beside: NDArray[np.float64], right: NDArray[np.float64]) -> bool:
    """Solve a symmetric tridiagonal system in place of its right side; returns whether it is positive definite: where
    it is not, a way is not where it is shortest, as past a corner.
    """
    n = len(right)
    for k in range(n):
        if k > 0:
            share = beside[k - 1] / diagonal[k - 1]
            diagonal[k] -= share * beside[k - 1]
            right[k] -= share * right[k - 1]
        if diagonal[k] <= 0.0:
            return False
    for k in range(n - 1, -1, -1):
        if k + 1 < n:
            right[k] -= beside[k] * right[k + 1]
        right[k] /= diagonal[k]
    return True
