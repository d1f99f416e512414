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
        count = trace_images(corners, x, y, to_x, to_y, order, 0.0, found, walls)
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
def trace_images(
    corners: NDArray[np.float64],
    x: float,
    y: float,
    to_x: float,
    to_y: float,
    order: int,
    beyond: float,
    found: NDArray[np.float64],
    walls: NDArray[np.int64],
) -> int:
    """Write images of (x, y) that are visible from (to_x, to_y), and the walls of their paths.

    `found` (capacity, 2) and `walls` (capacity, order) are filled. Returns the number of images, which may exceed the
    capacity: then only as many as fit are written. Walls are hit up to `beyond` [m] past their ends; where that is
    more than 0, images that coincide are not merged.
    """
    n, capacity, count = len(corners), len(found), 0
    size = 0.0
    for i in range(n):
        size = max(size, abs(corners[i, 0] - corners[0, 0]) + abs(corners[i, 1] - corners[0, 1]))
    tie = _TIE * size * size
    images, beams = np.empty((order + 1, 2)), np.empty((order + 1, 4))
    images[0, 0], images[0, 1] = x, y
    hit = np.full(order + 1, -1)
    depth = 1
    while depth > 0:
        hit[depth] += 1
        if hit[depth] == n:
            hit[depth] = -1
            depth -= 1
            continue
        wall = hit[depth]
        if depth > 1 and wall == hit[depth - 1]:
            continue
        px, py = images[depth - 1]
        wx, wy = corners[wall]
        ex, ey = corners[(wall + 1) % n]
        ex, ey = ex - wx, ey - wy
        offset = 2.0 * ((px - wx) * ey - (py - wy) * ex) / (ex * ex + ey * ey)
        if offset >= 0.0:  # its rays cannot hit this wall from inside
            continue
        past = beyond / np.sqrt(ex * ex + ey * ey)
        ax, ay, bx, by = wx - past * ex, wy - past * ey, wx + (1.0 + past) * ex, wy + (1.0 + past) * ey
        if depth > 1:
            # The beam of the parent image: to the left of its ray through (lx, ly), right of that through (ux, uy).
            lx, ly, ux, uy = beams[depth - 1]
            lx, ly, ux, uy = lx - px, ly - py, ux - px, uy - py
            low_a, low_b = lx * (ay - py) - ly * (ax - px), lx * (by - py) - ly * (bx - px)
            if low_b <= tie and low_a <= tie:
                continue
            if low_a < 0.0 < low_b:
                t = low_a / (low_a - low_b)
                ax, ay, low_a = ax + t * (bx - ax), ay + t * (by - ay), 0.0
            high_a, high_b = ux * (ay - py) - uy * (ax - px), ux * (by - py) - uy * (bx - px)
            if high_a >= -tie and high_b >= -tie:
                continue
            if high_a < 0.0 < high_b:
                t = high_a / (high_a - high_b)
                bx, by = ax + t * (bx - ax), ay + t * (by - ay)
        # The image mirrored in the wall's line; its rays enter the room through the lit part (a, b).
        qx, qy = px - offset * ey, py + offset * ex
        images[depth, 0], images[depth, 1] = qx, qy
        # Seen from the mirrored image the wall runs the other way round: its end comes first.
        beams[depth, 0], beams[depth, 1], beams[depth, 2], beams[depth, 3] = bx, by, ax, ay
        left = (bx - qx) * (to_y - qy) - (by - qy) * (to_x - qx)
        right = (ax - qx) * (to_y - qy) - (ay - qy) * (to_x - qx)
        if left >= -tie and right <= tie:
            twin = False
            for m in range(min(count, capacity) if beyond == 0.0 else 0):
                if abs(found[m, 0] - qx) + abs(found[m, 1] - qy) <= 1e-7 * size:
                    twin = True
                    break
            if not twin:
                if count < capacity:
                    found[count, 0], found[count, 1] = qx, qy
                    for level in range(walls.shape[1]):
                        walls[count, level] = hit[level + 1] if level < depth else -1
                count += 1
        if depth < order:
            depth += 1
    return count
