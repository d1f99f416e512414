"""A wall that stands inside, such as a stiffener or a weld seam: what the waveform leaves, added up in phase.

Pings hear it from both sides, over a part of its line, and through it they hear the walls behind. With the device's
phase and the pings' amplitudes known, a foot at range d is worth rho x - rho^2 y / 2 to a wall that reflects rho, with
x = A d^-p Re[exp(-j phi) c(d)] over what is left and y = (A d^-p)^2: a wall is where a run of feet is worth most. Its
ends, and what it lets through, are tried one by one.
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import away_from, wrapped
from polymap_ros.geometry.outline import corners_of, half_plane_polygon
from polymap_ros.geometry.paths import first_order
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.left_by_range import fine_step_m, left_by_range
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import DIFFERENT, FULL_ORDER, HEARD_THROUGH, INNER_WALLS, PHASED, SEARCH_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

_SUPPOSED = 0.3
"""Coefficient with which runs are looked for: of what a wall of 0.2 to 0.6 brings it finds three quarters and more."""

_PER_CYCLE = 5.0
"""Steps to a cycle, of r and, at the ends of the path, of theta: between two, a tenth of a cycle is lost at most."""

_LISTED, _TUNED = 6, 2
"""Lines that are tried, the best that are a pulse's width apart, and how many of them are refined."""

_REACH_M, _STEPS_M, _SHARES = 0.8, (0.08, 0.02, 0.005), (0.1, 0.025)
"""How far from the outermost feet an end is looked for, and the steps, for what is let through, too."""

_KEPT_RUNS = 4
"""Runs of one direction that are kept, a pulse's width apart."""

_MOST_TRIED = 6_000_000
"""Lines that are looked at, at most: plates of a metre have 0.6 to 1.2 million, which take half a second, rooms of 4 to
8 m at 20 kHz 15 to 29 million (six each, even seeds)."""

_VALUE, _R, _X, _Y, _START, _END = range(6)
"""Columns of a run: what it is worth, r, its sums of x and of y, and its first and last foot along the line."""


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
        trial = ground.wave.evaluate(walls, wave.with_slopes(None), FULL_ORDER)
        if trial is not None:
            trials.append(trial)
    for trial in sorted(trials, key=lambda each: -each.value)[:_TUNED]:
        ground.checkpoint()
        found = tuned(ground, trial)
        if found is not None and found.value > wave.value + ground.least_gain(wave.value) and found.walls.let_through:
            return found
    return None


def as_edges(walls: Walls, positions: NDArray[np.float64]) -> Walls | None:
    """Return a convex outline that inner walls are edges of, without those that they hide from pings at positions
    (n, 2); None where a ping was behind one.
    """
    if len(walls.interior.holes) or walls.has_reflex_corner:
        return None
    lines, inner = walls.lines.copy(), walls.lines[walls.ring:]
    for number, (r, theta) in enumerate(inner, walls.ring):
        away = away_from(np.array((r, theta)), positions)
        if away.min() < 0.0 < away.max():
            return None
        if away.max() <= 0.0:
            lines[number] = -r, wrapped(theta + np.pi)
    bounding = half_plane_polygon(lines)[1]
    return Walls.convex(lines[bounding], walls.reflection[bounding])


def tune_inner_walls(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with ends of inner walls elsewhere, and other shares let through, that are worth more."""
    better = tuned(ground, standing.wave) if len(standing.wave.walls.interior.spans) else None
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
        best = ground.wave.refine(best.with_walls(best.walls.with_spans(spans)), SEARCH_ORDER, 3)
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
        found = likelihood.evaluate(wave.walls.with_spans(trial), wave, SEARCH_ORDER)
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
    data, step = ground.data, ground.cycle_m / _PER_CYCLE
    _, corners = corners_of(wave.walls.outline)
    theta = np.arange(0.0, np.pi, 2.0 * step / data.extent_m)
    # A corner may be far away; what is heard is not.
    reach = min(float(np.linalg.norm(corners, axis=1).max()),
                float(np.linalg.norm(data.positions, axis=1).max()) + data.range_max_m)
    if len(theta) * 2.0 * reach / step > _MOST_TRIED:
        return []
    along = np.outer(np.cos(theta), data.positions[:, 1]) - np.outer(np.sin(theta), data.positions[:, 0])
    order = np.argsort(along, axis=1, kind='stable')
    runs = np.zeros((len(theta), _KEPT_RUNS, 6))
    x, y = left_by_range(ground, wave)
    _add_runs(
        x, y, fine_step_m(ground), wave.amplitudes**2, data.positions, data.baselines, corners, theta,
        order, reach, step, data.first_cell * data.cell_m, data.pulse.width_m, runs)
    found: list[tuple[NDArray[np.float64], tuple[float, float], float]] = []
    for place in np.argsort(-runs[:, :, _VALUE], axis=None, kind='stable'):
        row, column = np.unravel_index(place, runs.shape[:2])
        run = runs[row, column]
        if run[_VALUE] <= 0.0 or len(found) == _LISTED:
            break
        line = np.array((run[_R], theta[row]))
        if not ground.one_of(line, [known for known, _, _ in found]):
            coefficient = float(np.clip(run[_X] / run[_Y], -0.95, 0.95))
            found.append((line, (float(run[_START]), float(run[_END])), coefficient))
    return found


def rehearse_inner_walls() -> None:
    """Use the kernel once."""
    triangle = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    _add_runs(np.ones((1, 8), np.float32), np.ones(8), 1.0, np.ones(1), np.zeros((1, 2)), np.zeros((1, 3)), triangle,
              np.ones(1), np.zeros((1, 1), np.int64), 1.0, 1.0, 0.0, 0.0, np.zeros((1, _KEPT_RUNS, 6)))


@kernel
def _add_runs(
    x: NDArray[np.float32], y: NDArray[np.float64], fine: float, gain: NDArray[np.float64],
    positions: NDArray[np.float64], baselines: NDArray[np.float64], corners: NDArray[np.float64],
    theta: NDArray[np.float64], order: NDArray[np.int64], reach: float, step: float, first: float, margin: float,
    runs: NDArray[np.float64],
) -> None:
    """Fill the best runs of each direction, of lines a step apart and up to `reach`, by feet inside the outline and a
    margin off it.
    """
    n = len(positions)
    low, high = np.empty(n), np.empty(n)
    run = np.empty(6)
    for t in range(len(theta)):
        c, s = np.cos(theta[t]), np.sin(theta[t])
        for i in range(n):
            low[i], high[i] = _crossed(corners, c, s, positions[i, 1] * c - positions[i, 0] * s)
            low[i], high[i] = low[i] + margin, high[i] - margin
        begin, end = max(np.min(low), -reach), min(np.max(high), reach)
        for q in range(int((end - begin) / step) + 1 if end > begin else 0):
            r = begin + q * step
            for sign in (1.0, -1.0):
                run[:] = 0.0
                run[_R] = r
                _fill_run(x, y, fine, gain, positions, baselines, c, s, order[t], low, high, first, sign, run)
                _keep(run, margin, runs[t])


@kernel
def _fill_run(
    x: NDArray[np.float32], y: NDArray[np.float64], fine: float, gain: NDArray[np.float64],
    positions: NDArray[np.float64], baselines: NDArray[np.float64], c: float, s: float, order: NDArray[np.int64],
    low: NDArray[np.float64], high: NDArray[np.float64], first: float, sign: float, best: NDArray[np.float64],
) -> None:
    """Fill the best run of feet along a line for a coefficient of one sign."""
    r, last = best[_R], x.shape[1] - 1
    worth, sum_x, sum_y, start = 0.0, 0.0, 0.0, 0.0
    for i in order:
        if r < low[i] or r > high[i]:
            continue
        px, py, apart = positions[i, 0], positions[i, 1], baselines[i]
        side = 1.0 if r > px * c + py * s else -1.0
        half, along = first_order(side * r, side * c, side * s, px, py, apart[0], apart[1], apart[2])
        at = int(half / fine + 0.5)
        if half < first or at > last:
            continue
        weight = gain[i] * y[at]
        if worth <= 0.0:
            worth, sum_x, sum_y, start = 0.0, 0.0, 0.0, side * along
        worth += sign * _SUPPOSED * x[i, at] - 0.5 * _SUPPOSED * _SUPPOSED * weight
        sum_x += x[i, at]
        sum_y += weight
        if worth > best[_VALUE]:
            best[_VALUE], best[_X], best[_Y], best[_START], best[_END] = worth, sum_x, sum_y, start, side * along


@kernel
def _keep(run: NDArray[np.float64], apart: float, kept: NDArray[np.float64]) -> None:
    """Put a run in the place of one nearer than `apart`, or else of the one worth least, where it is worth more."""
    place = 0
    for k in range(len(kept)):
        if kept[k, _VALUE] > 0.0 and abs(kept[k, _R] - run[_R]) < apart:
            place = k
            break
        if kept[k, _VALUE] < kept[place, _VALUE]:
            place = k
    if run[_VALUE] > kept[place, _VALUE]:
        kept[place] = run


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
