r"""Paths between the walls of an outline: their lengths, and the derivatives by walls and by the sensor's place.

A wall's end is soft: a path that hits it a distance s inside its end counts by w(s), which rises smoothly from 0 at
-`soft` over one half at the end itself to 1 at `soft`, w(s) + w(-s) = 1; a path counts by the least of its hits.
With hard ends an echo would appear or vanish whole as a wall moves by a micrometre, and the likelihood jump with it. At
a right-angled corner two images stand in one place, each of which ends there, and together they count once, as they
have to: twice where the angle is smaller, not at all where it is larger.

Where there are floor and ceiling (`geometry.storey`), each path is there once for each of their images, too.
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.curved import from_round_corners, over_curves
from polymap_ros.geometry.image_sources import faded, trace_images
from polymap_ros.geometry.path_room import Paths
from polymap_ros.geometry.sides import Sides
from polymap_ros.jit import kernel, within_kernels


@kernel
def first_order(
    r: float, c: float, s: float, x: float, y: float, apart_x: float, apart_y: float, up: float
) -> tuple[float, float]:
    """Return half the length of the echo straight from a line, and where along the line it is reflected [m].

    The line is x c + y s = r; (x, y) is half way between emitter and receiver, and (apart_x, apart_y, up) leads from
    one to the other. Half the length is 0 where the line is not in front of both.
    """
    away, along = r - x * c - y * s, y * c - x * s
    inwards, aside = apart_x * c + apart_y * s, apart_y * c - apart_x * s
    if away <= 0.5 * abs(inwards):
        return 0.0, along
    if aside == 0.0 and up == 0.0:
        return away, along
    return np.sqrt(away * away + 0.25 * (aside * aside + up * up)), along + 0.25 * aside * inwards / away


@kernel
def first_orders(
    line: NDArray[np.float64], positions: NDArray[np.float64], baselines: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return `first_order` of a line (r, theta) for every ping, shapes (N,)."""
    half, along = np.empty(len(positions)), np.empty(len(positions))
    c, s = np.cos(line[1]), np.sin(line[1])
    for i in range(len(positions)):
        half[i], along[i] = first_order(line[0], c, s, positions[i, 0], positions[i, 1], baselines[i, 0],
                                        baselines[i, 1], baselines[i, 2])
    return half, along


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
    sides: Sides, ends: NDArray[np.float64], order: int, range_max: float, soft: float, derive: bool,
    storey: NDArray[np.float64], paths: Paths,
) -> int:
    """Fill `paths` with those audible from emitter to receiver with `half` up to `range_max`.

    `sides` are soft over `soft`; `ends` (5,) are x and y of emitter and receiver, and the height between them; `slopes`
    and `moves` are left out unless to `derive`; `storey` are the images of `Storey`, its first row the emitter. Returns
    the number of paths.
    """
    rows, walls, images, slopes, moves = sides.rows, paths.walls, paths.images, paths.slopes, paths.moves
    up, count = 0.25 * ends[4] * ends[4], 0
    farthest = 2.0 * np.sqrt(max(range_max * range_max - up, 0.0))
    if len(rows) > 0:
        count = min(len(images), trace_images(
            sides, ends[0], ends[1], ends[2], ends[3], order, farthest, soft, False, images, walls))
    chain = np.empty((order + 1, 2))
    kept = 0
    if len(sides.bend) > 0:
        kept, count = over_curves(sides, ends, soft, count, paths), 0
    for m in range(count):
        x, y = images[m, 0] - ends[2], images[m, 1] - ends[3]
        flat = 0.5 * np.sqrt(x * x + y * y)
        d = np.sqrt(flat * flat + up)
        hits = 0
        while hits < order and walls[m, hits] >= 0:
            walls[kept, hits] = walls[m, hits]
            hits += 1
        for level in range(hits, order):
            walls[kept, level] = -1
        weight = images[m, 2] * _back_traced(
            rows, sides.forward, ends, hits, soft, derive, walls[kept], chain, slopes[kept], moves[kept])
        if weight > 0.0:
            if derive and up > 0.0:
                slopes[kept, :hits] *= flat / d
                moves[kept] *= flat / d
            paths.half[kept], paths.hits[kept], paths.weight[kept] = d, hits, weight
            paths.bounces[kept] = 0
            for level in range(0 if sides.convex else hits):
                walls[kept, level] = sides.wall[walls[kept, level]]
            kept += 1
    if len(sides.round) > 0:
        kept = from_round_corners(sides, ends, range_max, soft, kept, paths)
    return kept if len(storey) == 1 else _with_storey(storey, ends, order, range_max, derive, kept, paths)


@kernel
def _with_storey(
    storey: NDArray[np.float64], ends: NDArray[np.float64], order: int, range_max: float, derive: bool, flat: int,
    paths: Paths,
) -> int:
    """Add to the first paths, `flat` in number, those that floor and ceiling make of them, and of the way straight on.

    The square of half a path's length is that of the flat one and of half the height between its ends.
    """
    count, up = flat, 0.25 * ends[4] * ends[4]
    x, y = ends[2] - ends[0], ends[3] - ends[1]
    for image in range(1, len(storey)):
        bounces, weight = int(storey[image, 2]), storey[image, 1]
        higher = 0.25 * (ends[4] - storey[image, 0]) ** 2
        half = np.sqrt(0.25 * (x * x + y * y) + higher)
        if bounces <= order and half <= range_max and count < len(paths.half):
            paths.half[count], paths.hits[count], paths.bounces[count], paths.weight[count] = half, 0, bounces, weight
            paths.walls[count] = -1
            paths.moves[count, 0], paths.moves[count, 1] = -0.25 * x / half, -0.25 * y / half
            paths.moves[count, 2], paths.moves[count, 3] = 0.25 * x / half, 0.25 * y / half
            count += 1
        for m in range(flat):
            half = np.sqrt(paths.half[m] * paths.half[m] - up + higher)
            if paths.hits[m] + bounces <= order and half <= range_max and count < len(paths.half):
                paths.half[count], paths.hits[count], paths.bounces[count] = half, paths.hits[m], bounces
                paths.weight[count] = weight * paths.weight[m]
                paths.walls[count] = paths.walls[m]
                if derive:
                    paths.slopes[count] = paths.half[m] / half * paths.slopes[m]
                    paths.moves[count] = paths.half[m] / half * paths.moves[m]
                count += 1
    return count


@within_kernels
def _back_traced(
    walls: NDArray[np.float64], forward: NDArray[np.float64], ends: NDArray[np.float64], hits: int, soft: float,
    derive: bool, sequence: NDArray[np.int64], chain: NDArray[np.float64], slopes: NDArray[np.float64],
    moves: NDArray[np.float64],
) -> float:
    """Return a path's weight; fill, if to `derive`, the derivatives of half its length.

    A path is shortest over its points of reflection b, so only what moves by itself counts: a wall along its normal n,
    by dr - dtheta (b . t) at b, t along the wall, for which half the length grows by cos(incidence) per unit; and
    emitter and receiver along the legs that end there, by half of which it grows.
    """
    chain[0, 0], chain[0, 1] = ends[0], ends[1]
    for level in range(hits):
        wall = sequence[level]
        c, s = walls[wall, 0], walls[wall, 1]
        step = 2.0 * (walls[wall, 2] - (chain[level, 0] * c + chain[level, 1] * s))
        chain[level + 1, 0], chain[level + 1, 1] = chain[level, 0] + step * c, chain[level, 1] + step * s
    bx, by = ends[2], ends[3]
    inside = np.inf
    for level in range(hits, 0, -1):
        wall = sequence[level - 1]
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
            slopes[level - 1, 0] = forward[wall] * cosine
            slopes[level - 1, 1] = -cosine * along
        inside = min(inside, along - walls[wall, 3], walls[wall, 4] - along)
    if derive:
        moves[0], moves[1] = _half_of_unit(ends[0] - bx, ends[1] - by)
        moves[2], moves[3] = _half_of_unit(ends[2] - chain[hits, 0], ends[3] - chain[hits, 1])
    return faded(inside, soft)


@kernel
def _half_of_unit(x: float, y: float) -> tuple[float, float]:
    """Return half of the unit vector along (x, y)."""
    length = 2.0 * np.sqrt(x * x + y * y)
    return x / length, y / length
