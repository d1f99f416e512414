"""A corner cut off by an edge hardly longer than the pulse, which too few feet propose."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import corners_of
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.exchange import with_line
from polymap_ros.solvers.evidence.moves.residual import base_of
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.proposals import corner_cuts
from polymap_ros.solvers.evidence.tuning import CUTS, FULL_ORDER, REFINED, SEARCH_ORDER, SHORT_EDGES
from polymap_ros.solvers.evidence.waveform import Wave

_SLIDES = np.arange(-1.0, 1.01, 0.2)
"""Cycles of range by which a cut may be off."""


def cut_corner(ground: Ground, standing: Standing) -> Wave | None:
    """Return the best waveform with a corner cut off, if that brings enough to be sure.

    Power tells roughly where, and the waveform, by a part of the pings, which of these and how far from the corner.
    """
    wave = standing.wave
    if len(wave.walls) >= ground.max_edges:
        return None
    base = base_of(ground, standing.power, wave)
    _, corners = corners_of(wave.walls.lines)
    lengths = [share * ground.width_m for share in SHORT_EDGES]
    trials = []
    for line in corner_cuts(wave.walls.lines[:, 1], corners, lengths):
        walls = with_line(ground, base.walls, line)
        if walls is not None and len(walls) > len(wave.walls):
            trials.append((ground.few.value(walls, base, SEARCH_ORDER), *line))
    ground.checkpoint()
    cuts = [slid(ground, wave, np.array(line)) for _, *line in sorted(trials, reverse=True)[:CUTS]]
    ground.checkpoint()
    best, least = None, wave.value + ground.least_gain(wave.value)
    for cut in sorted((cut for cut in cuts if cut is not None), key=lambda each: -each.value)[:REFINED]:
        refined = ground.wave.refine(cut, FULL_ORDER)
        ground.checkpoint()
        if refined is not None and refined.value > least:
            best, least = refined, refined.value
    return best


def slid(ground: Ground, wave: Wave, line: NDArray[np.float64]) -> Wave | None:
    """Return the best waveform, by a part of the pings, with a line more that may be off by a cycle of range."""
    best = None
    for cycles in _SLIDES:
        for sign in (1.0, -1.0):
            walls = wave.walls.with_line(line - (cycles * ground.cycle_m, 0.0), sign)
            trial = ground.few_wave.evaluate(walls, wave, SEARCH_ORDER)
            if trial is not None and (best is None or trial.value > best.value):
                best = trial
    return best
