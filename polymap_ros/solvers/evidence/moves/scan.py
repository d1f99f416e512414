"""The last resort: every line is tried. A wall that no ping hears directly is proposed by nothing else."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.outline import corners_of
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.exchange import with_line
from polymap_ros.solvers.evidence.moves.residual import base_of, with_another
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.tuning import APART, CHORDS, EXCHANGED, FULL_ORDER, PRICE, RESCORED, SCAN_WIDTHS
from polymap_ros.solvers.evidence.waveform import Wave


def replace_by_scan(ground: Ground, standing: Standing) -> Wave | None:
    """Exchange one of the edges that are worth least, or add one, by trying every line in their place."""
    wave = standing.wave
    bases = []
    for wall in range(len(wave.walls)):
        ground.checkpoint()
        bases.append(left_out(ground, wave, wall))
    worth = sorted((base for base in bases if base is not None), key=lambda base: -base.value)
    for other in (*worth[:EXCHANGED], *([wave] if len(wave.walls) < ground.max_edges else [])):
        base = base_of(ground, standing.power, other)
        changed = with_another(ground, base, scanned(ground, base), wave.value - PRICE * len(wave.walls), wave.edge)
        if changed is not None:
            return changed
    return None


def scanned(ground: Ground, base: Power) -> NDArray[np.float64]:
    """Return lines (m, 2) that cut the polygon, a bit more than a pulse's width apart: those with the most power."""
    width = SCAN_WIDTHS * ground.width_m
    _, corners = corners_of(base.walls.lines)
    theta = np.arange(-np.pi, np.pi, 2.0 * width / ground.data.extent_m)
    trials = []
    for angle in theta:
        ground.checkpoint()
        normal = np.array([np.cos(angle), np.sin(angle)])
        low = float(np.max(ground.data.positions @ normal))
        high = min(float(np.max(corners @ normal)), low + ground.data.range_max_m / 2.0)
        for r in np.arange(low + width / 2.0, high, width):
            walls = with_line(ground, base.walls, np.array([r, angle]))
            if walls is not None:
                trials.append((ground.few.value(walls, base, 2), float(r), float(angle), walls))
    trials.sort(key=lambda entry: entry[:3], reverse=True)
    rows = [(ground.power.value(walls, base, 2), r, angle) for _, r, angle, walls in trials[:RESCORED]]
    best: list[tuple[float, float, float]] = []
    for value, r, angle in sorted(rows, reverse=True):
        if len(best) == CHORDS:
            break
        turn = theta[1] - theta[0]
        if all(abs(r - other) > APART * width or abs(wrapped(angle - at)) > APART * turn for _, other, at in best):
            best.append((value, r, angle))
    return np.array([(r, angle) for _, r, angle in best]).reshape(-1, 2)


def left_out(ground: Ground, wave: Wave, wall: int) -> Wave | None:
    """Return the waveform without a wall; where nothing closes without it, it is moved beyond hearing and silent."""
    fewer = ground.wave.evaluate(wave.walls.without(wall), wave, FULL_ORDER)
    if fewer is not None:
        return fewer
    beyond = wave.walls.shifted(wall, ground.data.range_max_m).silenced(wall)
    return ground.wave.evaluate(beyond, wave, FULL_ORDER)
