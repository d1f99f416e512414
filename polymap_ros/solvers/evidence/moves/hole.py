"""A hole in the outline: the rectangle inside it whose walls were heard best, by first echoes, then by power.

Every candidate line is tried as one side. A rectangle's evidence is that of the feet that pings have on its sides,
those that were heard less those that were not: of a hole nothing else is in the way. What is not rectangular, the
likelihood of power pulls into shape, wall by wall.
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.outline import corners_of, inside
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.oriented_lines import oriented_lines
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.rings import FIRST_WIDTHS, RingFeet, ring_feet
from polymap_ros.solvers.evidence.square_walls import tied_hole
from polymap_ros.solvers.evidence.tuning import PRICE, SEARCH_ORDER

_TRIED_SIDES = 60
"""Lines of each of two rankings that are tried as a side of a hole."""

_SIDES_M = 0.08, 0.6
"""Sides of a rectangle that are tried, from and to."""

_STEP_WIDTHS = 1.0
"""Pulse widths between two of them, and between places along the line."""

_FINER = 0.5, 0.25, 0.125, 0.0625
"""Shares of these steps by which the best are moved, turned and stretched."""

_BEGUN_FROM = 10.0
"""Evidence [nats] of the side from which a rectangle is begun."""

_SCORED, _CLIMBED = 12, 3
"""Rectangles that are scored by power, and how many of them are refined."""


def with_hole(ground: Ground, power: Power) -> Power | None:
    """Return the walls with the hole that is worth most by power, if it is worth its walls' price."""
    fitted = ground.power.fitted(power.walls, power, SEARCH_ORDER)
    if fitted is None:
        return None
    trials = []
    for lines in _rectangles(ground, fitted):
        ground.checkpoint()
        walls = tied_hole(power.walls, lines)
        value = ground.few_value(walls, fitted, 2)
        if np.isfinite(value):
            trials.append((value, walls))
    best, least = None, fitted.value + 4.0 * PRICE
    for _, walls in sorted(trials, key=lambda each: -each[0])[:_CLIMBED]:
        ground.checkpoint()
        rough = ground.power.refine(walls, fitted, 2, 4)
        fine = rough and ground.power.refine(rough.walls, rough, SEARCH_ORDER, 4)
        if fine is not None and fine.value > least:
            best, least = fine, fine.value
    return best


def _rectangles(ground: Ground, fitted: Power) -> list[NDArray[np.float64]]:
    """Return the lines (4, 2) of rectangles, clockwise, those with the most evidence first."""
    data = ground.data
    candidates = oriented_lines(data, fitted.expected, fitted.strength, _TRIED_SIDES).lines
    feet = ring_feet(data, fitted.expected, fitted.strength)
    _, corners = corners_of(fitted.walls.outline)
    step = _STEP_WIDTHS * ground.width_m
    found = np.empty((len(candidates), 6))
    for k, (r, theta) in enumerate(candidates):
        _scan(r, theta, feet, corners, step, *_SIDES_M, found[k])
        if found[k, 0] > 0.0:
            for share in _FINER:
                _climb(feet, corners, share * step, share * ground.width_m / data.extent_m, found[k])
    found = found[found[:, 0] > 0.0]
    chosen: list[NDArray[np.float64]] = []
    for row in found[np.argsort(-found[:, 0], kind='stable')]:
        if len(chosen) == _SCORED:
            break
        if all(np.linalg.norm(_middle(row) - _middle(other)) > ground.width_m for other in chosen):
            chosen.append(row)
    return [_lines(row) for row in chosen]


def rehearse_holes(ground: Ground, outline: NDArray[np.float64]) -> None:
    """Use the kernels once, on a line (r, theta) of an outline (n, 2) and whatever the pings heard."""
    feet, (r, theta) = ring_feet(ground.data, ground.nothing.expected, 1.0), outline[0]
    _, corners = corners_of(outline)
    found = np.zeros(6)
    _scan(r, theta, feet, corners, 1.0, *_SIDES_M, found)
    _climb(feet, corners, 1.0, 1.0, np.array((np.inf, r, theta, 0.0, 1.0, 1.0)))


def _lines(rectangle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lines (4, 2) of a rectangle: its evidence, r, theta, where it starts along that line, width, depth."""
    _, r, theta, start, width, depth = rectangle
    offsets = np.array((r, -start - width, -r - depth, start))
    return np.column_stack((offsets, wrapped(theta + np.array((0.0, -0.5, 1.0, 0.5)) * np.pi)))


def _middle(rectangle: NDArray[np.float64]) -> NDArray[np.float64]:
    _, r, theta, start, width, depth = rectangle
    ahead, along, c, s = r + 0.5 * depth, start + 0.5 * width, np.cos(theta), np.sin(theta)
    return np.array((ahead * c - along * s, ahead * s + along * c))


@kernel
def _scan(
    r: float, theta: float, feet: RingFeet, corners: NDArray[np.float64], step: float, least: float, most: float,
    best: NDArray[np.float64],
) -> None:
    """Fill the rectangle with the most evidence of those with a side on a line."""
    c, s = np.cos(theta), np.sin(theta)
    low, high = np.inf, -np.inf
    for i in range(len(feet.positions)):  # a side that was heard has a foot
        along = feet.positions[i, 1] * c - feet.positions[i, 0] * s
        low, high = min(low, along - most), max(high, along)
    best[:] = 0.0
    sides = int((most - least) / step) + 1
    for at in range(int((high - low) / step)):
        start = low + at * step
        for i in range(sides):
            width = least + i * step
            if _front(r, theta, start, width, feet) < _BEGUN_FROM:
                continue
            for k in range(sides):
                value = _evidence(r, theta, start, width, least + k * step, feet, corners)
                if value > best[0]:
                    best[0], best[1], best[2], best[3] = value, r, theta, start
                    best[4], best[5] = width, least + k * step


@kernel
def _front(r: float, theta: float, start: float, width: float, feet: RingFeet) -> float:
    """Return the evidence of the feet on a part of a line."""
    c, s, total = np.cos(theta), np.sin(theta), 0.0
    for i in range(len(feet.positions)):
        along = feet.positions[i, 1] * c - feet.positions[i, 0] * s - start
        away = r - feet.positions[i, 0] * c - feet.positions[i, 1] * s
        if away > 0.0 and 0.0 <= along <= width:
            q = int(away / feet.cell + 0.5)
            if q < feet.evidence.shape[1]:
                total += feet.evidence[i, q]
    return total


@kernel
def _climb(
    feet: RingFeet, corners: NDArray[np.float64], step: float, turn: float, best: NDArray[np.float64]
) -> None:
    """Move, turn and stretch a rectangle by steps while that adds to its evidence."""
    trial, improved = best.copy(), True
    while improved:
        improved = False
        for number in range(1, 6):
            for by in (1.0, -1.0):
                trial[:] = best
                if number == 2:  # about its own middle
                    middle, ahead = best[3] + 0.5 * best[4], best[1] + 0.5 * best[5]
                    c, s = np.cos(by * turn), np.sin(by * turn)
                    trial[2] += by * turn
                    trial[1] = ahead * c + middle * s - 0.5 * best[5]
                    trial[3] = middle * c - ahead * s - 0.5 * best[4]
                else:
                    trial[number] += by * step
                value = _evidence(trial[1], trial[2], trial[3], trial[4], trial[5], feet, corners)
                if value > best[0]:
                    trial[0] = value
                    best[:] = trial
                    improved = True


@kernel
def _evidence(
    r: float, theta: float, start: float, width: float, depth: float, feet: RingFeet, corners: NDArray[np.float64]
) -> float:
    """Return the evidence of the feet on a rectangle's sides; -1 where it holds a ping or is not inside."""
    if width < feet.near or depth < feet.near:
        return -1.0
    c, s = np.cos(theta), np.sin(theta)
    gap = feet.near / FIRST_WIDTHS  # a pulse's width
    for ahead in (r - gap, r + depth + gap):
        for along in (start - gap, start + width + gap):
            if not inside(corners, ahead * c - along * s, ahead * s + along * c):
                return -1.0
    total, last = 0.0, feet.evidence.shape[1] - 1
    for i in range(len(feet.positions)):
        ahead = feet.positions[i, 0] * c + feet.positions[i, 1] * s - r
        along = feet.positions[i, 1] * c - feet.positions[i, 0] * s - start
        beside, within = 0.0 <= along <= width, 0.0 <= ahead <= depth
        if beside and within:
            return -1.0
        if beside:
            away = -ahead if ahead < 0.0 else ahead - depth
        elif within:
            away = -along if along < 0.0 else along - width
        else:
            continue
        at = away / feet.cell
        q = int(at)
        if q < last:
            total += feet.evidence[i, q] + (at - q) * (feet.evidence[i, q + 1] - feet.evidence[i, q])
    return total
