"""Paths over round walls in a convex outline, and which of the outline's own paths these hide.

A path goes from place to circle, from circle to circle, and on to a place, each way over straight walls. Which walls a
way may lead over is what images show from points all round a circle; where it touches circles follows from the law of
reflection, one circle after the other until all stand still. `simulation.round_paths` finds the same by trying every
sequence of walls, and by a path's shortest length.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.image_sources import trace_images
from polymap_ros.geometry.round_legs import STILL_RAD, leg_share, over_walls, reflected_at, way_size
from polymap_ros.geometry.sides import Sides
from polymap_ros.jit import kernel

_RIM_POINTS = 12
"""Points round a circle from which walls are looked for: in four plates with one or two of 0.15 to 0.4 m (even seeds)
no path was missed."""
_RIM_RADII = 1.001
"""Radii at which they are."""
_MOST_WAYS = 256
"""Sequences of walls between a place and a circle, at most."""
_MOST_BENDS = 2
"""Circles of a path, at most: a third leaves a fifteenth of the amplitude."""
_CIRCLE_SWEEPS = 60
"""Rounds over the circles of a path, at most."""


class RoundEchoes(NamedTuple):
    """Paths, in the order of the pings.

    Attributes
    ----------
    ping, order : ndarray, shape (m,), int64
        Number of the ping, and of the reflections.
    half : ndarray, shape (m,)
        Half the length [m].
    strength : ndarray, shape (m,)
        What walls and bends leave of the amplitude, beside the spreading of a path of that length.
    """

    ping: NDArray[np.int64]
    order: NDArray[np.int64]
    half: NDArray[np.float64]
    strength: NDArray[np.float64]


def round_echoes(
    sides: Sides, reflection: NDArray[np.float64], circles: NDArray[np.float64], ends: NDArray[np.float64], order: int,
    range_max_m: float,
) -> RoundEchoes:
    """Return the paths over circles.

    Parameters
    ----------
    sides : Sides
        Of a convex outline.
    reflection : ndarray, shape (n,)
        Signed coefficients of its walls.
    circles : ndarray, shape (c, 4)
        Centre, radius [m] and signed reflection.
    ends : ndarray, shape (N, 5)
        x and y of emitter and of receiver, and the height between them [m].
    order : int
        Reflections of a path, at most.
    range_max_m : float
        Half the length of a path, at most.
    """
    mono = bool(np.all(ends[:, :2] == ends[:, 2:4]))
    farthest = 2.0 * range_max_m
    coming = _ways(sides, np.ascontiguousarray(ends[:, :2]), circles, order, farthest)
    going = coming if mono else _ways(sides, np.ascontiguousarray(ends[:, 2:4]), circles, order, farthest)
    between = _between(sides, circles, order, farthest)
    capacity = 256 * len(ends)
    while True:
        ping, hits, half, strength = (np.empty(capacity, np.int64), np.empty(capacity, np.int64), np.empty(capacity),
                                      np.empty(capacity))
        count = _follow(sides.rows, reflection, circles, ends, order, farthest, *coming, *going, *between,
                        ping, hits, half, strength)
        if count <= capacity:
            return RoundEchoes(ping[:count], hits[:count], half[:count], strength[:count])
        capacity = 2 * count


@kernel
def _ways(
    sides: Sides, places: NDArray[np.float64], circles: NDArray[np.float64], order: int, farthest: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the sequences of walls (N, c, m, order) from places to circles, -1 for no wall, and how many (N, c)."""
    found = np.full((len(places), len(circles), _MOST_WAYS, order), -1)
    count = np.zeros((len(places), len(circles)), np.int64)
    images, sequences = np.empty((_MOST_WAYS, 3)), np.empty((_MOST_WAYS, order), np.int64)
    for i in range(len(places)):
        for c in range(len(circles)):
            count[i, c] = 1  # straight
            for k in range(_RIM_POINTS):
                turn = 2.0 * np.pi * k / _RIM_POINTS
                x = circles[c, 0] + _RIM_RADII * circles[c, 2] * np.cos(turn)
                y = circles[c, 1] + _RIM_RADII * circles[c, 2] * np.sin(turn)
                met = min(trace_images(sides, places[i, 0], places[i, 1], x, y, order - 1, farthest, 0.0, False,
                                       images, sequences[:, :order - 1]), _MOST_WAYS)
                count[i, c] = _gather(found[i, c], count[i, c], sequences, met, order - 1)
    return found, count


@kernel
def _gather(
    known: NDArray[np.int64], count: int, sequences: NDArray[np.int64], met: int, size: int
) -> int:
    """Add sequences that are not known yet; returns how many there are then."""
    for m in range(met):
        new = True
        for k in range(count):
            same = True
            for level in range(size):
                if known[k, level] != sequences[m, level]:
                    same = False
                    break
            if same:
                new = False
                break
        if new and count < len(known):
            known[count, :size] = sequences[m, :size]
            count += 1
    return count


@kernel
def _between(
    sides: Sides, circles: NDArray[np.float64], order: int, farthest: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the same from circle to circle, (c, c, m, order) and (c, c)."""
    found = np.full((len(circles), len(circles), _MOST_WAYS, order), -1)
    count = np.zeros((len(circles), len(circles)), np.int64)
    images, sequences = np.empty((_MOST_WAYS, 3)), np.full((_MOST_WAYS, order), -1)
    for b in range(len(circles)):
        for c in range(len(circles)):
            count[b, c] = b != c
            for k in range(_RIM_POINTS * _RIM_POINTS):
                one = 2.0 * np.pi / _RIM_POINTS * (k // _RIM_POINTS)
                other = 2.0 * np.pi / _RIM_POINTS * (k % _RIM_POINTS)
                reach, far = _RIM_RADII * circles[b, 2], _RIM_RADII * circles[c, 2]
                met = min(trace_images(
                    sides, circles[b, 0] + reach * np.cos(one), circles[b, 1] + reach * np.sin(one),
                    circles[c, 0] + far * np.cos(other), circles[c, 1] + far * np.sin(other), max(order - 2, 1),
                    farthest, 0.0, False, images, sequences[:, :max(order - 2, 1)]), _MOST_WAYS)
                count[b, c] = _gather(found[b, c], count[b, c], sequences, met, max(order - 2, 1))
    return found, count


@kernel
def _follow(
    rows: NDArray[np.float64], reflection: NDArray[np.float64], circles: NDArray[np.float64],
    ends: NDArray[np.float64], order: int, farthest: float, coming: NDArray[np.int64], comings: NDArray[np.int64],
    going: NDArray[np.int64], goings: NDArray[np.int64], between: NDArray[np.int64], betweens: NDArray[np.int64],
    ping: NDArray[np.int64], hits: NDArray[np.int64], half: NDArray[np.float64], strength: NDArray[np.float64],
) -> int:
    """Fill the columns of `RoundEchoes`; returns their number, which may be larger.

    `chosen` has the number of the way to each circle of a path, the last but one that of the way from the last circle.
    """
    count, most = 0, order + 1
    hit = np.full(most, -1)  # circles
    chosen = np.full(most + 1, -1)
    legs = np.full((most + 1, order), -1)
    turns, places = np.empty(most), np.empty((most + 2, 2))
    for i in range(len(ends)):
        depth = 0
        hit[0], chosen[0], spent = 0, -1, np.zeros(most + 1, np.int64)
        while depth >= 0:
            # The next way to this circle, or the next circle.
            chosen[depth] += 1
            before = hit[depth - 1] if depth > 0 else -1
            ways = comings[i, hit[depth]] if depth == 0 else betweens[before, hit[depth]]
            if chosen[depth] >= ways:
                hit[depth] += 1
                chosen[depth] = -1
                if hit[depth] == len(circles):
                    depth -= 1
                continue
            legs[depth] = coming[i, hit[depth], chosen[depth]] if depth == 0 else (
                between[before, hit[depth], chosen[depth]])
            size = way_size(legs[depth])
            spent[depth] = (spent[depth - 1] if depth > 0 else 0) + size + 1
            if spent[depth] > order:
                continue
            for last in range(goings[i, hit[depth]]):
                away = going[i, hit[depth], last]
                size = way_size(away)
                if spent[depth] + size > order:
                    continue
                for level in range(size):  # from the circle on
                    legs[depth + 1, level] = away[size - 1 - level]
                legs[depth + 1, size:] = -1
                length, left = _path(rows, reflection, circles, ends[i], hit[:depth + 1], legs, turns, places)
                if left != 0.0 and length <= farthest:
                    if count < len(ping):
                        ping[count], hits[count] = i, spent[depth] + size
                        half[count] = 0.5 * np.sqrt(length * length + ends[i, 4] ** 2)
                        strength[count] = left
                    count += 1
            if spent[depth] < order and depth + 1 < _MOST_BENDS:
                depth += 1
                hit[depth], chosen[depth] = 0, -1
    return count


@kernel
def _path(
    rows: NDArray[np.float64], reflection: NDArray[np.float64], circles: NDArray[np.float64], end: NDArray[np.float64],
    hit: NDArray[np.int64], legs: NDArray[np.int64], turns: NDArray[np.float64], places: NDArray[np.float64],
) -> tuple[float, float]:
    """Return length and strength of a path over circles by ways; a strength of 0 where there is no such path."""
    count = len(hit)
    places[0], places[count + 1] = end[:2], end[2:4]
    for k in range(count):
        places[k + 1] = circles[hit[k], :2]
        turns[k] = np.inf
    for _ in range(_CIRCLE_SWEEPS):
        moved = 0.0
        for k in range(count):
            ax, ay = over_walls(rows, legs[k], places[k, 0], places[k, 1], False)
            bx, by = over_walls(rows, legs[k + 1], places[k + 2, 0], places[k + 2, 1], True)
            lit, turn = reflected_at(circles[hit[k]], ax, ay, bx, by)
            if not lit:
                return 0.0, 0.0
            moved = max(moved, abs(turn - turns[k]))
            turns[k] = turn
            places[k + 1, 0] = circles[hit[k], 0] + circles[hit[k], 2] * np.cos(turn)
            places[k + 1, 1] = circles[hit[k], 1] + circles[hit[k], 2] * np.sin(turn)
        if moved < STILL_RAD:
            break
    total, front, left, first = 0.0, 0.0, 1.0, 0.0
    for k in range(count + 1):
        share = leg_share(rows, reflection, circles, legs[k], places[k], places[k + 1], hit[k - 1] if k > 0 else -1,
                     hit[k] if k < count else -1)
        if share == 0.0:
            return 0.0, 0.0
        x, y = over_walls(rows, legs[k], places[k, 0], places[k, 1], False)
        dx, dy = x - places[k + 1, 0], y - places[k + 1, 1]
        way = np.sqrt(dx * dx + dy * dy)
        if k == 0:
            first = way
        else:
            left *= front / (front + way)
        left *= share * share
        total, front = total + way, front + way
        if share < 0.0:
            first = -first  # the sign of all
        if k < count:
            circle = circles[hit[k]]
            facing = (dx * np.cos(turns[k]) + dy * np.sin(turns[k])) / way
            front = front * circle[2] * facing / (circle[2] * facing + 2.0 * front)
            left *= circle[3] * circle[3]
            if circle[3] < 0.0:
                first = -first
    return total, np.sign(first) * np.sqrt(left * total / abs(first))
