"""The pulse that echoes have where it is not the nominal one: a filter of that, and echoes heard by it.

With psi the compressed nominal pulse, an echo from range d is sum_l h_l psi(r - d - rho_l) after eq. (3), the taps h_l
at ranges rho_l being complex: a filter of any strength and phase over the band, as a transducer that rings is. To hear
by the true pulse is to correlate with the taps once more; then the compressed pulse is psi, correlated and convolved
with them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.hearing.pulse_shape import PulseShape
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.early_noise import early_noise
from polymap_ros.solvers.evidence.search import Search

AFTER_CYCLES = 15.0
"""Cycles of range from the nominal pulse to the last of the taps: a transducer of Q 10 rings for 13."""

_WIENER_NOISE = 0.03
"""Noise over echoes where these are loudest, of which the Wiener filter takes account: of twelve plates that failed
when heard by the pulse itself, Q 5 twice and Q 10 (even seeds), the first guess had most of the echoes' energy in
11 by 0.03, in 9 by 0.01, in 8 by 0.1 and in 6 by 0.3."""

_MOST_STEPS = 100_000
"""Steps that taps of a saved state may span."""

_PADDED = 8
"""Steps beyond the pulse that its derivatives reach."""


@dataclass(frozen=True, eq=False)
class HeardPulse:
    """The filter between the nominal pulse and the true one.

    Parameters
    ----------
    taps : ndarray, shape (L,), complex
        h_l, beside the carrier of the nominal pulse.
    first, apart : int
        Steps of the signal's axis to the first of them, and from one to the next.
    law : int
        By which of the laws that the search knows reflections turn the phase: with another one, the pulse is another.
    """

    taps: NDArray[np.complex128]
    first: int = 0
    apart: int = 1
    law: int = 0

    @cached_property
    def _whole(self) -> NDArray[np.complex128]:
        """The taps at every step."""
        whole = np.zeros((len(self.taps), self.apart), complex)
        whole[:, 0] = self.taps
        return whole.ravel()[:whole.size - self.apart + 1]

    def over(self, search: Search) -> Search:
        """Return the search over what is heard by this pulse, its law first, no delay head on being free."""
        known = list(search.edges)
        laws = [known.pop(min(self.law, len(known) - 1)), *known]
        return search.over(self.heard(search.data), tuple(law.as_pinned() for law in laws))

    def heard(self, data: EchoData) -> EchoData:
        """Return the pings heard by the true pulse, in units of the noise as before."""
        nominal, n = data.pulse, data.signal.shape[1]
        pulse, loud = self._compressed(nominal)
        signal = np.zeros((len(data.signal), n), complex)
        lags = self.first + self.apart * np.arange(len(self.taps))
        for lag, value in zip(lags[np.abs(lags) < n], self.taps[np.abs(lags) < n], strict=True):
            here, there = slice(max(-lag, 0), n - max(lag, 0)), slice(max(lag, 0), n - max(-lag, 0))
            signal[:, here] += np.conj(value) * data.signal[:, there]
        return self._in_units_of_noise(data, signal, pulse, loud)

    def sharpened(self, data: EchoData) -> EchoData:
        """Return the pings by the Wiener filter that makes nominal pulses of true ones, in units of the noise.

        Where the true pulse rings, hearing by it smears echoes over twice that time.
        """
        nominal, n = data.pulse, data.signal.shape[1]
        size = scipy.fft.next_fast_len(n + 2 * len(self._whole))
        taps = np.zeros(size, complex)
        taps[(self.first + np.arange(len(self._whole))) % size] = self._whole
        noise, true = strength_of(nominal, size), np.fft.fft(taps)
        echoes = np.abs(true) ** 2 * noise
        inverse = np.conj(true) * noise / (echoes + _WIENER_NOISE * echoes.max())
        loud = float(np.sum(np.abs(inverse) ** 2 * noise)) / size
        signal = np.fft.ifft(np.fft.fft(data.signal, size, axis=1) * inverse, axis=1)[:, :n]
        lags = np.arange(-(n // 2), n // 2 + 1)
        compressed = np.fft.ifft(inverse * true * noise)[lags]
        compressed *= np.exp(2j * nominal.carrier * nominal.step_m * lags) / compressed[n // 2].real
        return self._in_units_of_noise(data, signal, PulseShape.of(compressed, nominal.step_m), loud)

    def _in_units_of_noise(
        self, data: EchoData, signal: NDArray[np.complex128], pulse: PulseShape, loud: float
    ) -> EchoData:
        """Return pings whose signal was filtered by the taps: its noise has so much power, its compressed pulse is
        `pulse`.
        """
        nominal, n = data.pulse, data.signal.shape[1]
        ranges = nominal.step_m * np.arange(n)
        signal *= np.exp(2j * (nominal.carrier - pulse.carrier) * ranges) / np.sqrt(loud)
        other = replace(data, pulse=pulse).with_signal(signal.astype(np.complex64))
        # Of noise that is not white another part counts.
        power = other.power - other.filling[:, None]
        noise = early_noise(power, data.first_cell, data.first_m, data.cell_m, pulse.width_m)
        first = min(max(data.first_cell, int(np.ceil(pulse.width_m / data.cell_m))), power.shape[1] - 1)
        other = replace(other.with_signal(other.signal * np.float32(noise**-0.5)), first_cell=first)
        return other.up_to(data.range_max_m - len(self._whole) * nominal.step_m)  # beyond, the ringing is cut off

    def _compressed(self, nominal: PulseShape) -> tuple[PulseShape, float]:
        """The compressed true pulse of the noise's power 1, and what that power was before."""
        psi = np.convolve(np.convolve(both_sides(nominal), self._whole), np.conj(self._whole[::-1]))
        middle = len(psi) // 2
        loud = float(psi[middle].real)
        lags = np.arange(-middle, middle + 1)
        psi = psi / loud * np.exp(2j * nominal.carrier * nominal.step_m * lags)
        return PulseShape.of(np.pad(psi, _PADDED), nominal.step_m), loud

    def response(self, wavenumber: NDArray[np.float64], nominal: PulseShape) -> NDArray[np.complex128]:
        """Return the filter at wavenumbers [rad/m]: the true pulse's spectrum over the nominal one's."""
        ranges = nominal.step_m * (self.first + self.apart * np.arange(len(self.taps)))
        return np.asarray(np.exp(-2j * np.outer(wavenumber - nominal.carrier, ranges)) @ self.taps)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All of it, as arrays."""
        return {'pulse_taps': self.taps, 'pulse_at': np.array((self.first, self.apart, self.law))}

    @classmethod
    def restored(cls, state: Mapping[str, NDArray[np.generic]]) -> 'HeardPulse | None':
        """Return what `state` was made of; None where there was none."""
        if 'pulse_taps' not in state:
            return None
        taps, (first, apart, law) = np.asarray(state['pulse_taps'], complex), np.asarray(state['pulse_at']).tolist()
        if taps.ndim != 1 or not 0 < len(taps) * apart < _MOST_STEPS or not np.all(np.isfinite(taps)) or law < 0:
            raise StateError('the pulse that was found is none')
        return cls(taps, int(first), int(apart), int(law))


def both_sides(pulse: PulseShape) -> NDArray[np.complex128]:
    """Return psi without its carrier at lags -n ... n."""
    half = pulse.baseband[2:-2]
    return np.concatenate((np.conj(half[:0:-1]), half))


def strength_of(pulse: PulseShape, size: int) -> NDArray[np.float64]:
    """Return the spectrum (size,) of psi without its carrier, that of the noise's power, as an FFT has it."""
    psi, both = np.zeros(size, complex), both_sides(pulse)
    psi[np.arange(len(both)) - len(both) // 2] = both
    return np.maximum(np.fft.fft(psi).real, 0.0)
