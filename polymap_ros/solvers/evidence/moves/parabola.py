"""One number of a waveform at its best, all else following: by parabolas through what it is worth at three values."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.tuning import DIFFERENT, FULL_ORDER
from polymap_ros.solvers.evidence.waveform import Wave

_AHEAD, _TOPS = 4.0, 6
"""Steps to the top of a parabola at most, and so many parabolas, unless it is said."""

Changed = Callable[[Wave, float], Wave]
"""From a waveform and by how much more of the number it is to have to that waveform, not evaluated."""


def at_best(ground: Ground, wave: Wave, changed: Changed, step: float, tops: int = _TOPS) -> Wave:
    """Return the waveform with the number that fits best, or how far so many `tops` of parabolas come, which are drawn
    through values a `step` apart.
    """
    for _ in range(tops):
        top = _at_the_top(ground, wave, changed, step)
        gain, wave = top.value - wave.value, top
        if gain < DIFFERENT:
            break
    return wave


def _at_the_top(ground: Ground, wave: Wave, changed: Changed, step: float) -> Wave:
    """Return the waveform where a parabola has its top."""
    ground.checkpoint()
    before, after = (_refined(ground, changed(wave, more)) for more in (-step, step))
    if before is None or after is None:
        return wave
    found = [wave, before, after]
    bend = before.value + after.value - 2.0 * wave.value
    if bend < 0.0:
        ahead = float(np.clip(0.5 * (before.value - after.value) / bend, -_AHEAD, _AHEAD)) * step
        top = _refined(ground, changed(wave, ahead))
        found += [top] if top else []
    return max(found, key=lambda each: each.value)


def follow_covariance(
    ground: Ground, wave: Wave, changed: Changed, step: float
) -> tuple[float, NDArray[np.float64]]:
    """Return the number's variance, as well as the echoes tell it, and what that adds to the covariance (2 n, 2 n) of
    the lines, which follow it; infinite and nothing where a step leads to no outline.
    """
    size = 2 * len(wave.walls)
    before, after = (_refined(ground, changed(wave, more)) for more in (-step, step))
    if before is None or after is None:
        return np.inf, np.zeros((size, size))
    bend = max(2.0 * wave.value - before.value - after.value, DIFFERENT)
    follow = ((after.walls.lines - before.walls.lines) / (2.0 * step)).ravel()
    return step**2 / bend, np.asarray(step**2 / bend * np.outer(follow, follow))


def _refined(ground: Ground, wave: Wave) -> Wave | None:
    return ground.wave.refine(wave, FULL_ORDER)
