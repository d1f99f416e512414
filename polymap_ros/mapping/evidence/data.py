"""The echoes as the likelihoods read them: in units of the noise, as a signal and as power in cells of range."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.sounding import Sounding

CELLS_PER_WIDTH = 3.0
"""Cells of range per independent width of the pulse: fine enough that the power is smooth between them."""

_SUPPORT = 1e-3
"""Share of the pulse's compressed energy that is cut off."""


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


@dataclass(frozen=True, eq=False)
class EchoData:
    """Pings as arrays.

    Attributes
    ----------
    positions : ndarray, shape (N, 2)
        Sensor positions in the start frame [m].
    signal : ndarray, shape (N, n_ranges), complex64
        Eq. (3) without the pulse's carrier, scaled so that the noise has variance 1 in its real and imaginary part.
    power : ndarray, shape (N, n_cells)
        Half the squared magnitude at multiples of `cell_m`: exponential with mean 1 where there is noise only.
    gain : ndarray, shape (N,)
        Power of each ping's echoes relative to the median ping.
    first_cell : int
        Cells before this are blanked.
    range_max_m : float
        Echoes beyond this are not predicted [m].
    cell_m : float
        Step of the cells [m].
    pulse : PulseShape
        The compressed pulse.
    spreading : float
        Amplitude ~ distance**-spreading.
    """

    positions: NDArray[np.float64]
    signal: NDArray[np.complex64]
    power: NDArray[np.float64]
    gain: NDArray[np.float64]
    first_cell: int
    range_max_m: float
    cell_m: float
    pulse: PulseShape
    spreading: float

    @property
    def weight(self) -> float:
        """Independent cells per cell: what a cell's log likelihood counts."""
        return self.cell_m / self.pulse.width_m

    @property
    def extent_m(self) -> float:
        """Diagonal of the path's bounding box [m], at least one pulse width."""
        return max(float(np.hypot(*np.ptp(self.positions, axis=0))), self.pulse.width_m)

    @classmethod
    def of(
        cls, soundings: Sequence[Sounding], pulse: PulseShape, spreading: float, blanking_m: float
    ) -> 'EchoData':
        """Gather soundings, whose echoes lie on one range axis."""
        positions = np.array([(sounding.x, sounding.y) for sounding in soundings])
        scaled = np.array([sounding.echo / np.float32(sounding.noise) for sounding in soundings])
        ranges = pulse.step_m * np.arange(scaled.shape[1])
        signal = (scaled * np.exp(-2j * pulse.carrier * ranges)).astype(np.complex64)
        stride = max(1, round(pulse.width_m / CELLS_PER_WIDTH / pulse.step_m))
        margin = len(pulse.power) + 4
        power = 0.5 * np.abs(scaled[:, :-margin:stride]).astype(float) ** 2
        first = int(np.ceil(max(blanking_m, pulse.width_m) / (stride * pulse.step_m)))
        excess = np.maximum(np.sum(power[:, first:] - 1.0, axis=1), 1.0)
        return cls(positions, signal, np.ascontiguousarray(power), excess / np.median(excess), first,
                   float(ranges[-margin]), stride * pulse.step_m, pulse, spreading)
