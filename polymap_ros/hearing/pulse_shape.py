"""What a single wall's echo looks like after eq. (3): the compressed pulse over range."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

_SUPPORT = 1e-3
"""Share of the pulse's compressed energy that is cut off."""

_BLURRED_TO = 4.0
"""Deviations of a Gaussian beyond which it is nothing."""


@dataclass(frozen=True, eq=False)
class PulseShape:
    """The compressed pulse psi over range, tabulated.

    Attributes
    ----------
    step_m : float
        Step of the echoes' range axis [m].
    carrier : float
        Mean wavenumber k0 [rad/m]: psi(r) = baseband(r) exp(2 j k0 r).
    baseband : ndarray, shape (n + 4,), complex128
        psi without its carrier at lags -2 ... n + 1.
    curvature : ndarray, shape (n + 4,), complex128
        Second derivative of psi, without the carrier, at the same lags.
    power : ndarray, shape (n,)
        psi squared at lags 0 ... n - 1.
    width_m : float
        Integral of psi squared: the width of an independent cell of range [m].
    """

    step_m: float
    carrier: float
    baseband: NDArray[np.complex128]
    curvature: NDArray[np.complex128]
    power: NDArray[np.float64]
    width_m: float

    @classmethod
    def of(cls, autocorrelation: NDArray[np.complex128], step_m: float) -> 'PulseShape':
        """Tabulate psi given over the lags of a range axis, shape (2 n_ranges - 1,)."""
        middle = len(autocorrelation) // 2
        power = np.abs(autocorrelation[middle:]) ** 2
        total = np.cumsum(power)
        n = min(int(np.searchsorted(total, (1.0 - _SUPPORT) * total[-1])) + 2, middle - 4)
        carrier = float(np.angle(autocorrelation[middle + 1])) / step_m / 2.0
        lags = np.arange(-4, n + 4)
        base = autocorrelation[middle + lags] * np.exp(-2j * carrier * lags * step_m)
        first = (8.0 * (base[3:-1] - base[1:-3]) - (base[4:] - base[:-4])) / (12.0 * step_m)
        second = (16.0 * (base[3:-1] + base[1:-3]) - 30.0 * base[2:-2] - base[4:] - base[:-4]) / (12.0 * step_m**2)
        curvature = second + 4j * carrier * first - 4.0 * carrier**2 * base[2:-2]
        return cls(step_m, carrier, np.ascontiguousarray(base[2:-2]), np.ascontiguousarray(curvature),
                   np.ascontiguousarray(power[:n]), step_m * float(2.0 * total[-1] - power[0]))

    def blurred(self, by_m: float) -> 'PulseShape':
        """Return the shape whose power is spread over range by a Gaussian of this deviation [m].

        The width of an independent cell stays: power that is spread is as much, and its mean is known better.
        """
        beyond = np.zeros(int(np.ceil(_BLURRED_TO * by_m / self.step_m)))
        power = np.concatenate((beyond, self.power[:0:-1], self.power, beyond))
        power = gaussian_filter1d(power, by_m / self.step_m, mode='constant')
        return replace(self, power=np.ascontiguousarray(power[len(power) // 2:]))
