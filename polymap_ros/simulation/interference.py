"""What is put into a scene's pings beside echoes: lines of motors and supplies, impulses of relays, coloured noise."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.simulation.faults import Faults

INTERFERENCE_STREAM = 9
"""Stream of a scene's random numbers."""

_APART = 1.3
"""Ratio of the frequencies of neighbouring lines."""

_WANDER, _RIPPLE, _MAINS_HZ = 1e-3, 0.1, 100.0
"""A line's frequency differs from ping to ping by this share (standard deviation), and its amplitude swings by that
share with the mains, rectified: no machine is a standard."""


def interference(
    faults: Faults, generator: np.random.Generator, clean: NDArray[np.float64], noise: NDArray[np.float64],
    period_s: float,
) -> NDArray[np.float64]:
    """Samples (T, n) of all lines and impulses.

    Parameters
    ----------
    faults : Faults
        Which ones, and how strong.
    generator : numpy.random.Generator
        Draws phases, frequencies and impulses.
    clean : ndarray, shape (T, n)
        The echoes, over whose mean power lines are given.
    noise : ndarray, shape (T, 1)
        Standard deviation of each ping's noise, in which impulses are given.
    period_s : float
        Sample period [s].
    """
    return _lines(faults, generator, clean, period_s) + _impulses(faults, generator, clean.shape, noise)


def coloured(white: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Return noise of power 1 of which each sample passes a share on to the next one, from white noise (T, n)."""
    import scipy.signal  # takes as long to load as all the rest of scipy that is used

    fresh = np.sqrt(1.0 - share**2) * white
    fresh[:, 0] = white[:, 0]
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -share], fresh, axis=1))


def _lines(
    faults: Faults, generator: np.random.Generator, clean: NDArray[np.float64], period_s: float
) -> NDArray[np.float64]:
    pings, n = clean.shape
    total, at = np.zeros(clean.shape), np.arange(n) / n
    amplitude = np.sqrt(2.0 * np.mean(clean**2) * 10.0 ** (faults.line_db / 10.0))
    for number in range(faults.lines):
        cycles = faults.line_hz * _APART**number * n * period_s * (1.0 + _WANDER * generator.normal(size=(pings, 1)))
        phase, swing = generator.uniform(0.0, 2.0 * np.pi, (2, pings, 1))
        ripple = _RIPPLE * np.sin(2.0 * np.pi * _MAINS_HZ * n * period_s * at + swing)
        total += amplitude * (1.0 + ripple) * np.cos(2.0 * np.pi * cycles * at + phase)
    return total


def _impulses(
    faults: Faults, generator: np.random.Generator, shape: tuple[int, ...], noise: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Impulses of half to one and a half times the strength given, as short as a sample, or as a filter leaves them."""
    struck = generator.uniform(size=shape) < faults.impulses
    strength = generator.uniform(0.5, 1.5, shape) * generator.choice((-1.0, 1.0), shape)
    impulses = np.where(struck, faults.impulse_sigma * noise * strength, 0.0)
    if not faults.impulse_width:
        return impulses
    reach = int(np.ceil(4.0 * faults.impulse_width))
    shape_of_one = np.exp(-0.5 * (np.arange(-reach, reach + 1) / faults.impulse_width) ** 2)
    return np.array([np.convolve(each, shape_of_one, 'same') for each in impulses])
