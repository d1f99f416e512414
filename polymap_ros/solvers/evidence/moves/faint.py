"""A wall that reflects a fifth: what the waveform leaves, added up in phase over all pings, tells where it is.

In power its echoes drown in those of the others. With the device's phase and the pings' amplitudes known, the
first-order echoes of a line are worth x^2 / 2 y, with x = sum_i A_i d_i^-p Re[exp(-j phi) c_i(d_i)] over what is left
and y = sum_i A_i^2 d_i^-2p, for a coefficient of x / y: a map of eq. (4) with phase.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.paths import first_order
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.left_by_range import fine_step_m, left_by_range
from polymap_ros.solvers.evidence.moves.scan import left_out
from polymap_ros.solvers.evidence.moves.standing import Standing, better_of
from polymap_ros.solvers.evidence.tuning import EXPLAINED, FULL_ORDER, SILENT
from polymap_ros.solvers.evidence.waveform import Wave

_PER_CYCLE = 5.0
"""Steps to a cycle, of r and, at the ends of the path, of theta: between two, a tenth of a cycle is lost at most, of
which four fifths are left."""

_BESIDE_RAD = 0.05
"""Lines nearer to a neighbour's direction than this are the neighbour's."""

_FEET = 4
"""Feet that a line has at least."""

_LISTED = 6
"""Lines that are tried, the best that are a pulse's width apart."""


def hear_faint(ground: Ground, standing: Standing) -> Wave | None:
    """Return the best waveform with another line, heard faintly, in the place of a wall that is silent."""
    wave = standing.wave
    return _heard(ground, wave, np.flatnonzero(np.abs(wave.walls.reflection) < SILENT).tolist())


def look_for_faint(ground: Ground, standing: Standing, least: float = EXPLAINED) -> Wave | None:
    """The same in the place of any wall, or in addition, where at least this share is explained.

    It takes a second and more: where a second mode leaves a tenth unexplained, no wall is there to be found.
    """
    if standing.explained < least:
        return None
    walls = range(len(standing.wave.walls))
    return _heard(ground, standing.wave, walls, walls if len(walls) < ground.max_edges else ())


def _heard(ground: Ground, wave: Wave, places: Sequence[int], corners: Sequence[int] = ()) -> Wave | None:
    """Return the first waveform that is worth more with a faint line in the place of a wall, or before one."""
    lines = wave.walls.lines
    for place, replaced in (*((wall, True) for wall in places), *((wall, False) for wall in corners)):
        ground.checkpoint()
        base = left_out(ground, wave, place) if replaced else wave
        if base is None:
            continue
        rest = wave.walls.without(place) if replaced else wave.walls
        after = lines[(place + 1) % len(lines)] if replaced else lines[place]
        trials = [ground.wave.evaluate(rest.with_line(line, reflection), wave, FULL_ORDER)
                  for line, reflection in _faint_lines(ground, base, lines[place - 1], after)]
        better = better_of(ground, wave, [trial for trial in trials if trial is not None])
        if better is not None and ground.worth(better) > ground.worth(wave):
            return better
    return None


def _faint_lines(
    ground: Ground, base: Wave, before: NDArray[np.float64], after: NDArray[np.float64]
) -> list[tuple[NDArray[np.float64], float]]:
    """Return lines between two walls and their coefficients, those first that are worth most of what a base leaves."""
    data = ground.data
    turn = float(np.mod(after[1] - before[1], 2.0 * np.pi))
    theta_step = 2.0 * ground.cycle_m / (_PER_CYCLE * data.extent_m)
    theta = before[1] + np.arange(_BESIDE_RAD, min(turn, np.pi) - _BESIDE_RAD, theta_step)
    r = np.arange(0.0, data.range_max_m, ground.cycle_m / _PER_CYCLE)
    if len(theta) == 0:
        return []
    x, y = left_by_range(ground, base)
    worth, coefficient = np.zeros((len(theta), len(r))), np.zeros((len(theta), len(r)))
    _add_in_phase(x, y, fine_step_m(ground), base.amplitudes**2, data.positions, data.baselines, theta, r,
                  np.array((before, after)), data.first_cell * data.cell_m, worth, coefficient)
    found: list[tuple[NDArray[np.float64], float]] = []
    for place in np.argsort(-worth, axis=None, kind='stable')[:_LISTED * 200]:
        row, column = np.unravel_index(place, worth.shape)
        line = np.array((r[column], wrapped(theta[row])))
        if worth[row, column] <= 0.0 or len(found) == _LISTED:
            break
        if abs(coefficient[row, column]) >= SILENT and not ground.one_of(line, [known for known, _ in found]):
            found.append((line, float(np.clip(coefficient[row, column], -1.0, 1.0))))
    return found


def rehearse_faint() -> None:
    """Use the kernel once."""
    one, table = np.ones(1), np.zeros((1, 1))
    _add_in_phase(np.ones((1, 8), np.float32), np.ones(8), 1.0, one, np.zeros((1, 2)), np.zeros((1, 3)), one, one,
                  np.array([(1.0, 0.0), (1.0, 2.0)]), 0.0, table, table.copy())


@kernel
def _add_in_phase(
    x: NDArray[np.float32], y: NDArray[np.float64], fine: float, gain: NDArray[np.float64],
    positions: NDArray[np.float64], baselines: NDArray[np.float64], theta: NDArray[np.float64], r: NDArray[np.float64],
    neighbours: NDArray[np.float64], nearest: float, worth: NDArray[np.float64], coefficient: NDArray[np.float64],
) -> None:
    """Fill what each line is worth and its coefficient, by the feet between where it meets its neighbours."""
    farthest = (x.shape[1] - 1) * fine
    for t in range(len(theta)):
        c, s = np.cos(theta[t]), np.sin(theta[t])
        for q in range(len(r)):
            # Where the neighbours are met, along the line from the foot of the origin.
            start, end = -np.inf, np.inf
            for k in range(2):
                sine = np.sin(neighbours[k, 1] - theta[t])
                met = (neighbours[k, 0] - r[q] * np.cos(neighbours[k, 1] - theta[t])) / sine
                if k == 0:
                    start = met
                else:
                    end = met
            if start >= end:
                continue
            sum_x, sum_y, feet = 0.0, 0.0, 0
            for i in range(len(positions)):
                away, along = first_order(r[q], c, s, positions[i, 0], positions[i, 1], baselines[i, 0],
                                          baselines[i, 1], baselines[i, 2])
                if away <= 0.0:  # a ping would be outside
                    feet = 0
                    break
                if along < start or along > end or away < nearest or away > farthest:
                    continue
                at = round(away / fine)
                sum_x += x[i, at]
                sum_y += gain[i] * y[at]
                feet += 1
            if feet >= _FEET and sum_y > 0.0:
                worth[t, q], coefficient[t, q] = 0.5 * sum_x * sum_x / sum_y, sum_x / sum_y
