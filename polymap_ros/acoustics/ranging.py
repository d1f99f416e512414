"""The closest range rho of a ping: the first peak of its envelope that stands out, and how sure it is an echo."""

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.noise import median
from polymap_ros.jit import kernel

RELATIVE_THRESHOLD = 0.3
"""A peak counts from this share of the strongest one. Echoes of a lossless plate add up, so that the closest wall
may well be half as strong as a later range; side lobes of a rectangular pulse reach 0.22."""

NOISE_FACTOR = 3.0
"""... and from this multiple of the envelope's median, which is noise where a ping holds mostly noise: a Rayleigh
variable exceeds three medians with a probability of 2e-3."""


def closest_range(envelope: NDArray[np.floating], step_m: float, blanking_m: float = 0.0) -> float:
    """Closest range rho_i [m] by peak detection on the envelope.

    Parameters
    ----------
    envelope : ndarray, shape (n_ranges,)
        e_i(r) on the axis 0, step, 2 step, ...
    step_m : float
        Step of the range axis [m].
    blanking_m : float
        Peaks nearer than this are left out [m].

    Returns
    -------
    float
        Range of the first local maximum above the threshold, refined by a parabola; nan if there is none.
    """
    e, first = envelope, _first_cell(step_m, blanking_m)
    if len(e) < first + 2:
        return float('nan')
    threshold = max(RELATIVE_THRESHOLD * float(e[first:].max()), NOISE_FACTOR * median(e[first:]))
    return _first_peak(e, first, threshold, step_m)


def first_echo(
    envelope: NDArray[np.floating], noise: float, step_m: float, blanking_m: float, width_m: float, false_alarm: float
) -> float:
    """Range [m] of the first peak that noise would reach anywhere in so many pings only; nan if there is none.

    How strong later echoes are does not matter. The envelope of noise rises above t deviations, on average,
    t / sqrt(2) exp(-t^2 / 2) times per independent cell of range (Rice, Bell Syst. Tech. J. 24, 46, 1945, for a pulse
    whose autocorrelation is a Gaussian).

    Parameters
    ----------
    envelope : ndarray, shape (n_ranges,)
        e_i(r) on the axis 0, step, 2 step, ...
    noise : float
        Standard deviation of the noise in eq. (3).
    step_m, blanking_m
        As in `closest_range`.
    width_m : float
        Width of an independent cell of range [m].
    false_alarm : float
        Share of the pings without echoes in which noise is taken for one.
    """
    e, first = envelope, _first_cell(step_m, blanking_m)
    if len(e) < first + 2:
        return float('nan')
    expected = -np.log1p(-false_alarm) / max((len(e) - first) * step_m / width_m, 1.0)
    t = 2.0
    for _ in range(8):  # the exponential rules, so that this settles at once
        t = float(np.sqrt(2.0 * np.log(max(t / np.sqrt(2.0) / expected, np.e))))
    return _first_peak(e, first, noise * t, step_m)


def confidence(
    envelope: NDArray[np.floating], noise: float, step_m: float, blanking_m: float, width_m: float, rho: float
) -> float:
    """Probability that noise alone stays below the peak at `rho` up to there: how sure that peak is an echo.

    Parameters as in `first_echo`; 0 where `rho` is nan.
    """
    if not isfinite(rho):
        return 0.0
    height = float(envelope[min(round(rho / step_m), len(envelope) - 1)]) / noise
    cells = max((rho - blanking_m) / width_m, 1.0)
    return float(np.exp(-cells * max(height / np.sqrt(2.0), 1.0) * np.exp(-0.5 * height**2)))


def _first_cell(step_m: float, blanking_m: float) -> int:
    return max(1, int(np.ceil(blanking_m / step_m - 1e-9)))


def _first_peak(e: NDArray[np.floating], first: int, threshold: float, step_m: float) -> float:
    """Range of the first local maximum from a cell on, and above a threshold, refined by a parabola."""
    at = _peak_from(e, first, threshold)
    if at < 0:
        return float('nan')
    left, top, right = map(float, e[at - 1:at + 2])
    return step_m * (at + 0.5 * (left - right) / (left - 2.0 * top + right))


@kernel
def _peak_from(e: NDArray[np.floating], first: int, threshold: float) -> int:
    """Index of the first local maximum from a cell on, and at or above a threshold; -1 if there is none."""
    for i in range(first, len(e) - 1):
        if e[i] >= threshold and e[i] > e[i - 1] and e[i] >= e[i + 1]:
            return i
    return -1
