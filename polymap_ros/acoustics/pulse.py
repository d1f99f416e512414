"""Pulses: the excitation s(t), which starts at t = 0, and its spectrum."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import hilbert

from polymap_ros.errors import ParameterError
from polymap_ros.parameters import PulseParameters


class Pulse(Protocol):
    """An excitation s(t), zero before t = 0 and after its duration."""

    @property
    def duration_s(self) -> float:
        """Length of the pulse [s]."""

    @property
    def centre_s(self) -> float:
        """Centre of the pulse's envelope [s]."""

    def samples(self, period_s: float) -> NDArray[np.float64]:
        """s(k * period) for all k within the pulse."""

    def spectrum(self, omega_rad_s: ArrayLike) -> NDArray[np.complex128]:
        """Fourier transform, the integral of s(t) exp(-j w t) dt, at each w [rad/s]; same shape."""


@dataclass(frozen=True)
class ToneBurst:
    """A sine of some cycles under a window; the paper's excitation is 2 cycles at 100 kHz.

    Parameters
    ----------
    frequency_hz : float
        Frequency of the sine [Hz].
    cycles : float
        Length in cycles.
    hann : bool
        Hann window, else rectangular.
    """

    frequency_hz: float
    cycles: float
    hann: bool = True

    @property
    def duration_s(self) -> float:
        return self.cycles / self.frequency_hz

    @property
    def centre_s(self) -> float:
        return self.duration_s / 2.0

    def samples(self, period_s: float) -> NDArray[np.float64]:
        t = _times(self.duration_s, period_s)
        wave: NDArray[np.float64] = _window(t, self.duration_s, self.hann) * np.sin(2.0 * np.pi * self.frequency_hz * t)
        return wave

    def spectrum(self, omega_rad_s: ArrayLike) -> NDArray[np.complex128]:
        omega = np.asarray(omega_rad_s, dtype=float)
        carrier, lobe = 2.0 * np.pi * self.frequency_hz, 2.0 * np.pi / self.duration_s
        terms = [(0.5, 0.0), (-0.25, lobe), (-0.25, -lobe)] if self.hann else [(1.0, 0.0)]
        total = np.zeros(omega.shape, dtype=complex)
        for weight, shift in terms:
            total += weight / 2j * self._boxcar(carrier + shift - omega)
            total -= weight / 2j * self._boxcar(-carrier + shift - omega)
        return total

    def _boxcar(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Integral of exp(j w t) over the duration."""
        half = omega * self.duration_s / 2.0
        value: NDArray[np.complex128] = self.duration_s * np.sinc(half / np.pi) * np.exp(1j * half)
        return value


@dataclass(frozen=True)
class Chirp:
    """A linear sweep over `bandwidth_hz` about `frequency_hz` in `duration_s`, under a window."""

    frequency_hz: float
    bandwidth_hz: float
    duration_s: float
    hann: bool = True

    @property
    def centre_s(self) -> float:
        return self.duration_s / 2.0

    def samples(self, period_s: float) -> NDArray[np.float64]:
        t = _times(self.duration_s, period_s)
        start = self.frequency_hz - self.bandwidth_hz / 2.0
        phase = 2.0 * np.pi * (start * t + 0.5 * self.bandwidth_hz / self.duration_s * t * t)
        wave: NDArray[np.float64] = _window(t, self.duration_s, self.hann) * np.sin(phase)
        return wave

    def spectrum(self, omega_rad_s: ArrayLike) -> NDArray[np.complex128]:
        # Trapezoidal rule at 32 points per cycle of the highest frequency: 1e-3 at a rectangular end, far less
        # under a window that vanishes there.
        highest = self.frequency_hz + self.bandwidth_hz / 2.0
        period = self.duration_s / np.ceil(self.duration_s * highest * 32.0)
        wave = self.samples(period)
        wave[[0, -1]] /= 2.0
        return _transform(wave, period, np.asarray(omega_rad_s, dtype=float))


@dataclass(frozen=True, eq=False)
class RecordedPulse:
    """A pulse recorded at the echoes' sample rate; band-limited to half of it.

    Parameters
    ----------
    recorded : ndarray, shape (n,)
        Samples, the first at t = 0.
    period_s : float
        Sample period [s].
    """

    recorded: NDArray[np.float64]
    period_s: float

    @property
    def duration_s(self) -> float:
        return (len(self.recorded) - 1) * self.period_s

    @property
    def centre_s(self) -> float:
        energy = np.abs(hilbert(self.recorded)) ** 2
        return float(self.period_s * (energy @ np.arange(len(energy))) / energy.sum())

    def samples(self, period_s: float) -> NDArray[np.float64]:
        t = np.arange(len(self.recorded)) * self.period_s
        wave: NDArray[np.float64] = np.interp(_times(self.duration_s, period_s), t, self.recorded)
        return wave

    def spectrum(self, omega_rad_s: ArrayLike) -> NDArray[np.complex128]:
        omega = np.asarray(omega_rad_s, dtype=float)
        spectrum = _transform(self.recorded, self.period_s, omega)
        spectrum[np.abs(omega) > np.pi / self.period_s] = 0.0
        return spectrum


def _times(duration: float, period: float) -> NDArray[np.float64]:
    """All multiples of the period within the duration, both ends included."""
    times: NDArray[np.float64] = np.arange(int(duration / period + 1e-9) + 1, dtype=float) * period
    return times


def _window(t: NDArray[np.float64], duration: float, hann: bool) -> NDArray[np.float64]:
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * t / duration) if hann else np.ones_like(t)


def _transform(wave: NDArray[np.float64], period: float, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Sum of wave_k exp(-j w k period) * period, in blocks of bounded memory."""
    t = np.arange(len(wave), dtype=float) * period
    flat = omega.ravel()
    block = max(1, 4_000_000 // len(wave))
    value = np.empty(flat.shape, dtype=np.complex128)
    for i in range(0, len(flat), block):
        value[i:i + block] = period * (np.exp(-1j * np.outer(flat[i:i + block], t)) @ wave)
    return value.reshape(omega.shape)


def make_pulse(
    parameters: PulseParameters, recorded: NDArray[np.float64] | None = None, period_s: float = 0.0
) -> Pulse:
    """The pulse that the parameters describe; `recorded` are the samples of ``pulse.kind: file``.

    Raises
    ------
    ParameterError
        If a recorded pulse is asked for and is missing, not finite or silent.
    """
    hann = parameters.window == 'hann'
    if parameters.kind == 'tone_burst':
        return ToneBurst(parameters.frequency_hz, parameters.cycles, hann)
    if parameters.kind == 'chirp':
        return Chirp(parameters.frequency_hz, parameters.bandwidth_hz, parameters.duration_s, hann)
    if recorded is None or recorded.ndim != 1 or len(recorded) < 2:
        raise ParameterError('pulse.path', 'holds no row of at least two samples')
    if not np.all(np.isfinite(recorded)) or not np.any(recorded):
        raise ParameterError('pulse.path', 'its samples are not finite or all zero')
    return RecordedPulse(np.asarray(recorded, dtype=float), period_s)
