"""Floor and ceiling put where the waveform has them, and made as strong as it hears them."""

from dataclasses import replace

import numpy as np

from polymap_ros.geometry.storey import Storey
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import DIFFERENT, FULL_ORDER, PRICE
from polymap_ros.solvers.evidence.waveform import Wave

_SWEEPS = 4
"""Rounds over all numbers, at most."""

_HEIGHT_CYCLES, _LOSS = 0.05, 0.1
"""Steps to each side of a height, in cycles, and of the logarithm of a coefficient, through which a parabola is
laid."""


def tune_storey(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with heights and coefficients of floor and ceiling that are worth more, the walls following.

    Number by number by parabolas: they hardly depend on each other.
    """
    wave = _fewer(ground, standing.wave)
    for _ in range(_SWEEPS):
        before = wave.value
        for number in range(2 * len(wave.storey)):
            ground.checkpoint()
            wave = _better(ground, wave, number)
        if wave.value < before + DIFFERENT:
            break
    if wave.value < standing.wave.value + DIFFERENT and len(wave.storey) == len(standing.wave.storey):
        return None
    return ground.wave.refine(replace(wave, slopes=None), FULL_ORDER)


def _fewer(ground: Ground, wave: Wave) -> Wave:
    """Return the waveform without a plane that does not bring its price: an echo that is the walls' own."""
    for plane in range(len(wave.storey)):
        others = np.arange(len(wave.storey)) != plane
        rest = Storey(wave.storey.height_m[others], wave.storey.reflection[others])
        without = ground.wave.evaluate(wave.walls, replace(wave, storey=rest, slopes=None), FULL_ORDER)
        if without is not None and without.value > wave.value - PRICE:
            return _fewer(ground, without)
    return wave


def _better(ground: Ground, wave: Wave, number: int) -> Wave:
    """Return the best waveform of those at a number, a step to each side, and at the top of their parabola."""
    low, high = (_evaluated(ground, wave, number, share) for share in (-1.0, 1.0))
    bend = low.value - 2.0 * wave.value + high.value
    trials = [low, wave, high]
    if bend < 0.0:
        share = float(np.clip(0.5 * (low.value - high.value) / bend, -3.0, 3.0))
        trials.append(_evaluated(ground, wave, number, share))
    return max(trials, key=lambda each: each.value)


def _evaluated(ground: Ground, wave: Wave, number: int, share: float) -> Wave:
    """Return the waveform with a number moved by a share of its step: the heights first, then the coefficients."""
    height, reflection = wave.storey.height_m.copy(), wave.storey.reflection.copy()
    plane = number % len(wave.storey)
    if number < len(wave.storey):
        height[plane] += share * _HEIGHT_CYCLES * ground.cycle_m
    else:
        reflection[plane] = np.clip(reflection[plane] * np.exp(share * _LOSS), -1.0, 1.0)
    moved = replace(wave, storey=Storey(height, reflection), slopes=None)
    found = ground.wave.evaluate(moved.walls, moved, FULL_ORDER)
    return wave if found is None else found
