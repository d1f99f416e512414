"""Sides of walls that reflect: those of an outline, of holes in it, and both of each wall that stands inside.

Lines of eq. (2) stand for walls. The first are the outline's, a ring counter-clockwise; then come the holes', each a
ring of its own, clockwise, so that the room is on the left of every edge and the outward normal points into the hole.
The last are inner walls, each a part of its line that lets some of the wave through: a stiffener, a weld seam.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import PARALLEL, corners_of, inside, is_convex, ring_corners, side
from polymap_ros.jit import kernel

_CONVEX, _REFLEX = 1, -1
"""Kinds of corners: neither of two sides is in front of the other where it points inwards."""


class Interior(NamedTuple):
    """What stands inside an outline: how many of the lines after the outline's are those of which hole, or inner walls.

    Attributes
    ----------
    holes : ndarray, shape (h,), int64
        Number of walls of each hole.
    spans : ndarray, shape (k, 3)
        Where each inner wall starts and ends along its line, from the foot of the origin [m], and what it leaves of the
        amplitude of what crosses it. An end beyond the outline, or in a hole, is where the wall meets that.
    """

    holes: NDArray[np.int64]
    spans: NDArray[np.float64]


NOTHING = Interior(np.empty(0, np.int64), np.empty((0, 3)))
"""Inside most outlines."""


class Sides(NamedTuple):
    """Sides of walls, each seen from its front.

    Attributes
    ----------
    rows : ndarray, shape (m, 9)
        cos(theta) and sin(theta) of the normal, which points away from the front, and r; where the side starts and ends
        along itself, counted from the foot of the origin; x and y of its start and of its end, each moved outwards by
        the length over which it is soft [m].
    corners : ndarray, shape (m, m), int8
        1 where two sides meet in a corner that points outwards, -1 where in one that points inwards, 0 elsewhere.
    wall : ndarray, shape (m,), int64
        Number of the wall.
    forward : ndarray, shape (m,)
        1 for the side that its wall's line is that of, -1 for the back of an inner wall.
    passed : ndarray, shape (m,)
        What a wall leaves of the amplitude of a wave that crosses it.
    bend : ndarray, shape (m, 4)
        Curvature of each side [1/m], and where along it it touches its line, starts and ends [m] (`geometry.curved`);
        empty where all are straight.
    round : ndarray, shape (2,)
        Radius of the corners, and by how much nearer their echoes seem than they are [m]; empty where they are sharp.
    convex : bool
        Whether they are those of a convex outline alone, and no wall can stand in the way.
    """

    rows: NDArray[np.float64]
    corners: NDArray[np.int8]
    wall: NDArray[np.int64]
    forward: NDArray[np.float64]
    passed: NDArray[np.float64]
    bend: NDArray[np.float64]
    round: NDArray[np.float64]
    convex: bool


@kernel
def sides_of(
    lines: NDArray[np.float64], interior: Interior, soft: float, shortest: float = 0.0
) -> tuple[bool, Sides]:
    """Return the sides of walls (n, 2), soft over `soft`, and whether they are an outline with what is in it.

    No wall may be as short as `shortest` [m].
    """
    holes, spans = interior
    ring = len(lines) - len(spans) - int(np.sum(holes))
    outline, corners = corners_of(lines[:ring], shortest)
    if not outline:
        return False, _room(0)
    if len(lines) == ring:
        return True, outline_sides(corners, soft, is_convex(corners))
    sides = _room(len(lines) + len(spans))
    _add_ring(corners, 0, soft, sides)
    first = ring
    for number in range(len(holes)):
        valid, hole = ring_corners(lines[first:first + holes[number]], shortest, -1.0)
        if not valid or _crossing(hole, corners) or not inside(corners, hole[0, 0], hole[0, 1]):
            return False, sides
        if not _apart(hole, lines[ring:first], holes[:number], shortest):
            return False, sides
        _add_ring(hole, first, soft, sides)
        first += int(holes[number])
    for k in range(len(spans)):
        if not _add_inner(lines[first + k], spans[k], first, first + 2 * k, corners, soft, shortest, sides):
            return False, sides
    return True, sides


@kernel
def outline_sides(corners: NDArray[np.float64], soft: float, convex: bool) -> Sides:
    """Return the sides of a polygon (n, 2), counter-clockwise [m], which is taken for `convex` or not."""
    sides = _room(len(corners))
    _add_ring(corners, 0, soft, sides)
    return Sides(sides.rows, sides.corners, sides.wall, sides.forward, sides.passed, sides.bend,
                 sides.round, convex)


@kernel
def _room(count: int) -> Sides:
    return Sides(np.empty((count, 9)), np.zeros((count, count), np.int8), np.arange(count), np.ones(count),
                 np.zeros(count), np.empty((0, 4)), np.empty(0), False)


@kernel
def _add_ring(corners: NDArray[np.float64], first: int, soft: float, sides: Sides) -> None:
    """Fill the rows of a ring from the first on, and its corners."""
    n = len(corners)
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x, y = corners[i, 0], corners[i, 1]
        ex, ey = corners[j, 0] - x, corners[j, 1] - y
        length = np.sqrt(ex * ex + ey * ey)
        ex, ey = ex / length, ey / length
        low = x * ex + y * ey
        _fill(sides.rows[first + i], ey, -ex, x * ey - y * ex, low, low + length, soft)
    for i in range(n):
        one, two = first + i, first + (i + 1) % n
        turn = sides.rows[one, 0] * sides.rows[two, 1] - sides.rows[one, 1] * sides.rows[two, 0]
        sides.corners[one, two] = sides.corners[two, one] = _CONVEX if turn > 0.0 else _REFLEX


@kernel
def _fill(row: NDArray[np.float64], c: float, s: float, r: float, low: float, high: float, soft: float) -> None:
    """Fill a side's row: its normal, its place, and its ends along itself."""
    row[0], row[1], row[2], row[3], row[4] = c, s, r, low, high
    row[5], row[6] = r * c - (low - soft) * s, r * s + (low - soft) * c
    row[7], row[8] = r * c - (high + soft) * s, r * s + (high + soft) * c


@kernel
def _apart(
    hole: NDArray[np.float64], lines: NDArray[np.float64], others: NDArray[np.int64], shortest: float
) -> bool:
    """Return whether a hole, by its corners, has nothing in common with others, by their lines and numbers of them."""
    first = 0
    for count in others:
        _, other = ring_corners(lines[first:first + count], shortest, -1.0)
        if inside(other, hole[0, 0], hole[0, 1]) or inside(hole, other[0, 0], other[0, 1]) or _crossing(hole, other):
            return False
        first += count
    return True


@kernel
def _crossing(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether edges of two polygons cross."""
    for i in range(len(one)):
        for k in range(len(other)):
            if _cross(one[i - 1], one[i], other[k - 1], other[k]):
                return True
    return False


@kernel
def _cross(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], d: NDArray[np.float64]) -> bool:
    """Return whether the ways from a to b and from c to d cross."""
    return bool(side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0)


@kernel
def _add_inner(
    line: NDArray[np.float64], span: NDArray[np.float64], rings: int, at: int, corners: NDArray[np.float64],
    soft: float, shortest: float, sides: Sides,
) -> bool:
    """Fill the rows of an inner wall's two sides, from row `at` on, up to where it meets one of the first `rings` rows.

    Returns whether it is inside the outline and long enough.
    """
    r, c, s = line[0], np.cos(line[1]), np.sin(line[1])
    low, high = span[0], span[1]
    middle = 0.5 * (low + high)
    x, y = r * c - middle * s, r * s + middle * c
    if not inside(corners, x, y):
        return False
    start, end = -1, -1
    for k in range(rings):
        row = sides.rows[k]
        across = row[0] * -s + row[1] * c
        if abs(across) < PARALLEL:
            continue
        ahead = (row[2] - x * row[0] - y * row[1]) / across
        along = (y + ahead * c) * row[0] - (x - ahead * s) * row[1]
        if along < row[3] or along > row[4]:
            continue
        if 0.0 < ahead <= high - middle:
            high, end = middle + ahead, k
        elif 0.0 > ahead >= low - middle:
            low, start = middle + ahead, k
    if high - low <= shortest:
        return False
    _fill(sides.rows[at], c, s, r, low, high, soft)
    _fill(sides.rows[at + 1], -c, -s, -r, -high, -low, soft)
    sides.forward[at + 1] = -1.0
    wall = rings + (at - rings) // 2
    for face in (at, at + 1):
        sides.wall[face], sides.passed[face] = wall, span[2]
        for met in (start, end):
            if met >= 0:
                sides.corners[face, met] = sides.corners[met, face] = _CONVEX
    sides.corners[at, at + 1] = sides.corners[at + 1, at] = _REFLEX
    return True
