"""Visible image sources I(x, M) of eq. (1) in a simple polygon, for a receiver at the source or beside it.

Every image carries the beam of its rays: the part of its last wall that they light. A further wall is hit where it lies
in that beam. In a convex polygon nothing else can stand in the way, so the search visits visible images and their
children only, wall by wall along the beam, to any order and exactly. In any other, every wall in the beam and beyond
the last one is followed, and each leg of an audible path is tested against all walls.
"""

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from polymap_ros.geometry.outline import is_convex
from polymap_ros.geometry.sides import Sides, outline_sides
from polymap_ros.jit import kernel

_TIE = 1e-9
"""Relative tolerance of visibility. A ray through a corner (as for every right-angled one, with the receiver at the
source) counts for both orders of its walls; their images coincide and are merged into one."""


class Images(NamedTuple):
    """Images of one source that its receiver hears, nearest first.

    Attributes
    ----------
    distance_m : ndarray, shape (m,)
        Distance from image to receiver, the length of the whole path [m].
    amplitude : ndarray, shape (m,)
        Product of the signed reflection coefficients along the path, without spreading.
    order : ndarray, shape (m,), int64
        Number of reflections.
    walls : ndarray, shape (m, max order), int64
        Walls in the order they are hit; -1 beyond `order`.
    position_m : ndarray, shape (m, 2)
        Image positions [m].
    """

    distance_m: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    order: NDArray[np.int64]
    walls: NDArray[np.int64]
    position_m: NDArray[np.float64]


def visible_images(
    vertices: ArrayLike, position: ArrayLike, order: int, reflection: ArrayLike = 1.0,
    receiver: ArrayLike | None = None,
) -> Images:
    """Image sources up to `order` that are visible from the receiver.

    Parameters
    ----------
    vertices : array_like, shape (n, 2)
        Simple polygon, counter-clockwise [m]; wall i runs from vertex i to vertex i + 1.
    position : array_like, shape (2,)
        Source, strictly inside [m].
    order : int
        Largest number of reflections, >= 1.
    reflection : float or array_like, shape (n,)
        Signed reflection coefficient of each wall.
    receiver : array_like, shape (2,), optional
        Receiver, strictly inside [m]; at the source unless given.

    Raises
    ------
    ValueError
        If the source or the receiver is not inside the polygon.
    """
    corners = np.ascontiguousarray(vertices, dtype=float)
    x, y = np.asarray(position, dtype=float)
    to_x, to_y = (x, y) if receiver is None else np.asarray(receiver, dtype=float)
    coefficients = np.broadcast_to(np.asarray(reflection, dtype=float), (len(corners),))
    polygon = shapely.Polygon(corners)
    for at_x, at_y in ((x, y), (to_x, to_y)):
        if not polygon.contains(shapely.Point(at_x, at_y)):
            raise ValueError(f'({at_x:g}, {at_y:g}) is not inside the polygon')
    capacity, sides = 256, outline_sides(corners, 0.0, is_convex(corners))
    while True:
        found = np.empty((capacity, 3))
        walls = np.full((capacity, order), -1, dtype=np.int64)
        count = trace_images(sides, x, y, to_x, to_y, order, np.inf, 0.0, True, found, walls)
        if count <= capacity:
            break
        capacity = 2 * count
    found, walls = found[:count], walls[:count]
    orders = (walls >= 0).sum(axis=1)
    amplitude = np.where(walls >= 0, coefficients[walls], 1.0).prod(axis=1)
    distance = np.hypot(found[:, 0] - to_x, found[:, 1] - to_y)
    nearest = np.argsort(distance, kind='stable')
    return Images(distance[nearest], amplitude[nearest], orders[nearest], walls[nearest], found[nearest, :2])


@kernel
def trace_images(
    sides: Sides, x: float, y: float, to_x: float, to_y: float, order: int, farthest: float, soft: float, merge: bool,
    found: NDArray[np.float64], sequences: NDArray[np.int64],
) -> int:
    """Write images of (x, y) that are visible from (to_x, to_y) and at most `farthest` away, and their sides.

    `sides` are soft over `soft`; `found` (capacity, 3), x and y of each image and the share of it that no wall in the
    way takes, and `sequences` (capacity, order) are filled. Returns the number of images, which may exceed the
    capacity: then only as many as fit are written. Images that coincide count once if they are to `merge`.
    """
    walls, convex = sides.rows, sides.convex
    n, capacity, count = len(walls), len(found), 0
    size = np.max(np.abs(walls[:, 5] - walls[0, 5]) + np.abs(walls[:, 6] - walls[0, 6]))
    tie = _TIE * size * size
    images, beams, hit, ahead = _levels(x, y, order)
    depth = 1
    while depth > 0:
        ahead[depth] += 1
        if ahead[depth] == (n if depth > 1 else n + 1):
            depth -= 1
            continue
        wall = hit[depth - 1] + ahead[depth]
        wall -= n if wall >= n else 0
        px, py = images[depth - 1, 0], images[depth - 1, 1]
        ax, ay, bx, by = walls[wall, 5] - px, walls[wall, 6] - py, walls[wall, 7] - px, walls[wall, 8] - py
        if depth > 1:
            lit = _LIT
            if not convex:  # only what is beyond the last wall, where the beam enters the room
                last = hit[depth - 1]
                if sides.corners[last, wall] < 0:  # where their ends are soft only
                    continue
                lit, ax, ay, bx, by = _beyond(walls[last, 0], walls[last, 1], walls[last, 2] + soft, px, py,
                                              ax, ay, bx, by)
            if lit == _LIT:
                lit, ax, ay, bx, by = _within(beams[depth - 1, 0], beams[depth - 1, 1], beams[depth - 1, 2],
                                              beams[depth - 1, 3], ax, ay, bx, by, tie)
            if lit != _LIT:
                depth -= lit == _PAST and convex  # so are all that follow
                continue
        away = 2.0 * (walls[wall, 2] - px * walls[wall, 0] - py * walls[wall, 1])
        if away <= 0.0:  # its rays cannot hit this wall from inside
            continue
        # The image mirrored in the wall's line; its rays enter the room through the lit part (a, b).
        dx, dy = away * walls[wall, 0], away * walls[wall, 1]
        qx, qy = px + dx, py + dy
        ax, ay, bx, by = ax - dx, ay - dy, bx - dx, by - dy
        gx, gy = to_x - qx, to_y - qy
        if gx * gx + gy * gy > farthest * farthest:  # further reflections only lengthen the way
            continue
        images[depth, 0], images[depth, 1], hit[depth] = qx, qy, wall
        if bx * gy - by * gx >= -tie and ax * gy - ay * gx <= tie:
            clear = 1.0 if convex else _clear(sides, images, hit, depth, to_x, to_y, soft, max(soft, _TIE * size))
            if clear > 0.0 and not (merge and _is_known(found, min(count, capacity), qx, qy, 1e-7 * size)):
                count = _noted(count, qx, qy, clear, hit, depth, found, sequences)
        if depth < order:
            # Seen from the mirrored image the wall runs the other way round: its end comes first.
            beams[depth, 0], beams[depth, 1], beams[depth, 2], beams[depth, 3] = bx, by, ax, ay
            depth += 1
            ahead[depth] = 0
    return count


@kernel
def _levels(
    x: float, y: float, order: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Return, of each level, room for the image, its beam to the left of the ray (lx, ly) and to the right of (ux, uy),
    the wall that made it, and how many walls on, counter-clockwise, its children have come; the source is the first.
    """
    images, beams = np.empty((order + 1, 2)), np.empty((order + 1, 4))
    images[0, 0], images[0, 1] = x, y
    return images, beams, np.full(order + 1, -1), np.zeros(order + 1, np.int64)


@kernel
def _noted(
    count: int, x: float, y: float, clear: float, hit: NDArray[np.int64], depth: int, found: NDArray[np.float64],
    sequences: NDArray[np.int64],
) -> int:
    """Write an image and its sides, -1 beyond its order, where they fit; returns how many there are with it."""
    if count < len(found):
        found[count, 0], found[count, 1], found[count, 2] = x, y, clear
        for level in range(sequences.shape[1]):
            sequences[count, level] = hit[level + 1] if level < depth else -1
    return count + 1


_LIT, _UNLIT, _PAST = 0, 1, 2


@kernel
def _beyond(
    c: float, s: float, r: float, px: float, py: float, ax: float, ay: float, bx: float, by: float
) -> tuple[int, float, float, float, float]:
    """Return what of a wall from a to b, seen from an image at p, is beyond a line at r with the normal (c, s)."""
    away = r - px * c - py * s
    in_a, in_b = away - ax * c - ay * s, away - bx * c - by * s
    if in_a <= 0.0 and in_b <= 0.0:
        return _UNLIT, ax, ay, bx, by
    if in_a < 0.0 < in_b or in_b < 0.0 < in_a:
        t = in_a / (in_a - in_b)
        at_x, at_y = ax + t * (bx - ax), ay + t * (by - ay)
        if in_a < 0.0:
            return _LIT, at_x, at_y, bx, by
        return _LIT, ax, ay, at_x, at_y
    return _LIT, ax, ay, bx, by


@kernel
def _within(
    lx: float, ly: float, ux: float, uy: float, ax: float, ay: float, bx: float, by: float, tie: float
) -> tuple[int, float, float, float, float]:
    """Return what of a wall from a to b, seen from an image, is in its beam to the left of l and to the right of u.

    A wall is past the beam where all of it lies counter-clockwise of u.
    """
    low_a, low_b = lx * ay - ly * ax, lx * by - ly * bx
    if low_b <= tie and low_a <= tie:
        return _UNLIT, ax, ay, bx, by
    high_a, high_b = ux * ay - uy * ax, ux * by - uy * bx
    if high_a >= -tie and high_b >= -tie:
        return _PAST, ax, ay, bx, by
    if low_a < 0.0 < low_b:
        t = low_a / (low_a - low_b)
        ax, ay = ax + t * (bx - ax), ay + t * (by - ay)
        high_a = ux * ay - uy * ax
    if high_a < 0.0 < high_b:
        t = high_a / (high_a - high_b)
        bx, by = ax + t * (bx - ax), ay + t * (by - ay)
    return _LIT, ax, ay, bx, by


@kernel
def _is_known(found: NDArray[np.float64], count: int, x: float, y: float, near: float) -> bool:
    """Whether one of the images found so far is at (x, y)."""
    for m in range(count):  # noqa: SIM110 - numba compiles no generators
        if abs(found[m, 0] - x) + abs(found[m, 1] - y) <= near:
            return True
    return False


@kernel
def _clear(
    sides: Sides, images: NDArray[np.float64], hit: NDArray[np.int64], depth: int, to_x: float, to_y: float,
    soft: float, near: float,
) -> float:
    """Return the share of a path, traced back from the receiver over the sides hit, that no other wall takes.

    A wall in the way takes all of it or, where it lets waves through, a part; near its ends, shrunk by `soft`, ever
    less over twice that length. A hit that is so `near` behind a wall that it meets in a corner is in the corner.
    """
    walls = sides.rows
    x, y, behind = to_x, to_y, -1
    if walls[hit[depth], 2] <= x * walls[hit[depth], 0] + y * walls[hit[depth], 1]:  # is behind the wall hit last
        return 0.0
    inside, passed = -np.inf, 1.0
    for level in range(depth, -1, -1):
        ahead = hit[level] if level > 0 else -1
        dx, dy = images[level, 0] - x, images[level, 1] - y
        if ahead >= 0:
            towards = dx * walls[ahead, 0] + dy * walls[ahead, 1]
            if towards <= 0.0:
                return 0.0
            step = (walls[ahead, 2] - x * walls[ahead, 0] - y * walls[ahead, 1]) / towards
            dx, dy = step * dx, step * dy
        for wall in range(len(walls)):
            if sides.forward[wall] < 0.0 or _is_side_of(sides, wall, behind) or _is_side_of(sides, wall, ahead):
                continue
            c, s = walls[wall, 0], walls[wall, 1]
            here = walls[wall, 2] - x * c - y * s
            there = here - dx * c - dy * s
            if (behind >= 0 and -near <= here < 0.0 and sides.corners[wall, behind] > 0) or (
                    ahead >= 0 and -near <= there < 0.0 and sides.corners[wall, ahead] > 0):
                continue  # the hit is past the soft end of its own wall
            if (here < 0.0 < there) or (there < 0.0 < here):
                t = here / (here - there)
                along = (y + t * dy) * c - (x + t * dx) * s
                within = min(along - walls[wall, 3], walls[wall, 4] - along) - soft
                if sides.passed[wall] > 0.0:
                    passed *= 1.0 - (1.0 - sides.passed[wall]) * faded(within, soft)
                else:
                    inside = max(inside, within)
        x, y, behind = x + dx, y + dy, ahead
    if inside >= soft:
        return 0.0
    return passed if inside <= -soft else passed * (1.0 - faded(inside, soft))


@kernel
def _is_side_of(sides: Sides, one: int, other: int) -> bool:
    """Return whether two sides are those of one wall; -1 is none."""
    return bool(other >= 0 and sides.wall[one] == sides.wall[other])


@kernel
def faded(inside: float, soft: float) -> float:
    """Return what is left of an echo that hits a wall `inside` its end [m], which is soft over `soft` to each side."""
    if inside >= soft:
        return 1.0
    if inside <= -soft:
        return 0.0
    share = 0.5 * (inside / soft + 1.0)
    return share * share * (3.0 - 2.0 * share)
