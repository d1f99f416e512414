"""The spectrum of all echoes: whether they have the pulse that was given, and a first guess of another one.

A comb of ranges leaves the mean spectrum of many echoes flat, so what it has beside the nominal pulse's is the true
pulse's. Neither walls nor poses count for it. A transducer is a resonance, and that is of minimum phase: its strength
over frequency tells its phase, and how late it makes the pulse.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.early_noise import before_echoes
from polymap_ros.solvers.evidence.heard_pulse import AFTER_CYCLES, HeardPulse, strength_of
from polymap_ros.solvers.evidence.search import Search

_IN_BAND = 0.1
"""Share of the nominal pulse's strength from which a frequency is in its band."""

_SEEN = 1e-3
"""Share of the greatest strength below which it is noise that is seen."""

_ANOTHER_PULSE = 0.2
"""Np by which the echoes' spectrum differs from the pulse's from which another one is looked for. It is 0.02 to 0.05 in
plates, rooms, other media, a second mode and under drift, 0.06 to 0.15 where a metre takes 0.35 Np; with transducers of
Q 3, 5 and 10 it is 0.4, 0.5 and 0.7 (each five scenes, even seeds)."""

RINGS_LONG = 0.6
"""Np from which a pulse rings for so long that its first guess may be late by most of a cycle, and no window of pings
tells it: of three plates at Q 10, where it is 0.7, none did."""

_OF_NOISE = 1.0
"""Times the uncertainty of the share explained that noise may make of it: plates have 0.11 at -10 dB, where that is
0.08, and 0.2 at -15 dB, where it is 0.3; transducers of Q 3 have 0.45 to 0.55 at -10 dB."""

_BINS, _NOISE_BINS = 16, 8
"""Parts of the band over which powers are added up, to tell a misfit, and the noise before the first echoes."""

_NOISE_FROM = 200
"""Widths of the pulse before the first echoes, of all pings, from which they tell the noise to a fifth in each part."""

_PADDED_TIMES = 4
"""The spectrum's points over the signal's."""


class _Spectrum(NamedTuple):
    """Frequencies in the pulse's band, rising [cycles per step], the echoes' power without the noise there, and the
    nominal pulse's.
    """

    frequency: NDArray[np.float64]
    heard: NDArray[np.float64]
    nominal: NDArray[np.float64]

    @property
    def logarithm(self) -> NDArray[np.float64]:
        """Strength over the nominal pulse's [Np]; 0 where nothing but noise is heard."""
        if not np.any(self.heard):
            return np.zeros(len(self.heard))
        return np.asarray(0.5 * np.log(np.maximum(self.heard, _SEEN * self.heard.max()) / self.nominal))


def spectral_misfit(data: EchoData) -> float:
    """Return by how much the strength of the echoes' spectrum differs from the nominal pulse's over its band [Np].

    The deviation of its logarithm, by the pulse's energy.
    """
    parts = _Spectrum(*(np.array([part.sum() for part in np.array_split(each, _BINS)]) for each in _spectrum(data)))
    mean = parts.nominal @ parts.logarithm / parts.nominal.sum()
    return float(np.sqrt(parts.nominal @ (parts.logarithm - mean) ** 2 / parts.nominal.sum()))


def is_of_another_pulse(search: Search) -> bool:
    """Whether the echoes' spectrum is not that of the nominal pulse, by more than noise makes of it."""
    return spectral_misfit(search.data) > _ANOTHER_PULSE + _OF_NOISE * search.uncertainty


def minimum_phase_pulse(data: EchoData) -> HeardPulse:
    """Return the filter of minimum phase whose strength over the band is that of the echoes.

    By the cepstrum, which asks for the strength beyond the band, too. There it falls on as a resonance's does: its
    inverse is continued as a parabola. Held as it is at the band's edges, it gives a pulse whose delay is off by 3 to
    6 mm where a cycle of range is 10, against the one that is fitted with the walls; so it is up to 1 mm at Q 3 and 5,
    and 2 to 9 at Q 10 (three, two and three plates, even seeds).
    """
    spectrum, size = _spectrum(data), _PADDED_TIMES * data.signal.shape[1]
    frequency = np.asarray(np.fft.fftfreq(size), float)
    falling = _falling(spectrum)
    rest = spectrum.logarithm - falling(spectrum.frequency)
    whole = np.interp(frequency, spectrum.frequency, rest) + falling(frequency)
    cepstrum = np.fft.ifft(whole - whole.mean())
    longest = min(int(AFTER_CYCLES * np.pi / data.pulse.carrier / data.pulse.step_m), data.signal.shape[1] - 1)
    cepstrum[1:longest] *= 2.0
    cepstrum[longest:] = 0.0
    return HeardPulse(np.fft.ifft(np.exp(np.fft.fft(cepstrum)))[:longest])


def _falling(spectrum: _Spectrum) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the logarithm of a resonance's strength over frequency [Np], constant where the spectrum has none."""
    inverse = np.exp(spectrum.logarithm.max() - spectrum.logarithm)
    weight = np.sqrt(spectrum.nominal) / inverse  # of a relative error
    parabola = np.polynomial.Polynomial.fit(spectrum.frequency, inverse, 2, w=weight)
    if np.any(parabola(np.linspace(-0.5, 0.5, len(inverse))) <= 0.0):
        return np.zeros_like
    return lambda frequency: -np.log(parabola(frequency))


def _spectrum(data: EchoData) -> _Spectrum:
    size = scipy.fft.next_fast_len(_PADDED_TIMES * data.signal.shape[1])
    strength = strength_of(data.pulse, size)
    frequency = np.asarray(np.fft.fftfreq(size), float)
    band = np.flatnonzero(strength > _IN_BAND * strength.max())
    band = band[np.argsort(frequency[band])]
    signal = data.signal[:, :int(data.range_max_m / data.pulse.step_m)]  # beyond, echoes are heard in part
    heard = _power(signal, size)[band]
    noise = np.count_nonzero(signal) * _noise(data, strength[band], band, size)
    return _Spectrum(frequency[band], np.maximum(heard - noise, 0.0) / len(signal), strength[band] ** 2)


def _noise(
    data: EchoData, strength: NDArray[np.float64], band: NDArray[np.int64], size: int
) -> NDArray[np.float64]:
    """Return the noise's power per step of the signal over the band: white noise by the pulse, but for what is heard
    before the first echoes, where that is enough to tell.
    """
    step_m, white = data.pulse.step_m, 2.0 * strength
    first = int(np.ceil(data.first_cell * data.cell_m / step_m))
    ends = before_echoes(data.first_m, step_m, data.pulse.width_m)
    steps = np.arange(data.signal.shape[1])
    early = (steps >= first) & (steps < ends[:, None])
    count = int(np.sum(early))
    if count * step_m < _NOISE_FROM * data.pulse.width_m:
        return white
    heard = _power(np.where(early, data.signal, 0.0), size)[band]
    parts = np.array_split(np.arange(len(band)), _NOISE_BINS)
    louder = [heard[part].sum() / (count * white[part].sum()) for part in parts]
    return np.asarray(white * np.interp(np.arange(len(band)), [part.mean() for part in parts], louder))


def _power(signal: NDArray[np.complex64], size: int) -> NDArray[np.float64]:
    """Return the power of all pings over frequency."""
    return np.asarray(np.sum(np.abs(scipy.fft.fft(signal, size, axis=1)) ** 2, axis=0), float)
