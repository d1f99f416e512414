"""Independent synthesis of echoes: oversampled time-domain pulses and plain FFTs, none of the project's spectra."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from polymap_ros.acoustics.medium import LambA0, Medium

OVERSAMPLING = 8
"""How much finer than the samples the synthesis is: the paper's burst at 1 MHz then holds 160 points."""


def hann_burst(t: NDArray[np.float64], frequency_hz: float = 1e5, cycles: float = 2.0) -> NDArray[np.float64]:
    """The paper's excitation at any time."""
    length = cycles / frequency_hz
    wave = np.sin(2 * np.pi * frequency_hz * t) * np.sin(np.pi * t / length) ** 2
    return np.where((t >= 0) & (t <= length), wave, 0.0)


def received(
    medium: Medium,
    pulse: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    path_m: float,
    n: int,
    period_s: float,
    t0_s: float = 0.0,
) -> NDArray[np.complex128]:
    """Analytic signal of the pulse after `path_m`, at t0 + k * period: exp(-j k d) per frequency, by eq. (1)."""
    fine = period_s / OVERSAMPLING
    total = OVERSAMPLING * int(2 ** np.ceil(np.log2(2 * n)))  # dispersed tails fit: no wrap-around to be seen
    omega = 2 * np.pi * np.fft.fftfreq(total, fine)
    positive = np.flatnonzero((omega > 0) & (omega < np.pi / period_s))
    k = medium.wavenumber(omega[positive])
    gain = path_m**-medium.spreading * (k**-0.5 if isinstance(medium, LambA0) else 1.0)
    spectrum = np.zeros(total, dtype=complex)
    spectrum[positive] = np.fft.fft(pulse(np.arange(total) * fine))[positive]
    spectrum[positive] *= 2 * gain * np.exp(-1j * k * path_m + 1j * omega[positive] * t0_s)
    return np.fft.ifft(spectrum)[: n * OVERSAMPLING : OVERSAMPLING]


@pytest.fixture(scope='session')
def plate() -> LambA0:
    """The paper's plate: 6 mm of Al 6061."""
    return LambA0(0.006, 6149.0, 3097.0)


@pytest.fixture(scope='session')
def burst() -> Callable[..., NDArray[np.float64]]:
    return hann_burst


@pytest.fixture(scope='session')
def receive() -> Callable[..., NDArray[np.complex128]]:
    return received
