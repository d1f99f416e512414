"""Positions that are off: where each ping was heard, estimated together with the walls.

Errors of a quarter of a wavelength take the phase from the echoes, and some millimetres blur the power of a wall. Yet a
ping hears tens of echoes, far more than the two numbers that its error has. So each ping is moved to where the walls
explain it best, by power as long as there is no phase, and by its waveform then, and the walls are refined in turns. A
Gaussian prior about the reported positions has the deviation of the errors found. What all pings share, a shift and a
turn, is the odometry's to tell: pings and walls are turned and shifted back until no such part of the moves is left.
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
    model, data, deviation = found.model, search.data, search.data.shortest_m
    for step, count in _ROUNDS * _POWER_STEPS:
        model, _ = PowerLikelihood(data).refine(model, SEARCH_ORDER, 6)
        offsets, deviation = yield from _moves(data, reported, _by_power(model), step * cycle, count, deviation)
        offsets, lines = _anchored(reported, offsets, model.lines)
        data, model = dataclasses.replace(data, positions=reported + offsets), model.with_lines(lines, model.loss)
    moved = search.over(data)
    better = yield from moved.settle(model)
    for step, count in _ROUNDS * _WAVE_STEPS:
        if better is None or better.wave is None:
            return None
        offsets, deviation = yield from _moves(data, reported, _by_phase(better.wave), step * cycle, count, deviation)
        offsets, lines = _anchored(reported, offsets, better.lines)
        moved = search.over(dataclasses.replace(data, positions=reported + offsets))
        better, data = (yield from moved.again(better.moved_to(lines))), moved.data
    better = better and (yield from moved.settle(better.model))
    return None if better is None or better.wave is None else Placed(moved, better, deviation)


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


def _anchored(
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
