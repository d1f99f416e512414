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

_IN_BAND = 0.1
"""Share of the nominal pulse's strength from which a frequency is in its band."""

_SEEN = 1e-3
"""Share of the greatest strength below which it is noise that is seen."""

_ANOTHER_PULSE = 0.2
"""Np by which the echoes' spectrum differs from the pulse's from which another one is looked for. It is 0.02 to 0.05 in
plates, rooms, other media, a second mode and under drift, 0.06 to 0.15 where a metre takes 0.35 Np; with transducers of
Q 3, 5 and 10 it is 0.43, 0.6 and 0.8 (each five scenes, even seeds)."""

_OF_NOISE = 1.0
"""Times the uncertainty of the share explained that noise may make of it: plates have 0.11 at -10 dB, where that is
0.08, and 0.2 at -15 dB, where it is 0.3; transducers of Q 3 have 0.45 to 0.55 at -10 dB."""

_BINS = 16
"""Parts of the band over which powers are added up, to tell a misfit."""

_PADDED_TIMES = 4
"""The spectrum's points over the signal's."""

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
        psi = np.convolve(np.convolve(_both_sides(nominal), self._whole), np.conj(self._whole[::-1]))
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


def spectral_misfit(data: EchoData) -> float:
    """Return by how much the strength of the echoes' spectrum differs from the nominal pulse's over its band [Np].

    The deviation of its logarithm, by the pulse's energy. Neither walls nor poses count for it.
    """
    strength, energy = (np.array([part.sum() for part in np.array_split(each, _BINS)]) for each in _strengths(data)[1:])
    logarithm = _logarithm(strength, energy)
    mean = energy @ logarithm / energy.sum()
    return float(np.sqrt(energy @ (logarithm - mean) ** 2 / energy.sum()))


def is_of_another_pulse(search: Search) -> bool:
    """Whether the echoes' spectrum is not that of the nominal pulse, by more than noise makes of it."""
    return spectral_misfit(search.data) > _ANOTHER_PULSE + _OF_NOISE * search.uncertainty


def minimum_phase_pulse(data: EchoData) -> HeardPulse:
    """Return the filter of minimum phase whose strength over the band is that of the echoes, which needs no walls.

    A resonance is one of minimum phase: its strength over frequency tells its phase, and how late it makes the pulse.
    """
    frequency, strength, energy = _strengths(data)
    logarithm = _logarithm(strength, energy)
    size = _PADDED_TIMES * data.signal.shape[1]
    whole = np.interp(np.fft.fftfreq(size), frequency, logarithm - logarithm.mean())
    cepstrum = np.fft.ifft(whole)
    longest = min(int(AFTER_CYCLES * np.pi / data.pulse.carrier / data.pulse.step_m), data.signal.shape[1] - 1)
    cepstrum[1:longest] *= 2.0
    cepstrum[longest:] = 0.0
    return HeardPulse(np.fft.ifft(np.exp(np.fft.fft(cepstrum)))[:longest])


def _logarithm(strength: NDArray[np.float64], energy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half the logarithm of the strength over the pulse's energy; 0 where nothing but noise is heard."""
    if not np.any(strength):
        return np.zeros(len(energy))
    return np.asarray(0.5 * np.log(np.maximum(strength, _SEEN * strength.max()) / energy))


def _strengths(data: EchoData) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies in the pulse's band, rising [cycles per step], the echoes' power without the noise there, and the
    nominal pulse's.
    """
    size = scipy.fft.next_fast_len(_PADDED_TIMES * data.signal.shape[1])
    psi, both = np.zeros(size, complex), _both_sides(data.pulse)
    psi[np.arange(len(both)) - len(both) // 2] = both
    spectrum = np.maximum(np.fft.fft(psi).real, 0.0)
    signal = data.signal[:, :int(data.range_max_m / data.pulse.step_m)]  # beyond, echoes are heard in part
    heard = np.mean(np.abs(scipy.fft.fft(signal, size, axis=1)) ** 2, axis=0).astype(float)
    listened = np.count_nonzero(signal) / len(signal)
    power = np.maximum(heard - 2.0 * listened * spectrum, 0.0)
    frequency = np.asarray(np.fft.fftfreq(size), float)
    band = np.flatnonzero(spectrum > _IN_BAND * spectrum.max())
    band = band[np.argsort(frequency[band])]
    return frequency[band], np.asarray(power[band], float), np.asarray(spectrum[band] ** 2, float)


def _both_sides(pulse: PulseShape) -> NDArray[np.complex128]:
    """psi without its carrier at lags -n ... n."""
    half = pulse.baseband[2:-2]
    return np.concatenate((np.conj(half[:0:-1]), half))
