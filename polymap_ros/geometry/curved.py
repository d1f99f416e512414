"""Sides of a convex outline that are curved a little, or end where corners are rounded, and the paths over them.

A curved side is a parabola, an arc for all that is asked here: at t from where it touches its line it is c t^2 / 2 in
front of it, so that with c above 0 the room bulges. A path over it is where the length of the way over one point of
each side is stationary, found by Newton's method from where straight sides reflect it.
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.image_sources import faded
from polymap_ros.geometry.path_room import Paths
from polymap_ros.geometry.sides import Sides
from polymap_ros.jit import kernel

_UNBENT_STEPS, _AT_REST_M, _SHORTEST_LEG_M = 16, 1e-6, 1e-12
"""Steps of Newton's method, after the last of which no point moves by more than this: that is three or four but where a
path is reflected beside a corner. Legs are as long at least."""

_OF_LEG = 0.5
"""Share of its shortest leg by which points of a path are moved in a step, at most."""

_LONGER = 4.0
"""Sides of an outline are taken to be longer, at each end, where images are looked for, by so many times the length of
the longest and twice the slope at the ends of one that is curved: a path that it reflects twice, in five reflections,
is aside by as much from that over straight sides."""


@kernel
def rounded_sides(sides: Sides, corner: NDArray[np.float64], shortest: float) -> tuple[bool, Sides]:
    """Return the sides of a convex outline between corners that are `round`, see `Sides`, and whether more than the
    `shortest` [m] is left of each.
    """
    rows, n, radius = sides.rows.copy(), len(sides.rows), corner[0]
    for one in range(n):
        two = (one + 1) % n
        c, s = sides.rows[one, 0], sides.rows[one, 1]
        cosine = c * sides.rows[two, 0] + s * sides.rows[two, 1]
        sine = c * sides.rows[two, 1] - s * sides.rows[two, 0]
        cut = radius * sine / (1.0 + cosine)  # the tangent of half the turn
        rows[one, 4] -= cut
        rows[one, 7], rows[one, 8] = rows[one, 7] + cut * s, rows[one, 8] - cut * c
        rows[two, 3] += cut
        rows[two, 5] -= cut * sides.rows[two, 1]
        rows[two, 6] += cut * sides.rows[two, 0]
    left = bool(np.all(rows[:, 4] - rows[:, 3] > shortest))
    return left, Sides(rows, sides.corners, sides.wall, sides.forward, sides.passed, sides.bend, corner, sides.convex)


@kernel
def curved_sides(sides: Sides, bend: NDArray[np.float64]) -> Sides:
    """Return the sides of a convex outline with curvatures [1/m] and where they touch their lines [m], (n, 2).

    The rows are longer, those of straight sides over which images are looked for; beside the curvature stands where
    curved ones end: where they meet, to the first order.
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
    curved = np.column_stack((bend, rows[:, 3:5]))
    lengths = sides.rows[:, 4] - sides.rows[:, 3]
    longer = _LONGER * np.max(np.abs(bend[:, 0]) * lengths) * np.max(lengths)
    for one in range(n):
        rows[one, 3], rows[one, 4] = sides.rows[one, 3] - longer, sides.rows[one, 4] + longer
        rows[one, 5] += longer * rows[one, 1]
        rows[one, 6] -= longer * rows[one, 0]
        rows[one, 7] -= longer * rows[one, 1]
        rows[one, 8] += longer * rows[one, 0]
    return Sides(rows, sides.corners, sides.wall, sides.forward, sides.passed, curved, sides.round, sides.convex)


@kernel
def from_round_corners(
    sides: Sides, ends: NDArray[np.float64], range_max: float, soft: float, count: int, paths: Paths
) -> int:
    """Add to the first `count` paths the echo of each corner that a ray through its circle's centre meets; returns how
    many there are.

    Over D to the centre and the radius a on, it is sqrt(a / D) as loud as a wall's, and a quarter of a cycle ahead: it
    has passed a focus. By derivatives it counts as one of the end of the wall that begins there.
    """
    rows, (radius, nearer), n = sides.rows, sides.round, len(sides.rows)
    x, y, up = 0.5 * (ends[0] + ends[2]), 0.5 * (ends[1] + ends[3]), 0.25 * ends[4] * ends[4]
    for wall in range(n):
        before = wall - 1 if wall > 0 else n - 1
        c, s, along = rows[wall, 0], rows[wall, 1], sides.rows[wall, 3]
        if len(sides.bend) > 0:
            along = sides.bend[wall, 2]
        away = rows[wall, 2] - radius
        dx, dy = away * c - along * s - x, away * s + along * c - y  # to the centre
        far = np.sqrt(dx * dx + dy * dy)
        past = dy * rows[before, 0] - dx * rows[before, 1]
        short = dx * s - dy * c
        weight = np.sqrt(radius / max(far, radius)) * faded(radius / max(far, radius) * min(past, short), soft)
        half = np.sqrt((far + radius) ** 2 + up) - nearer
        if weight > 0.0 and half <= range_max and count < len(paths.half):
            paths.half[count], paths.weight[count], paths.hits[count], paths.bounces[count] = half, weight, 1, 0
            paths.walls[count] = -1
            paths.walls[count, 0] = wall
            paths.slopes[count, 0, 0], paths.slopes[count, 0, 1] = 1.0, -along
            paths.moves[count, 0], paths.moves[count, 1] = -0.5 * dx / far, -0.5 * dy / far
            paths.moves[count, 2], paths.moves[count, 3] = -0.5 * dx / far, -0.5 * dy / far
            count += 1
    return count


@kernel
def over_curves(
    sides: Sides, ends: NDArray[np.float64], soft: float, count: int, paths: Paths
) -> int:
    """Fill `paths`, of which the first `count` have the sides that they meet, and return how many of them there are.

    `ends` and `soft` are those of `trace_paths`.
    """
    up, order, kept = 0.25 * ends[4] * ends[4], paths.walls.shape[1], 0
    for m in range(count):
        hits = 0
        while hits < order and paths.walls[m, hits] >= 0:
            hits += 1
        along = _reflected(sides.rows, ends, paths.walls[m, :hits])
        slopes, moves = paths.slopes[kept], paths.moves[kept]
        flat, inside, focused = _settled(sides, ends, paths.walls[m, :hits], along, slopes, moves)
        weight = focused * faded(inside, soft)
        if weight > 0.0:
            paths.half[kept], paths.hits[kept], paths.weight[kept] = np.sqrt(flat * flat + up), hits, weight
            paths.walls[kept], paths.bounces[kept] = paths.walls[m], 0
            if up > 0.0:
                slopes[:hits] *= flat / paths.half[kept]
                moves *= flat / paths.half[kept]
            kept += 1
    return kept


@kernel
def _reflected(
    rows: NDArray[np.float64], ends: NDArray[np.float64], sequence: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return where along straight sides (hits,) a path is reflected, from the foot of the origin."""
    hits = len(sequence)
    images, along = np.empty((hits + 1, 2)), np.empty(hits)
    images[0, 0], images[0, 1] = ends[0], ends[1]
    for k in range(hits):
        c, s, r = rows[sequence[k], 0], rows[sequence[k], 1], rows[sequence[k], 2]
        away = 2.0 * (r - images[k, 0] * c - images[k, 1] * s)
        images[k + 1, 0], images[k + 1, 1] = images[k, 0] + away * c, images[k, 1] + away * s
    x, y = ends[2], ends[3]
    for k in range(hits - 1, -1, -1):
        c, s, r = rows[sequence[k], 0], rows[sequence[k], 1], rows[sequence[k], 2]
        dx, dy = images[k + 1, 0] - x, images[k + 1, 1] - y
        towards = dx * c + dy * s
        ahead = (r - x * c - y * s) / (towards if towards != 0.0 else _SHORTEST_LEG_M)
        x, y = x + ahead * dx, y + ahead * dy
        along[k] = y * c - x * s
    return along


@kernel
def _settled(
    sides: Sides, ends: NDArray[np.float64], sequence: NDArray[np.int64], along: NDArray[np.float64],
    slopes: NDArray[np.float64], moves: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Return half a path's length in the plane, how far inside the ends of its sides it stays, and what their curvature
    makes of its amplitude: the root of how much wider a straight tube of rays is.

    `along` (hits,) is where straight sides reflect it, and is changed to where curved ones do; the derivatives `slopes`
    and `moves` are filled.
    """
    rows, bend, hits = sides.rows, sides.bend, len(sequence)
    points, tangents, unit = np.empty((hits + 2, 2)), np.empty((hits, 2)), np.empty((hits + 1, 2))
    length, slope, diagonal, beside = np.empty(hits + 1), np.empty(hits), np.empty(hits), np.empty(hits)
    points[0, 0], points[0, 1], points[hits + 1, 0], points[hits + 1, 1] = ends[0], ends[1], ends[2], ends[3]
    moved = np.inf
    for step in range(_UNBENT_STEPS + 1):
        for k in range(hits):
            c, s, r = rows[sequence[k], 0], rows[sequence[k], 1], rows[sequence[k], 2]
            curvature, aside = bend[sequence[k], 0], along[k] - bend[sequence[k], 1]
            away = r - 0.5 * curvature * aside * aside
            points[k + 1, 0], points[k + 1, 1] = away * c - along[k] * s, away * s + along[k] * c
            tangents[k, 0], tangents[k, 1] = -s - curvature * aside * c, c - curvature * aside * s
        for k in range(hits + 1):
            x, y = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
            length[k] = np.sqrt(x * x + y * y) + _SHORTEST_LEG_M
            unit[k, 0], unit[k, 1] = x / length[k], y / length[k]
        if step == _UNBENT_STEPS or moved < _AT_REST_M:
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
            return 0.0, -np.inf, 1.0
        moved = np.max(np.abs(slope))
        along -= min(1.0, _OF_LEG * np.min(length) / max(moved, _SHORTEST_LEG_M)) * slope
    inside, focused = _described(sides, sequence, along, points, tangents, unit, length, slopes, moves)
    return 0.5 * np.sum(length), inside if moved < _AT_REST_M else -np.inf, focused


@kernel
def _described(
    sides: Sides, sequence: NDArray[np.int64], along: NDArray[np.float64], points: NDArray[np.float64],
    tangents: NDArray[np.float64], unit: NDArray[np.float64], length: NDArray[np.float64],
    slopes: NDArray[np.float64], moves: NDArray[np.float64],
) -> tuple[float, float]:
    """Fill the derivatives of a path over its points, by its legs' directions and lengths; returns how far inside it
    stays and what it is focused by.
    """
    rows, bend, hits = sides.rows, sides.bend, len(sequence)
    inside, wide, opening = np.inf, length[0], 1.0
    for k in range(hits):
        wall = sequence[k]
        inside = min(inside, along[k] - bend[wall, 2], bend[wall, 3] - along[k])
        x, y = 0.5 * (unit[k, 0] - unit[k + 1, 0]), 0.5 * (unit[k, 1] - unit[k + 1, 1])
        slopes[k, 0] = x * rows[wall, 0] + y * rows[wall, 1]
        slopes[k, 1] = y * points[k + 1, 0] - x * points[k + 1, 1]
        if slopes[k, 0] <= _AT_REST_M:  # straight on is stationary, too
            inside = -np.inf
        # Mirrored, the tube opens less by twice its width over the radius and the cosine of incidence.
        cosine = unit[k, 0] * tangents[k, 1] - unit[k, 1] * tangents[k, 0]
        opening -= 2.0 * bend[wall, 0] * wide / max(cosine, _AT_REST_M)
        wide += length[k + 1] * opening
    moves[0], moves[1] = -0.5 * unit[0, 0], -0.5 * unit[0, 1]
    moves[2], moves[3] = 0.5 * unit[hits, 0], 0.5 * unit[hits, 1]
    return inside, np.sqrt(np.sum(length) / max(abs(wide), _AT_REST_M))


@kernel
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
