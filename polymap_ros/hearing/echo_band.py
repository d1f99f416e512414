"""Where the samples have their energy, compared with the pulse: a wrong sample period shifts it by a factor."""

import dataclasses
from dataclasses import dataclass, field

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import Pulse
from polymap_ros.cautions import Caution
from polymap_ros.errors import StateError
from polymap_ros.parameters import Parameters

_PER_OCTAVE = 12
_OCTAVES = 6
"""Bands of an equal ratio, so that a factor of the period is a shift, as far from the pulse's frequency as this."""

_FURTHEST = 4 * _PER_OCTAVE
"""Shifts that are tried to either side: a factor of 16."""

_PINGS = 8, 64
"""From so many on the spectrum is judged, and more than so many tell nothing new."""

_LIKE_THE_PULSE = 0.6
"""Least cosine between the spectrum found and the shifted pulse's. With 8 pings of random scenes (plates, air, chirps,
clutter, S0 as strong as A0; seeds 2, 4, 6) it is 0.94 or more at 0 dB and 0.65 or more at -10 dB, whatever the factor:
1, 2, 4, or a half, a quarter, a tenth."""

_WORSE = 0.9
"""Share of it that the pulse where it should be may reach at most: in the same scenes 1.00 with the right period, 0.87
or less where the period is wrong by a factor of 2, and 0.45 or less by 4 or 10. Of 36 other scenes of nine kinds with
20 pings (seeds 8, 10; 0 and -10 dB) none was told with the right period, and all 144 with a wrong one."""

_NEAR = 1.42
"""A smaller factor is a transducer's, not a period's."""

_FAR_BELOW, _AS_LOUD_BELOW = 0.35, 0.4
"""Frequencies below this share of the one found, where no pulse has energy, and the mean density there, over the
greatest, from which it is noise: of noise of which a sample passes 0.9 on to the next it is 0.9."""

_BESIDE = 0.2
"""Quantile of the bands that holds noise only."""

_EDGES = 2.0 ** (np.arange(-_OCTAVES * _PER_OCTAVE, _OCTAVES * _PER_OCTAVE + 1) / _PER_OCTAVE)
_BANDS = len(_EDGES) - 1


@dataclass(frozen=True, eq=False)
class EchoBand:
    """The mean spectrum so far.

    Parameters
    ----------
    pings : int
        How many were looked at.
    density : ndarray, shape (n_bands,)
        Sum of their energy densities over the bands, relative to each one's mean.
    known : ndarray, shape (n_bands,)
        How many of them reach a band.
    """

    pings: int = 0
    density: NDArray[np.float64] = field(default_factory=lambda: np.zeros(_BANDS))
    known: NDArray[np.float64] = field(default_factory=lambda: np.zeros(_BANDS))

    def taken(self, ping: Ping, parameters: Parameters) -> 'EchoBand':
        """With one ping more, in bands about the pulse's frequency; not of magnitudes, nor where a band is chosen."""
        front_end = parameters.front_end
        chosen = front_end.band_low_hz or front_end.band_high_hz
        if self.pings == _PINGS[1] or chosen or parameters.echo.kind != 'rf':
            return self
        samples, frequency_hz = ping.samples, parameters.pulse.frequency_hz
        energy = np.abs(scipy.fft.rfft(np.asarray(samples, dtype=np.float64) - samples.mean(dtype=float))) ** 2
        line_hz = 1.0 / (len(samples) * ping.period_s)
        edges = frequency_hz * _EDGES / line_hz
        below = np.interp(edges, np.arange(len(energy) + 1) - 0.5, np.concatenate(([0.0], np.cumsum(energy))))
        reached = (edges[:-1] > 2.5) & (edges[1:] < 0.5 * len(samples))
        density = np.diff(below) / np.diff(edges) / max(float(energy.mean()), 1e-300)
        return dataclasses.replace(
            self, pings=self.pings + 1, density=self.density + np.where(reached, density, 0.0),
            known=self.known + reached)

    def factor(self, pulse: Pulse, frequency_hz: float) -> float | None:
        """Return by what the sample period seems too long; None where the energy is where the pulse has it."""
        bands = np.flatnonzero(self.known)
        if self.pings < _PINGS[0] or len(bands) < _PER_OCTAVE:
            return None
        found = self.density[bands] / self.known[bands]
        found = np.maximum(found - np.quantile(found, _BESIDE), 0.0)
        middles = 2.0 ** ((np.arange(-2 * _OCTAVES * _PER_OCTAVE, 2 * _OCTAVES * _PER_OCTAVE) + 0.5) / _PER_OCTAVE)
        expected = np.abs(pulse.spectrum(2.0 * np.pi * frequency_hz * middles)) ** 2
        whole = float(np.linalg.norm(expected))
        norm = float(np.linalg.norm(found))
        if not (whole > 0.0 and norm > 0.0):
            return None
        shifts = np.arange(-_FURTHEST, _FURTHEST + 1)
        alike = np.zeros(len(shifts))
        for index, shift in enumerate(shifts):
            shifted = expected[_OCTAVES * _PER_OCTAVE + shift + bands]
            if (part := float(np.linalg.norm(shifted))) > 0.8 * whole:  # what is beyond the samples' band cannot tell
                alike[index] = found @ shifted / part / norm
        factors = 2.0 ** (shifts / _PER_OCTAVE)
        best = int(np.argmax(alike))
        near = alike[(factors < _NEAR) & (factors > 1.0 / _NEAR)].max()
        if alike[best] < _LIKE_THE_PULSE or near > _WORSE * alike[best]:
            return None
        below = found[middles[_OCTAVES * _PER_OCTAVE + bands] * factors[best] < _FAR_BELOW]
        if len(below) and below.mean() > _AS_LOUD_BELOW * found.max():
            return None  # noise that gets louder towards low frequencies
        return float(factors[best])

    def cautions(self, pulse: Pulse, frequency_hz: float) -> tuple[Caution, ...]:
        """What the user should know of it."""
        factor = self.factor(pulse, frequency_hz)
        if factor is None:
            return ()
        much, size = (factor, 'long') if factor > 1.0 else (1.0 / factor, 'short')
        return (Caution('echo_band', f'the energy of the samples is about {frequency_hz / factor:.3g} Hz, that of the '
                        f'pulse about {frequency_hz:.3g} Hz: the sample period is likely {much:.2g} times too {size}, '
                        f'or pulse.frequency_hz is wrong'),)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {'pings': np.array(self.pings), 'density': self.density, 'known': self.known}

    @classmethod
    def restored(cls, state: dict[str, NDArray[np.generic]]) -> 'EchoBand':
        """Return what `state` was made of."""
        pings = int(state['pings'])
        density, known = (np.asarray(state[name], float) for name in ('density', 'known'))
        if not (0 <= pings <= _PINGS[1] and density.shape == known.shape == (_BANDS,)
                and np.all(np.isfinite(density)) and np.all((known >= 0.0) & (known <= pings))):
            raise StateError('the sums of the spectra are not those of pings')
        return cls(pings, density, known)
