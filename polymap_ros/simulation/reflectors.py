"""Image sources among any straight walls: outlines that are not convex, and seams that let part of the wave through.

Every sequence of walls is tried, and its path traced back with all walls in the way: m walls and order k take about
m^k paths of up to m crossings each, so this is for a handful of walls and low orders. In a convex room
`geometry.image_sources` gives the same images to any order, far quicker.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.jit import kernel

_ASIDE = 1e-7
"""Paths are traced to a place this share of the room's size beside the receiver. A path through a corner, as every
one that a right angle returns to its source, then hits both walls beside the corner, in one order only."""
_DIRECTION_RAD = 1.2345
_TOUCH = 1e-12
"""A wall whose end just touches a ray, within this share of the wall, is hit: rays do not slip through corners."""


@dataclass(frozen=True, eq=False)
class Reflectors:
    """Straight walls, each reflecting on both sides.

    Parameters
    ----------
    starts, ends : ndarray, shape (m, 2)
        Ends of the walls [m].
    reflection : ndarray, shape (m,)
        Signed reflection coefficients.
    transmission : ndarray, shape (m,)
        What is left of the amplitude of a path that crosses the wall; 0: opaque.
    """

    starts: NDArray[np.float64]
    ends: NDArray[np.float64]
    reflection: NDArray[np.float64]
    transmission: NDArray[np.float64]

    @classmethod
    def outline(cls, vertices: ArrayLike, reflection: ArrayLike = 1.0) -> 'Reflectors':
        """The opaque edges of a simple polygon (n, 2) with one coefficient, or one per edge."""
        corners = np.asarray(vertices, dtype=float)
        coefficients = np.array(np.broadcast_to(np.asarray(reflection, dtype=float), (len(corners),)))
        return cls(corners, np.roll(corners, -1, axis=0), coefficients, np.zeros(len(corners)))

    def with_seam(
        self, start: ArrayLike, end: ArrayLike, reflection: float, transmission: float | None = None
    ) -> 'Reflectors':
        """Add a line that reflects part of the wave and lets the rest of its energy through, or what is said."""
        through = np.sqrt(1.0 - reflection**2) if transmission is None else transmission
        return self.beside(Reflectors(np.asarray([start], dtype=float), np.asarray([end], dtype=float),
                                      np.array([reflection]), np.array([through])))

    def beside(self, others: 'Reflectors') -> 'Reflectors':
        """Return these walls and others."""
        return Reflectors(np.vstack((self.starts, others.starts)), np.vstack((self.ends, others.ends)),
                          np.append(self.reflection, others.reflection),
                          np.append(self.transmission, others.transmission))


def heard_images(
    reflectors: Reflectors, position: ArrayLike, order: int, receiver: ArrayLike | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Images of a source that are heard at a receiver.

    Parameters
    ----------
    reflectors : Reflectors
        The walls; the positions are on none of them.
    position : array_like, shape (2,)
        Source [m].
    order : int
        Largest number of reflections, >= 1.
    receiver : array_like, shape (2,), optional
        Receiver [m]; at the source unless given.

    Returns
    -------
    position_m : ndarray, shape (k, 2)
        Image positions, nearest first; their distance from the receiver is the length of the whole path [m].
    amplitude : ndarray, shape (k,)
        Product of the reflection and transmission coefficients along the path, without spreading.
    """
    source = np.asarray(position, dtype=float)
    place = source if receiver is None else np.asarray(receiver, dtype=float)
    found = traced(reflectors, source, order, place)
    nearest = np.argsort(np.linalg.norm(found[:, :2] - place, axis=1), kind='stable')
    return found[nearest, :2], found[nearest, 2]


def traced(
    reflectors: Reflectors, source: NDArray[np.float64], order: int, place: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return x and y of the images heard at a place, their amplitudes and orders, shape (k, 4); see `heard_images`."""
    walls = np.ascontiguousarray(np.stack((reflectors.starts, reflectors.ends), axis=1))
    receiver = beside(walls, place)
    capacity = 64
    while True:
        found = np.empty((capacity, 4))
        count = _trace(walls, reflectors.reflection, reflectors.transmission, source, receiver, order, found)
        if count <= capacity:
            return found[:count]
        capacity = 2 * count


def beside(walls: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where paths to a place among walls, by their ends (m, 2, 2), are traced to."""
    size = float(np.ptp(walls, axis=(0, 1)).max())
    return np.asarray(place + _ASIDE * size * np.array((np.cos(_DIRECTION_RAD), np.sin(_DIRECTION_RAD))))


def straight(reflectors: Reflectors, source: NDArray[np.float64], place: NDArray[np.float64]) -> float:
    """Return what the walls in the way leave of the amplitude straight from a source to a place."""
    walls = np.ascontiguousarray(np.stack((reflectors.starts, reflectors.ends), axis=1))
    return float(passed(walls, reflectors.transmission, source[0], source[1], place[0], place[1], -1, -1))


@kernel
def crossing(
    px: float, py: float, qx: float, qy: float, ax: float, ay: float, bx: float, by: float
) -> tuple[bool, float]:
    """Return whether the way from p to q meets the wall from a to b, and at which share of the way."""
    dx, dy, ex, ey = qx - px, qy - py, bx - ax, by - ay
    across = dx * ey - dy * ex
    if across == 0.0:
        return False, 0.0
    share = ((ax - px) * ey - (ay - py) * ex) / across
    along = ((ax - px) * dy - (ay - py) * dx) / across
    return 0.0 < share < 1.0 and -_TOUCH <= along <= 1.0 + _TOUCH, share


@kernel
def passed(
    walls: NDArray[np.float64], transmission: NDArray[np.float64], px: float, py: float, qx: float, qy: float,
    first: int, last: int,
) -> float:
    """Return what is left of the amplitude on the way from p, on wall `first`, to q, on wall `last`; -1 is no wall."""
    left = 1.0
    for wall in range(len(walls)):
        if wall != first and wall != last:
            met, _ = crossing(px, py, qx, qy, walls[wall, 0, 0], walls[wall, 0, 1], walls[wall, 1, 0],
                               walls[wall, 1, 1])
            if met:
                left *= transmission[wall]
                if left == 0.0:
                    break
    return left


@kernel
def _trace(
    walls: NDArray[np.float64], reflection: NDArray[np.float64], transmission: NDArray[np.float64],
    source: NDArray[np.float64], receiver: NDArray[np.float64], order: int, found: NDArray[np.float64],
) -> int:
    """Write images, amplitudes and orders into `found` (capacity, 4); returns their number, which may be larger."""
    n, count = len(walls), 0
    images = np.empty((order + 1, 2))
    images[0] = source
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
        ax, ay = walls[wall, 0]
        ex, ey = walls[wall, 1, 0] - ax, walls[wall, 1, 1] - ay
        px, py = images[depth - 1]
        offset = 2.0 * ((px - ax) * ey - (py - ay) * ex) / (ex * ex + ey * ey)
        images[depth, 0], images[depth, 1] = px - offset * ey, py + offset * ex
        amplitude = _traced_back(walls, reflection, transmission, images, hit, depth, receiver)
        if amplitude != 0.0:
            if count < len(found):
                found[count, 0], found[count, 1] = images[depth]
                found[count, 2], found[count, 3] = amplitude, depth
            count += 1
        if depth < order:
            depth += 1
    return count


@kernel
def _traced_back(
    walls: NDArray[np.float64], reflection: NDArray[np.float64], transmission: NDArray[np.float64],
    images: NDArray[np.float64], hit: NDArray[np.int64], depth: int, receiver: NDArray[np.float64],
) -> float:
    """Amplitude of the path from the receiver back over the walls hit[depth], ..., hit[1] to the source; 0: none."""
    amplitude = 1.0
    x, y = receiver
    behind = -1
    for level in range(depth, 0, -1):
        wall = hit[level]
        met, share = crossing(x, y, images[level, 0], images[level, 1], walls[wall, 0, 0], walls[wall, 0, 1],
                               walls[wall, 1, 0], walls[wall, 1, 1])
        if not met:
            return 0.0
        next_x, next_y = x + share * (images[level, 0] - x), y + share * (images[level, 1] - y)
        amplitude *= reflection[wall] * passed(walls, transmission, x, y, next_x, next_y, behind, wall)
        if amplitude == 0.0:
            return 0.0
        x, y, behind = next_x, next_y, wall
    return amplitude * passed(walls, transmission, x, y, images[0, 0], images[0, 1], behind, -1)
