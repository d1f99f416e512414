"""A device that is louder in some directions, a medium that takes something on the way: four numbers for all echoes."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.loudness import Loudness
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, FULL_ORDER, LOUDNESS_FROM, LOUDNESS_WORTH
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

DIFFERENCES = {'ahead': 0.01, 'left': 0.01, 'loss': 0.01, 'lean': 1e-4}
"""Differences by which derivatives are taken: echoes are linear in them to a hundredth."""

_REFLECTED = 0.01
"""The same of the logarithm of what all walls reflect."""

_ALLOWED = {'ahead': (-0.7, 0.7), 'left': (-0.7, 0.7), 'loss': (-0.2, 5.0), 'lean': (-0.002, 0.01)}
"""Beyond these a number stands for something else: a beam that leaves out half of the plane, a medium that gives."""

_FITTED_TIMES = 3
"""Steps of Gauss and Newton: the fourth changes the value by less than a nat."""


def hear_louder(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with directions and losses that fit it best, where these are worth clearly more."""
    wave = standing.wave
    if standing.explained < LOUDNESS_FROM or ground.as_modelled(wave) > ALL_EXPLAINED:
        return None
    louder = with_louder(ground, wave)
    return louder if louder is not None and louder.value > LOUDNESS_WORTH * wave.value else None


def with_louder(ground: Ground, wave: Wave) -> Wave | None:
    """Return the waveform with the numbers that fit it best, and the walls after them."""
    found: Wave | None = wave
    for _ in range(_FITTED_TIMES):
        ground.checkpoint()
        fitted = found and _fitted(ground.wave, found)
        found = fitted and ground.wave.evaluate(fitted.walls, fitted, FULL_ORDER)
    return found and ground.wave.refine(found, FULL_ORDER)


def _fitted(likelihood: WaveformLikelihood, wave: Wave) -> Wave:
    """Return the waveform after a step of Gauss and Newton by the four numbers, each ping's amplitude free.

    So is what all walls reflect, which a loss is near to.
    """
    whole = likelihood.without_carrier(wave)
    left, predicted = likelihood.without_carrier() - whole, unit(whole)
    moved = [(step, louder_by(wave, {name: step})) for name, step in DIFFERENCES.items()]
    moved.append((_REFLECTED, _reflecting(wave, 1.0 + _REFLECTED)))
    columns = [across(predicted, (likelihood.without_carrier(other) - whole) / step).ravel() for step, other in moved]
    square = np.real(np.conj(columns) @ np.array(columns).T)
    along = np.real(np.conj(columns) @ across(predicted, left).ravel())
    *step, reflected = np.linalg.lstsq(square, along, rcond=1e-9)[0]
    return louder_by(_reflecting(wave, float(np.exp(reflected))), dict(zip(DIFFERENCES, step, strict=True)))


def louder_by(wave: Wave, steps: dict[str, float]) -> Wave:
    """Return the waveform with some of the numbers changed by steps, within what is allowed, not evaluated."""
    numbers = wave.loudness._asdict()
    numbers |= {name: float(np.clip(numbers[name] + more, *_ALLOWED[name])) for name, more in steps.items()}
    return replace(wave, loudness=Loudness(**numbers), slopes=None)


def _reflecting(wave: Wave, factor: float) -> Wave:
    """Return the waveform with all coefficients multiplied, not evaluated."""
    reflection = np.clip(factor * wave.walls.reflection, -1.0, 1.0)
    return wave.with_walls(replace(wave.walls, reflection=reflection))


def unit(waveforms: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return pings (N, n) with a norm of 1, or 0."""
    norm = np.linalg.norm(waveforms, axis=1, keepdims=True)
    return np.asarray(waveforms / np.maximum(norm, 1e-300))


def across(unit: NDArray[np.complex128], waveforms: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return what of pings (N, n) is not a real multiple of others of norm 1."""
    share = np.real(np.sum(np.conj(unit) * waveforms, axis=1, keepdims=True))
    return np.asarray(waveforms - share * unit)
