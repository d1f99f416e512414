"""Pulses: the excitation s(t), which starts at t = 0, and its spectrum."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.errors import ParameterError
from polymap_ros.parameters import PulseParameters

_LONG = 2048
"""Samples of a wave from which its spectrum is not summed up term by term: that takes their number times the ping's."""

_SAME_PERIOD = 1e-4
"""A message holds a period to 1e-7 and .wav a rate in whole Hz; a pulse of 100 cycles is then off by 0.01 of one."""

_OFFSET = 0.5
"""In deviations of a recorded pulse. A pulse of one sign may have such a mean, too, but begins and ends at 0."""


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
    """A recorded pulse, band-limited to half of its sample rate, which is the echoes'.

    Parameters
    ----------
    recorded : array_like, shape (n,)
        Samples, the first at t = 0.
    period_s : float
        Sample period [s]; 0 where that is not known, and so the echoes'.
    """

    recorded: NDArray[np.float64]
    period_s: float = 0.0

    def __post_init__(self) -> None:
        """Take whole numbers and lists for samples, too."""
        object.__setattr__(self, 'recorded', np.asarray(self.recorded, dtype=float))

    def __repr__(self) -> str:
        period = f'{self.period_s:g} s' if self.period_s else "the echoes' period"
        return f'RecordedPulse({"x".join(map(str, self.recorded.shape))} samples of {period})'

    @property
    def duration_s(self) -> float:
        return (len(self.recorded) - 1) * self.period_s

    @property
    def centre_s(self) -> float:
        from scipy.signal import hilbert  # takes as long to load as all the rest of scipy that is used

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
    """Sum of wave_k exp(-j w k period) * period, in blocks of bounded memory; a long wave's by a chirp z-transform."""
    if len(wave) > _LONG and omega.ndim == 1 and len(omega) > 1:
        step = float(omega[-1] - omega[0]) / (len(omega) - 1)
        if np.allclose(np.diff(omega), step, rtol=1e-6, atol=0.0):
            from scipy.signal import czt  # takes as long to load as all the rest of scipy that is used

            return np.asarray(period * czt(
                wave, len(omega), np.exp(-1j * step * period), np.exp(1j * float(omega[0]) * period)))
    t = np.arange(len(wave), dtype=float) * period
    flat = omega.ravel()
    block = max(1, 4_000_000 // len(wave))
    value = np.empty(flat.shape, dtype=np.complex128)
    for i in range(0, len(flat), block):
        value[i:i + block] = period * (np.exp(-1j * np.outer(flat[i:i + block], t)) @ wave)
    return value.reshape(omega.shape)


def same_period(one_s: float, other_s: float) -> bool:
    """Whether two sample periods differ by less than could matter to a pulse of a hundred cycles."""
    return abs(one_s - other_s) <= _SAME_PERIOD * max(one_s, other_s)


def problem_of(recorded: NDArray[np.float64]) -> str:
    """Say why samples cannot be those of a pulse, and what is allowed; empty where they can."""
    allowed = 'allowed: at least two finite samples in one dimension, not all alike'
    if recorded.ndim != 1 or recorded.size < 2:
        return f'holds an array of shape {recorded.shape}; {allowed}'
    if bad := int(np.sum(~np.isfinite(recorded))):
        return f'{bad} of its {recorded.size} samples are not finite; {allowed}'
    if recorded.min() == recorded.max():
        return f'all of its {recorded.size} samples are {recorded[0]:g}; {allowed}'
    mean, deviation = float(recorded.mean()), float(recorded.std())
    ends = np.sign(mean) * recorded[[0, -1]]
    if abs(mean) > _OFFSET * deviation and ends.min() > 0.5 * abs(mean):
        return (f'its samples lie about {mean:.4g} with a deviation of {deviation:.3g}, and a pulse begins and ends at '
                '0; subtract that offset from the samples')
    return ''


def make_pulse(
    parameters: PulseParameters, recorded: RecordedPulse | ArrayLike | None = None, period_s: float = 0.0
) -> Pulse:
    """Return the pulse that the parameters describe; `recorded` is that of ``pulse.kind: file``, sampled at `period_s`.

    Raises
    ------
    ParameterError
        If a recorded pulse is asked for and is missing, or is none: not finite, silent, or about another value than 0.
    """
    hann = parameters.window == 'hann'
    if parameters.kind == 'tone_burst':
        return ToneBurst(parameters.frequency_hz, parameters.cycles, hann)
    if parameters.kind == 'chirp':
        return Chirp(parameters.frequency_hz, parameters.bandwidth_hz, parameters.duration_s, hann)
    if recorded is None:
        raise ParameterError('pulse.path', "no recorded pulse is given, and pulse.kind is 'file'")
    samples = recorded.recorded if isinstance(recorded, RecordedPulse) else np.asarray(recorded, dtype=float)
    if problem := problem_of(samples):
        raise ParameterError('pulse.path', problem)
    return RecordedPulse(samples, period_s)
