"""Positions that are off: where each ping was heard, estimated together with the walls.

Errors of a quarter of a wavelength take the phase from the echoes, and some millimetres blur the power of a wall. Yet a
ping hears tens of echoes, far more than the two numbers that its error has. So each ping is moved to where the walls
explain it best, by power as long as there is no phase, and by its waveform then, and the walls are refined in turns. A
Gaussian prior about the reported positions has the deviation of the errors found. What all pings share, a shift and a
turn, is the odometry's to tell: pings and walls are turned and shifted back until no such part of the moves is left.
Later pings join those that were moved: they alone are looked for, and the walls refined.
"""

import dataclasses
from collections.abc import Callable, Generator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.evidence.data import EchoData
from polymap_ros.mapping.evidence.power import Model, PowerLikelihood
from polymap_ros.mapping.evidence.power_search import SEARCH_ORDER
from polymap_ros.mapping.evidence.search import FULL_ORDER, Found, Search
from polymap_ros.mapping.evidence.waveform import Wave, WaveformLikelihood

_POWER_STEPS = ((0.25, 6), (0.06, 5))
"""Steps of the places tried, in cycles of range, and how many to each side: to 1.5 cycles, then finer."""

_WAVE_STEPS = ((0.06, 4), (0.015, 4))
"""The same by phase."""

_IN_PHASE = 0.25
"""Cycles of range by which pings are thought to be off, at first, where the echoes agree in phase without a move."""

_BY_CHANCE = 6.0
"""So many times more than by chance moves have to look like a drift's; noise does in one of some hundred."""

_ROUNDS = 2
Shares = Callable[[EchoData], NDArray[np.float64]]


class Placed(NamedTuple):
    """A search over pings that were moved, what it found, and the standard deviation of the moves in x and y [m]."""

    search: Search
    found: Found
    deviation_m: float


def place(search: Search, found: Found) -> Generator[None, None, Placed | None]:
    """Move the pings and refine the walls in turns; None where even so the echoes do not agree in phase."""
    cycle, reported = search.data.shortest_m, search.data.positions
    better: Found | None = found
    data, deviation = search.data, _IN_PHASE * cycle
    if found.wave is None:
        model, deviation = found.model, cycle
        for step, count in _ROUNDS * _POWER_STEPS:
            model, _ = PowerLikelihood(data).refine(model, SEARCH_ORDER, 6)
            offsets, deviation = yield from _moves(data, reported, _by_power(model), step * cycle, count, deviation)
            offsets, lines = anchored(reported, offsets, model.lines)
            data, model = dataclasses.replace(data, positions=reported + offsets), model.with_lines(lines, model.loss)
        better = yield from search.over(data).settle(model)
    moved = search.over(data)
    for step, count in _ROUNDS * _WAVE_STEPS:
        if better is None or better.wave is None:
            return None
        offsets, deviation = yield from _moves(data, reported, _by_phase(better.wave), step * cycle, count, deviation)
        offsets, lines = anchored(reported, offsets, better.lines)
        moved = search.over(dataclasses.replace(data, positions=reported + offsets))
        better, data = (yield from moved.again(better.moved_to(lines))), moved.data
    better = better and (yield from moved.settle(better.model))
    return None if better is None or better.wave is None else Placed(moved, better, deviation)


def join(search: Search, found: Found, offsets: NDArray[np.float64]) -> Generator[None, None, Placed | None]:
    """Go on with the moves (N, 2) [m] of before, nan for pings that have come since: these are moved to where the
    walls explain them best, and all walls refined.
    """
    assert found.wave is not None, 'pings are moved by phase'
    cycle, reported, new = search.data.shortest_m, search.data.positions, np.isnan(offsets[:, 0])
    offsets = np.where(new[:, None], 0.0, offsets)
    if np.any(new):
        come, deviation = search.data.chosen(new), found.misplaced_m
        by_phase, far = _by_phase(found.wave), deviation > _IN_PHASE * cycle
        tried = [(_by_power(found.model), *each) for each in _POWER_STEPS if far]
        for shares, step, count in (*tried, *((by_phase, *each) for each in _WAVE_STEPS)):
            moves, _ = yield from _moves(come, reported[new], shares, step * cycle, count, deviation)
            come = dataclasses.replace(come, positions=reported[new] + moves)
            offsets[new] = moves
    offsets, lines = anchored(reported, offsets, found.lines)
    moved = search.over(dataclasses.replace(search.data, positions=reported + offsets))
    better = yield from moved.again(found.moved_to(lines))
    deviation = max(float(np.sqrt(np.mean(offsets**2))), _WAVE_STEPS[-1][0] * cycle)
    return None if better is None else Placed(moved, better, deviation)


def _by_power(model: Model) -> Shares:
    return lambda data: PowerLikelihood(data).shares(model, SEARCH_ORDER)


def _by_phase(wave: Wave) -> Shares:
    return lambda data: WaveformLikelihood(data).shares(wave, FULL_ORDER)


def _moves(
    data: EchoData, reported: NDArray[np.float64], shares: Shares, step_m: float, count: int, deviation: float
) -> Generator[None, None, tuple[NDArray[np.float64], float]]:
    """From the reported position of each ping to the best place around that of today, and their deviation."""
    places = step_m * np.arange(-count, count + 1)
    best, offsets = np.full(len(reported), -np.inf), np.zeros_like(reported)
    for dx in places:
        yield
        for dy in places:
            trial = data.positions + (dx, dy)
            value = shares(dataclasses.replace(data, positions=trial))
            value = value - 0.5 * np.sum((trial - reported) ** 2, axis=1) / deviation**2
            better = value > best
            best[better], offsets[better] = value[better], (trial - reported)[better]
    return offsets, max(float(np.sqrt(np.mean(offsets**2))), step_m)


def drift(times: NDArray[np.float64], reported: NDArray[np.float64], offsets: NDArray[np.float64]) -> bool:
    """Whether moves (N, 2) follow a wrong scale, a turn or a shift that grow with time, or each other; noise does not.

    A wrong medium moves pings as a wrong scale does.
    """
    away = reported - reported.mean(axis=0)
    since = ((times - times.mean()) / max(float(np.std(times)), 1e-300))[:, None]
    turning = since * away @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    ways = np.column_stack([way.ravel() for way in (away, turning, since * (1.0, 0.0), since * (0.0, 1.0))])
    left = offsets.ravel() - ways @ np.linalg.lstsq(ways, offsets.ravel(), rcond=None)[0]
    total = max(float(np.sum(offsets**2)), 1e-300)
    followed = 1.0 - float(np.sum(left**2)) / total  # of noise, 4 of 2 N
    correlation = max(float(np.sum(offsets[1:] * offsets[:-1])) / total, 0.0)  # of noise, its square is 1 of 2 N
    return offsets.size * max(followed / 4.0, correlation**2) > _BY_CHANCE


def anchored(
    reported: NDArray[np.float64], offsets: NDArray[np.float64], lines: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Offsets without what they have of a shift and a turn about the middle, and the walls moved back with them."""
    centre, shift = reported.mean(axis=0), offsets.mean(axis=0)
    across = (reported - centre) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    turn = float(np.sum(across * offsets)) / max(float(np.sum(across**2)), 1e-300)
    c, s = np.cos(lines[:, 1]), np.sin(lines[:, 1])
    lever = c * centre[1] - s * centre[0]
    r = lines[:, 0] - c * shift[0] - s * shift[1] - turn * lever
    return offsets - shift - turn * across, np.column_stack((r, lines[:, 1] - turn))
