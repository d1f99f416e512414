"""Visible image sources I(x, M) of eq. (1) in a convex polygon, for a receiver at the source or beside it.

Every image carries the beam of its rays: the part of its last wall that they light. A further wall is hit where
it lies in that beam, so the search visits visible images and their children only, to any order and exactly.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
        Convex polygon, counter-clockwise [m]; wall i runs from vertex i to vertex i + 1.
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
    ends = np.roll(corners, -1, axis=0)
    for at_x, at_y in ((x, y), (to_x, to_y)):
        side = (ends - corners)[:, 0] * (at_y - corners[:, 1]) - (ends - corners)[:, 1] * (at_x - corners[:, 0])
        if not np.all(side > 0.0):
            raise ValueError(f'({at_x:g}, {at_y:g}) is not inside the polygon')
    capacity = 256
    while True:
        found = np.empty((capacity, 2))
        walls = np.full((capacity, order), -1, dtype=np.int64)
        count = trace_images(walls_of(corners, 0.0), x, y, to_x, to_y, order, np.inf, True, found, walls)
        if count <= capacity:
            break
        capacity = 2 * count
    found, walls = found[:count], walls[:count]
    orders = (walls >= 0).sum(axis=1)
    amplitude = np.where(walls >= 0, coefficients[walls], 1.0).prod(axis=1)
    distance = np.hypot(found[:, 0] - to_x, found[:, 1] - to_y)
    nearest = np.argsort(distance, kind='stable')
    return Images(distance[nearest], amplitude[nearest], orders[nearest], walls[nearest], found[nearest])


@kernel
def walls_of(corners: NDArray[np.float64], beyond: float) -> NDArray[np.float64]:
    """The walls of a convex polygon (n, 2), counter-clockwise, as rows for `trace_images`, shape (n, 9).

    cos(theta) and sin(theta) of the outward normal, r; where the wall starts and ends along itself, counted from the
    foot of the origin; x and y of its start and of its end, each moved outwards by `beyond` [m].
    """
    n = len(corners)
    walls = np.empty((n, 9))
    for i in range(n):
        x, y = corners[i, 0], corners[i, 1]
        j = i + 1 if i + 1 < n else 0
        ex, ey = corners[j, 0] - x, corners[j, 1] - y
        length = np.sqrt(ex * ex + ey * ey)
        ex, ey = ex / length, ey / length
        walls[i, 0], walls[i, 1], walls[i, 2] = ey, -ex, x * ey - y * ex
        walls[i, 3] = x * ex + y * ey
        walls[i, 4] = walls[i, 3] + length
        walls[i, 5], walls[i, 6] = x - beyond * ex, y - beyond * ey
        walls[i, 7], walls[i, 8] = x + (length + beyond) * ex, y + (length + beyond) * ey
    return walls


@kernel
def trace_images(
    walls: NDArray[np.float64],
    x: float,
    y: float,
    to_x: float,
    to_y: float,
    order: int,
    farthest: float,
    merge: bool,
    found: NDArray[np.float64],
    sequences: NDArray[np.int64],
) -> int:
    """Write images of (x, y) that are visible from (to_x, to_y) and at most `farthest` away, and their walls.

    `walls` are those of `walls_of`; `found` (capacity, 2) and `sequences` (capacity, order) are filled. Returns the
    number of images, which may exceed the capacity: then only as many as fit are written. Images that coincide count
    once if they are to `merge`.
    """
    n, capacity, count = len(walls), len(found), 0
    size = 0.0
    for i in range(n):
        size = max(size, abs(walls[i, 5] - walls[0, 5]) + abs(walls[i, 6] - walls[0, 6]))
    tie = _TIE * size * size
    # Of each level: the image, its beam to the left of the ray (lx, ly) and to the right of (ux, uy), the wall that
    # made it, and how many walls on, counter-clockwise, its children have come.
    images, beams = np.empty((order + 1, 2)), np.empty((order + 1, 4))
    hit, ahead = np.full(order + 1, -1), np.zeros(order + 1, np.int64)
    images[0, 0], images[0, 1] = x, y
    depth = 1
    while depth > 0:
        ahead[depth] += 1
        if ahead[depth] == (n if depth > 1 else n + 1):
            depth -= 1
            continue
        wall = hit[depth - 1] + ahead[depth]
        if wall >= n:
            wall -= n
        px, py = images[depth - 1, 0], images[depth - 1, 1]
        ax, ay, bx, by = walls[wall, 5] - px, walls[wall, 6] - py, walls[wall, 7] - px, walls[wall, 8] - py
        if depth > 1:
            lx, ly, ux, uy = beams[depth - 1, 0], beams[depth - 1, 1], beams[depth - 1, 2], beams[depth - 1, 3]
            low_a, low_b = lx * ay - ly * ax, lx * by - ly * bx
            if low_b <= tie and low_a <= tie:
                continue
            high_a, high_b = ux * ay - uy * ax, ux * by - uy * bx
            if high_a >= -tie and high_b >= -tie:  # past the beam, and so are all that follow
                depth -= 1
                continue
            if low_a < 0.0 < low_b:
                t = low_a / (low_a - low_b)
                ax, ay = ax + t * (bx - ax), ay + t * (by - ay)
                high_a = ux * ay - uy * ax
            if high_a < 0.0 < high_b:
                t = high_a / (high_a - high_b)
                bx, by = ax + t * (bx - ax), ay + t * (by - ay)
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
        if bx * gy - by * gx >= -tie and ax * gy - ay * gx <= tie:
            twin = False
            for m in range(min(count, capacity) if merge else 0):
                if abs(found[m, 0] - qx) + abs(found[m, 1] - qy) <= 1e-7 * size:
                    twin = True
                    break
            if not twin:
                if count < capacity:
                    found[count, 0], found[count, 1] = qx, qy
                    for level in range(1, depth):
                        sequences[count, level - 1] = hit[level]
                    sequences[count, depth - 1] = wall
                    sequences[count, depth:] = -1
                count += 1
        if depth < order:
            hit[depth] = wall
            images[depth, 0], images[depth, 1] = qx, qy
            # Seen from the mirrored image the wall runs the other way round: its end comes first.
            beams[depth, 0], beams[depth, 1], beams[depth, 2], beams[depth, 3] = bx, by, ax, ay
            depth += 1
            ahead[depth] = 0
    return count
