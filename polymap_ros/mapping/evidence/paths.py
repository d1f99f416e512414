r"""Paths between the walls of a convex polygon given by its lines: corners, lengths and their derivatives.

A wall's end is soft: a path that hits it a distance s inside its end counts by w(s), which rises smoothly from 0 at
-`soft` over one half at the end itself to 1 at `soft`, w(s) + w(-s) = 1; a path counts by the least of its hits.
With hard ends an echo would appear or vanish whole as a wall moves by a micrometre, and the likelihood jump with it. At
a right-angled corner two images stand in one place, each of which ends there, and together they count once, as they
have to: twice where the angle is smaller, not at all where it is larger.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.image_sources import trace_images
from polymap_ros.jit import kernel

CAPACITY = 512
"""Paths kept per ping: an octagon of order 5 has about 110."""

_SHORTEST = 1e-4
"""Shortest edge relative to the polygon's size: a shorter one has no foot of any ping on it."""


@kernel
def corners_of(lines: NDArray[np.float64], shortest: float = 0.0) -> tuple[bool, NDArray[np.float64]]:
    """Corners of the polygon whose edges are all of `lines` (n, 2), sorted by theta; corner i starts edge i.

    The answer's first part is False where the lines bound no polygon or where one of them makes no edge of it, or one
    no longer than `shortest` [m].
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
        if length <= max(_SHORTEST * size, shortest):
            return False, corners
    return True, corners


class Paths(NamedTuple):
    """Room for the paths of one ping.

    Attributes
    ----------
    half : ndarray, shape (capacity,)
        Half the path's length [m].
    weight : ndarray, shape (capacity,)
        What the ends of its walls leave of it, in (0, 1].
    hits : ndarray, shape (capacity,), int64
        Number of reflections.
    walls : ndarray, shape (capacity, order), int64
        Walls in the order they are hit; -1 beyond `hits`.
    slopes : ndarray, shape (capacity, order, 2)
        Derivatives of `half` by r and theta of each of these walls.
    images : ndarray, shape (capacity, 2)
        Image of the emitter [m].
    """

    half: NDArray[np.float64]
    weight: NDArray[np.float64]
    hits: NDArray[np.int64]
    walls: NDArray[np.int64]
    slopes: NDArray[np.float64]
    images: NDArray[np.float64]


@kernel
def room_for_paths(order: int) -> Paths:
    """Room for paths of up to so many reflections."""
    return Paths(np.empty(CAPACITY), np.empty(CAPACITY), np.empty(CAPACITY, np.int64),
                 np.empty((CAPACITY, order), np.int64), np.empty((CAPACITY, order, 2)), np.empty((CAPACITY, 2)))


@kernel
def falloff(half: float, exponent: float) -> float:
    """half**-exponent; what a plate and a volume take is had without a general power, which costs as much as a path."""
    if exponent == 0.5:
        return 1.0 / float(np.sqrt(half))
    if exponent == 1.0:
        return 1.0 / half
    return float(half**-exponent)


@kernel
def trace_paths(
    walls: NDArray[np.float64], ends: NDArray[np.float64], order: int, range_max: float, soft: float, derive: bool,
    paths: Paths,
) -> int:
    """Fill `paths` with those audible from emitter to receiver with `half` up to `range_max`.

    `walls` are those of `walls_of` with their ends moved by `soft`; `ends` (5,) are x and y of emitter and receiver,
    and the height between them; `slopes` are left out unless to `derive`. Returns the number of paths.
    """
    up = 0.25 * ends[4] * ends[4]
    farthest = 2.0 * np.sqrt(max(range_max * range_max - up, 0.0))
    count = min(trace_images(walls, ends[0], ends[1], ends[2], ends[3], order, farthest, False, paths.images,
                             paths.walls), len(paths.images))
    chain = np.empty((order + 1, 2))
    kept = 0
    for m in range(count):
        x, y = paths.images[m, 0] - ends[2], paths.images[m, 1] - ends[3]
        flat = 0.5 * np.sqrt(x * x + y * y)
        d = np.sqrt(flat * flat + up)
        hits = 0
        while hits < order and paths.walls[m, hits] >= 0:
            paths.walls[kept, hits] = paths.walls[m, hits]
            hits += 1
        for level in range(hits, order):
            paths.walls[kept, level] = -1
        weight = _back_traced(walls, ends, hits, soft, derive, kept, chain, paths)
        if weight > 0.0:
            for level in range(hits if derive and up > 0.0 else 0):
                paths.slopes[kept, level, 0] *= flat / d
                paths.slopes[kept, level, 1] *= flat / d
            paths.half[kept], paths.hits[kept], paths.weight[kept] = d, hits, weight
            kept += 1
    return kept


@kernel
def _back_traced(
    walls: NDArray[np.float64], ends: NDArray[np.float64], hits: int, soft: float, derive: bool, path: int,
    chain: NDArray[np.float64], paths: Paths,
) -> float:
    """A path's weight; fills, if to `derive`, the derivatives of half its length by r and theta of each wall it hits.

    A path is shortest over its points of reflection b, so only the wall's own motion along its normal n counts:
    half the length grows by cos(incidence) per unit of it, and b moves by dr - dtheta (b . t), t along the wall.
    """
    chain[0, 0], chain[0, 1] = ends[0], ends[1]
    for level in range(hits):
        wall = paths.walls[path, level]
        c, s = walls[wall, 0], walls[wall, 1]
        step = 2.0 * (walls[wall, 2] - (chain[level, 0] * c + chain[level, 1] * s))
        chain[level + 1, 0], chain[level + 1, 1] = chain[level, 0] + step * c, chain[level, 1] + step * s
    bx, by = ends[2], ends[3]
    inside = np.inf
    for level in range(hits, 0, -1):
        wall = paths.walls[path, level - 1]
        c, s = walls[wall, 0], walls[wall, 1]
        dx, dy = chain[level, 0] - bx, chain[level, 1] - by
        towards = dx * c + dy * s
        if towards <= 0.0:  # past the end of another wall
            return 0.0
        step = (walls[wall, 2] - (bx * c + by * s)) / towards
        bx, by = bx + step * dx, by + step * dy
        along = by * c - bx * s
        if derive:
            cosine = towards / np.sqrt(dx * dx + dy * dy)
            paths.slopes[path, level - 1, 0] = cosine
            paths.slopes[path, level - 1, 1] = -cosine * along
        inside = min(inside, along - walls[wall, 3], walls[wall, 4] - along)
    if inside >= soft:
        return 1.0
    if inside <= -soft:
        return 0.0
    share = 0.5 * (inside / soft + 1.0)
    return share * share * (3.0 - 2.0 * share)
