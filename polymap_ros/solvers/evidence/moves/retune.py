"""A wall off by up to a cycle of range at either end: what power leaves open where few feet are on it."""

import numpy as np

from polymap_ros.geometry.outline import corners_of
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.standing import Standing, better_of
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, SEARCH_ORDER
from polymap_ros.solvers.evidence.waveform import Wave

_ENDS = np.arange(-1.0, 1.01, 0.25)
"""Cycles of range by which each end is tried elsewhere: maxima are half a cycle apart, and half of that is enough."""

_NEARLY = 0.75
"""Share of the echoes' power from which it is tried: with one wall half a cycle off at an end an L explains 0.76 and
more once the others have followed (even seed)."""


def retune(ground: Ground, standing: Standing) -> Wave | None:
    """Return the best waveform with one wall moved at its ends, where little is unexplained.

    It is dear, and of outlines that explain less than that none was mended (18 settled, even seeds).
    """
    wave = standing.wave
    if not _NEARLY < standing.explained < ALL_EXPLAINED:
        return None
    _, corners = corners_of(wave.walls.lines)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    trials = []
    for wall, (theta, length) in enumerate(zip(wave.walls.lines[:, 1], lengths, strict=True)):
        ground.checkpoint()
        middle = 0.5 * (corners[wall] + corners[(wall + 1) % len(corners)])
        along = middle[1] * np.cos(theta) - middle[0] * np.sin(theta)
        here = []
        for start in _ENDS:
            for end in _ENDS:
                turn = (start - end) * ground.cycle_m / length
                lines = wave.walls.lines.copy()
                # With r = x cos(theta) + y sin(theta), a turn moves r by the place along the wall about which it is.
                lines[wall] += 0.5 * (start + end) * ground.cycle_m + along * turn, turn
                for turned in (False, True):
                    moved = wave.walls.on(lines).shifted(wall, 0.0, turned)
                    trial = ground.few_wave.evaluate(moved, wave, SEARCH_ORDER)
                    if trial is not None:
                        here.append(trial)
        trials += sorted(here, key=lambda each: -each.value)[:1]
    return better_of(ground, wave, trials)
