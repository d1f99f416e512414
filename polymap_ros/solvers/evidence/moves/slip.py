"""Cycle slips: a wall half a cycle of range off, its sign turned, or a whole cycle off, sounds nearly alike."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import corners_of
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.standing import Standing, better_of
from polymap_ros.solvers.evidence.tuning import (
    ALL_EXPLAINED,
    OBVIOUS,
    SEARCH_ORDER,
    SHORT_EDGES,
)
from polymap_ros.solvers.evidence.waveform import Wave

_SLIPS = (-0.5, True), (0.5, True), (-1.0, False), (1.0, False)
"""Cycles of range, and whether the sign of the reflection turns."""


def fix_cycle_slips(ground: Ground, standing: Standing) -> Wave | None:
    """Try other cycles for short edges, and for all where some of the echoes are unexplained."""
    wave = standing.wave
    walls = _short_edges(ground, wave)
    if standing.explained < ALL_EXPLAINED + ground.uncertainty:
        walls = np.arange(len(wave.walls))
    return slipped(ground, wave, walls) if len(walls) else None


def slipped(ground: Ground, wave: Wave, walls: NDArray[np.intp]) -> Wave | None:
    """Return the best waveform with one of these walls in another cycle; None where none is better.

    A part of the pings tells which of these may be worth more once all walls are refined.
    """
    as_is = ground.few_wave.evaluate(wave.walls, wave, SEARCH_ORDER)
    least = -np.inf if as_is is None else as_is.value - OBVIOUS
    trials = []
    for wall in walls:
        ground.checkpoint()
        for cycles, turned in _SLIPS:
            moved = wave.walls.shifted(wall, cycles * ground.cycle_m, turned)
            trial = ground.few_wave.evaluate(moved, wave, SEARCH_ORDER)
            if trial is not None and trial.value > least:
                trials.append(trial)
    return better_of(ground, wave, trials)


def _short_edges(ground: Ground, wave: Wave) -> NDArray[np.intp]:
    """Return walls so short that their few echoes leave open, at all that is explained, which cycle they are of."""
    _, corners = corners_of(wave.walls.outline)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return np.flatnonzero(lengths < SHORT_EDGES[-1] * ground.width_m)
