"""A wall that stands inside, such as a stiffener or a weld seam: what the waveform leaves, added up in phase.

Pings hear it from both sides, over a part of its line, and through it they hear the walls behind. With the device's
phase and the pings' amplitudes known, a foot at range d is worth rho x - rho^2 y / 2 to a wall that reflects rho, with
x = A d^-p Re[exp(-j phi) c(d)] over what is left and y = (A d^-p)^2: a wall is where a run of feet is worth most. Its
ends, and what it lets through, are tried one by one.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import corners_of
from polymap_ros.geometry.sides import Interior
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.ground import Ground, least_gain
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import DIFFERENT, FULL_ORDER, HEARD_THROUGH, INNER_WALLS, PHASED, SEARCH_ORDER
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

_SUPPOSED = 0.3
"""Coefficient with which runs are looked for: of what a wall of 0.2 to 0.6 brings it finds three quarters and more."""

_PER_CYCLE = 5.0
"""Steps to a cycle, of r and, at the ends of the path, of theta: between two, a tenth of a cycle is lost at most."""

_LISTED, _TUNED = 6, 2
"""Lines that are tried, the best that are a pulse's width apart, and how many of them are refined."""

_REACH_M, _STEPS_M, _SHARES = 0.8, (0.08, 0.02, 0.005), (0.1, 0.025)
"""How far from the outermost feet an end is looked for, and the steps, for what is let through, too."""


class _Runs(NamedTuple):
    """Of every line that is tried, its best run: what it is worth, its sums of x and y, and its first and last foot."""

    worth: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    start: NDArray[np.float64]
    end: NDArray[np.float64]


def add_inner_wall(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with the inner wall that brings most of what is left, if that is enough to be sure."""
    wave = standing.wave
    holes, spans = wave.walls.interior
    if standing.explained < (PHASED if len(holes) else HEARD_THROUGH) or len(spans) >= INNER_WALLS:
        return None
    trials = []
    for line, span, reflection in _inner_lines(ground, wave):
        ground.checkpoint()
        passed = np.sqrt(1.0 - reflection**2)
        walls = wave.walls.with_inner(line, np.array((*span, passed)), reflection)
        trial = ground.wave.evaluate(walls, replace(wave, slopes=None), FULL_ORDER)
        if trial is not None:
            trials.append(trial)
    for trial in sorted(trials, key=lambda each: -each.value)[:_TUNED]:
        ground.checkpoint()
        found = tuned(ground, trial)
        if found is not None and found.value > wave.value + least_gain(wave.value) and found.walls.heard_through:
            return found
    return None


def tune_inner_walls(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with ends of inner walls elsewhere, and other shares let through, that are worth more."""
    better = tuned(ground, standing.wave)
    return better if better is not None and better.value > standing.wave.value + DIFFERENT else None


def tuned(ground: Ground, wave: Wave) -> Wave | None:
    """Return the waveform at the best ends of its inner walls and what they let through, all walls following."""
    best = ground.wave.refine(wave.with_slopes(None), SEARCH_ORDER, 3)
    for likelihood, reach_m in ((ground.few_wave, _REACH_M), (ground.wave, _STEPS_M[0])):
        if best is None:
            return None
        spans = best.walls.interior.spans
        for number in range(len(spans)):
            spans = _with_better(ground, likelihood, best, spans, number, reach_m)
        walls = replace(best.walls, interior=Interior(best.walls.interior.holes, spans))
        best = ground.wave.refine(best.with_walls(walls), SEARCH_ORDER, 3)
    return best and ground.wave.refine(best.with_slopes(None), FULL_ORDER)


def _with_better(
    ground: Ground, likelihood: WaveformLikelihood, wave: Wave, spans: NDArray[np.float64], number: int, reach_m: float,
) -> NDArray[np.float64]:
    """Return the spans with a wall's ends at the best places within a reach, and the best share let through.

    All places are tried, a step apart: between two feet nothing tells them apart, and a climb would end there.
    """
    def best_of(spans: NDArray[np.float64], column: int, moves: NDArray[np.float64]) -> NDArray[np.float64]:
        ground.checkpoint()
        best, least = spans, value(spans) + DIFFERENT
        for move in moves[moves != 0.0]:
            trial = spans.copy()
            trial[number, column] += move
            more = value(trial) if 0.0 < trial[number, 2] <= 1.0 else -np.inf
            if more > least:
                best, least = trial, more
        return best

    def value(trial: NDArray[np.float64]) -> float:
        walls = replace(wave.walls, interior=Interior(wave.walls.interior.holes, trial))
        found = likelihood.evaluate(walls, wave, SEARCH_ORDER)
        return -np.inf if found is None else found.value

    for step in _STEPS_M:
        for end in (0, 1):
            spans = best_of(spans, end, np.arange(-reach_m, reach_m + 0.5 * step, step))
        reach_m = min(step, reach_m)
    for share in _SHARES:
        spans = best_of(spans, 2, share * np.arange(-3.0, 4.0))
    return spans


def _inner_lines(
    ground: Ground, wave: Wave
) -> list[tuple[NDArray[np.float64], tuple[float, float], float]]:
    """Return lines inside the outline, where each starts and ends, and its coefficient: those first whose run of feet
    is worth most of what a waveform leaves.
    """
    data, cycle = ground.data, ground.cycle_m
    _, corners = corners_of(wave.walls.outline)
    theta = np.arange(0.0, np.pi, 2.0 * cycle / (_PER_CYCLE * data.extent_m))
    # A corner may be far away; what is heard is not.
    away = min(float(np.abs(corners).sum(axis=1).max()),
               float(np.linalg.norm(data.positions, axis=1).max()) + data.range_max_m)
    r = np.arange(-away, away, cycle / _PER_CYCLE)
    along = np.outer(np.cos(theta), data.positions[:, 1]) - np.outer(np.sin(theta), data.positions[:, 0])
    order = np.argsort(along, axis=1, kind='stable')
    shape = 2, len(theta), len(r)
    runs = _Runs(*(np.zeros(shape) for _ in _Runs._fields))
    _add_runs(*_by_range(ground, wave), cycle / 16.0, wave.amplitudes**2, data.positions, corners, theta, r, order,
              data.first_cell * data.cell_m, data.pulse.width_m, _SUPPOSED, runs)
    found: list[tuple[NDArray[np.float64], tuple[float, float], float]] = []
    for place in np.argsort(-runs.worth, axis=None, kind='stable')[:_LISTED * 200]:
        sign, row, column = np.unravel_index(place, shape)
        line = np.array((r[column], theta[row]))
        if runs.worth[sign, row, column] <= 0.0 or len(found) == _LISTED:
            break
        if not ground.one_of(line, [known for known, _, _ in found]):
            coefficient = float(np.clip(runs.x[sign, row, column] / runs.y[sign, row, column], -0.95, 0.95))
            ends = float(runs.start[sign, row, column]), float(runs.end[sign, row, column])
            found.append((line, ends, coefficient))
    return found


def rehearse_inner_walls() -> None:
    """Use the kernel once."""
    one, shape = np.ones(1), (2, 1, 1)
    triangle = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    _add_runs(np.ones((1, 8), np.float32), np.ones(8), 1.0, one, np.zeros((1, 2)), triangle, one, one,
              np.zeros((1, 1), np.int64), 0.0, 0.0, _SUPPOSED, _Runs(*(np.zeros(shape) for _ in _Runs._fields)))


def _by_range(ground: Ground, wave: Wave) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return x (N, m) of what a waveform leaves, and y (m,) at amplitude 1, at every sixteenth of a cycle of range."""
    data = ground.data
    left = ground.wave.left_without_carrier(wave)
    ranges = np.arange(0.0, data.range_max_m, ground.cycle_m / 16.0)
    cells = data.cell_m * np.arange(left.shape[1])
    falloff = np.maximum(ranges, ground.cycle_m) ** -data.spreading
    turn = np.exp(1j * (2.0 * data.pulse.carrier * ranges - wave.phase))
    x = np.empty((len(left), len(ranges)), np.float32)
    for ping, row in enumerate(left):
        envelope = np.interp(ranges, cells, row.real) + 1j * np.interp(ranges, cells, row.imag)
        x[ping] = wave.amplitudes[ping] * falloff * np.real(turn * envelope)
    return x, falloff**2


@kernel
def _add_runs(
    x: NDArray[np.float32], y: NDArray[np.float64], step: float, gain: NDArray[np.float64],
    positions: NDArray[np.float64], corners: NDArray[np.float64], theta: NDArray[np.float64], r: NDArray[np.float64],
    order: NDArray[np.int64], first: float, margin: float, supposed: float, runs: _Runs,
) -> None:
    """Fill the best runs of feet inside the outline, a margin off it, of a positive and of a negative coefficient."""
    n, last = len(positions), x.shape[1] - 1
    low, high = np.empty(n), np.empty(n)
    sums = np.empty((2, 4))
    for t in range(len(theta)):
        c, s = np.cos(theta[t]), np.sin(theta[t])
        for i in range(n):
            low[i], high[i] = _crossed(corners, c, s, positions[i, 1] * c - positions[i, 0] * s)
        for q in range(len(r)):
            sums[:] = 0.0
            for k in range(n):
                i = order[t, k]
                if r[q] < low[i] + margin or r[q] > high[i] - margin:
                    continue
                away = abs(r[q] - positions[i, 0] * c - positions[i, 1] * s)
                at = int(away / step + 0.5)
                if away < first or at > last:
                    continue
                along = positions[i, 1] * c - positions[i, 0] * s
                for sign in range(2):
                    # What the run so far is worth, its x and y, and where it began.
                    run, value = sums[sign], x[i, at] if sign == 0 else -x[i, at]
                    weight = gain[i] * y[at]
                    if run[0] <= 0.0:
                        run[0], run[1], run[2], run[3] = 0.0, 0.0, 0.0, along
                    run[0] += supposed * value - 0.5 * supposed * supposed * weight
                    run[1] += x[i, at]
                    run[2] += weight
                    if run[0] > runs.worth[sign, t, q]:
                        runs.worth[sign, t, q], runs.x[sign, t, q], runs.y[sign, t, q] = run[0], run[1], run[2]
                        runs.start[sign, t, q], runs.end[sign, t, q] = run[3], along


@kernel
def _crossed(corners: NDArray[np.float64], c: float, s: float, along: float) -> tuple[float, float]:
    """Return from where to where the line perpendicular to (-s, c), at a place along it, is inside an outline."""
    low, high = np.inf, -np.inf
    for k in range(len(corners)):
        a = corners[k - 1, 1] * c - corners[k - 1, 0] * s - along
        b = corners[k, 1] * c - corners[k, 0] * s - along
        if (a < 0.0) != (b < 0.0):
            share = a / (a - b)
            x = corners[k - 1, 0] + share * (corners[k, 0] - corners[k - 1, 0])
            y = corners[k - 1, 1] + share * (corners[k, 1] - corners[k - 1, 1])
            low, high = min(low, x * c + y * s), max(high, x * c + y * s)
    return low, high
