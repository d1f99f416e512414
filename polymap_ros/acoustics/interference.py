"""What other machines put into a ping: impulses of relays and couplings, lines of motors and switching supplies."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.fft
import scipy.ndimage
from numpy.typing import NDArray

from polymap_ros.acoustics.noise import median
from polymap_ros.acoustics.pulse import Pulse

_OF_STRONGEST = 0.1
"""A frequency is in the pulse's band where the pulse is stronger than this, relative to its strongest: -20 dB."""

_LEAST_ABOVE = 0.25
"""Share of the frequencies above that band from which impulses are told by it: of each, that share is there."""

_TRANSITION = 0.1
"""Width of the band's upper edge as a share of its frequency, raised cosine."""

_OF_IMPULSE, _HARMFUL = 6.0, 1.0
"""Deviations by which an impulse exceeds what else is above the band (of white noise one sample in 10^9 does), and
those of the samples below which it does no harm."""

_USUAL, _TIMES_USUAL, _TIMES_BESIDE = 75.0, 5.0, 2.5
"""Percentile of the magnitudes within a pulse's length about a sample, of which that of an impulse is so many times as
much at least. Of a lone echo in silence no sample is more than four times as much (bursts of 1.5 to 8 cycles, 6 to 16
samples a cycle), and of noise one in 10^8; six of 27 samples may be struck. Beside one that is, less will do."""

_NEAREST_LOOKED_AT, _FARTHEST_LOOKED_AT, _SHORTEST_PULSE = 27, 255, 16
"""Bounds of that length in samples; impulses are not told from a pulse that is shorter than the last."""

_INVERSE_POWER = 0.05
"""Inverse power in the band over that above it, of echoes some times as strong as the noise."""

_IMPULSE_ROUNDS, _ONE_IN, _MOST_STRUCK = 12, 9, 0.1
"""Weaker impulses show once stronger ones are gone, one in so many samples at a time; where more than a tenth of the
samples would be some, they are not impulses."""

_AT_ENDS = 5
"""Samples at either end of a ping beside which too little is known for that."""

_MOST_SOLVED = 2000
"""Samples that are interpolated together: it takes a second then."""

_LINE, _KNOWN_LINE = 30.0, 8.0
"""A line's periodogram over the median about it, and that of a line which is known from other pings: of echoes that
happened to last, 28 was the most in 10,800 pings of plates, of right-angled ones and of rooms of air, bursts and chirps
(even seeds)."""

_NEAR_KNOWN = 0.02
"""Relative difference of its frequency from the known one: the speed of a motor is not a standard."""

_BINS_ABOUT = 65
"""Bins of that median, of a spectrum whose peaks are four bins wide."""

_LEAST_CYCLES = 8.0
"""Of a line in a ping: what is slower is hum or a baseline that drifts, which goes by its own remedy."""

_OF_PING = 0.1
"""Share of the ping that a pulse lasts at most for lines in its band to be told from its echoes."""

_QUARTERS, _LEAST_OF_MEAN, _IN_STEP = 4, 0.5, 0.7
"""A line lasts: in each of so many parts of the ping it has this share of its mean amplitude at least, and within this
angle [rad] the phase that its frequency asks for. Echoes come and go."""

_HARMLESS = 0.01
"""Share of a ping's power below which a line does no harm; without noise those of rounding stand out."""

_MOST_LINES = 8
"""Of one ping, with what looks like one; with each, one part in some hundred of the echoes' band is lost."""


class Freed(NamedTuple):
    """Samples (n,) without what other machines put into them, the frequencies of the lines taken out [Hz], and the
    share of the samples that was interpolated for impulses."""

    samples: NDArray[np.floating]
    lines_hz: tuple[float, ...] = ()
    struck: float = 0.0


class Interference:
    """Takes impulses and lines out of pings of one length and sample period.

    Parameters
    ----------
    pulse : Pulse
        What the echoes are made of: they have no energy above its band, nor any that lasts as long as the ping.
    n_samples : int
        Samples of every ping.
    period_s : float
        Sample period [s].
    """

    def __init__(self, pulse: Pulse, n_samples: int, period_s: float) -> None:
        self._n, self._period_s = n_samples, period_s
        self._size = int(scipy.fft.next_fast_len(2 * n_samples, real=True))
        frequency = np.linspace(0.0, 0.5, n_samples)  # of a cosine transform, in cycles per sample
        strength = np.abs(pulse.spectrum(2.0 * np.pi * frequency / period_s))
        top = float(frequency[strength > _OF_STRONGEST * strength.max()].max())
        share = np.clip(0.5 + (frequency - (1.0 + 0.5 * _TRANSITION) * top) / (_TRANSITION * top), 0.0, 1.0)
        self._above = 0.5 - 0.5 * np.cos(np.pi * share)
        length = pulse.duration_s / period_s
        self._near = min(int(np.clip(length, _NEAREST_LOOKED_AT, _FARTHEST_LOOKED_AT)), n_samples)
        self._tells = n_samples > _NEAREST_LOOKED_AT and length > _SHORTEST_PULSE
        band = np.interp(np.linspace(0.0, 0.5, self._size // 2 + 1), frequency, strength)
        # Echoes of a pulse that long overlap to what lasts as long as the ping.
        self._like_echoes = (band > _OF_STRONGEST * band.max()) & (pulse.duration_s > _OF_PING * n_samples * period_s)
        self._response = scipy.fft.irfft(self._above)
        self._window = np.hanning(n_samples)
        self._time = np.linspace(-1.0, 1.0, n_samples)

    def __call__(self, samples: NDArray[np.floating], known_hz: Sequence[float] = ()) -> Freed:
        """Return the samples freed of impulses, then of lines; the same array where there are none.

        Lines that other pings have at `known_hz` are taken out where they are weaker, too.
        """
        calm = self._without_impulses(samples)
        struck = 0 if calm is samples else int(np.sum(calm != samples))
        freed = self._without_lines(calm, known_hz)
        if freed.lines_hz:  # beside a line only the strongest impulses stand out
            calm = self._without_impulses(freed.samples)
            struck += int(np.sum(calm != freed.samples))
        return Freed(calm, freed.lines_hz, struck / self._n)

    def _without_impulses(self, samples: NDArray[np.floating]) -> NDArray[np.floating]:
        """Samples in which those that are struck are interpolated, the strongest of a place first.

        Impulses are told by what they hold above the band. Interpolated is what is most likely of a signal with so much
        less power there than in it.
        """
        if not self._tells or self._response[0] < _LEAST_ABOVE:
            return samples
        freed = np.array(samples, dtype=float)
        offset = float(np.median(freed))
        freed -= offset
        ends, struck = self._bounded_at_ends(freed), np.zeros(self._n, bool)
        above = left = self._above_band(freed)
        for _ in range(_IMPULSE_ROUNDS):
            harmful = _HARMFUL * float(freed.std())
            size = np.abs(left)
            peaks = size == scipy.ndimage.maximum_filter1d(size, _ONE_IN)
            told = peaks & (size > max(_OF_IMPULSE * _deviation(left), harmful * self._response[0]))
            if not (told.any() or struck.any()):
                break
            usual = scipy.ndimage.percentile_filter(np.abs(freed), _USUAL, self._near, mode='nearest')
            outlying = np.abs(freed) > np.maximum(_TIMES_USUAL * usual, harmful)  # no echo is that, however clipped
            beside = np.abs(freed) > np.maximum(_TIMES_BESIDE * usual, harmful)
            new = told & scipy.ndimage.maximum_filter1d(outlying, 3)
            new |= beside & scipy.ndimage.maximum_filter1d(struck, _ONE_IN)
            new[:_AT_ENDS] = new[-_AT_ENDS:] = False  # where the mirror makes a bend
            if not np.any(new & ~struck):
                break
            struck |= new
            if struck.sum() > min(_MOST_STRUCK * self._n, _MOST_SOLVED):
                return samples
            at = np.flatnonzero(struck)
            weighted = _INVERSE_POWER * (samples[at] - offset) + (1.0 - _INVERSE_POWER) * above[at]
            weights = _INVERSE_POWER * np.eye(len(at)) + (1.0 - _INVERSE_POWER) * self._responses(at)
            freed[at] = samples[at] - offset - np.linalg.solve(weights, weighted)
            left = self._above_band(freed)
        changed = struck | ends
        return np.where(changed, (freed + offset).astype(samples.dtype), samples) if changed.any() else samples

    def _bounded_at_ends(self, samples: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Bound the first and last samples by what is usual beside them, in place; return which were more (n,)."""
        bound = np.full(self._n, np.inf)
        for end, beside in ((slice(_AT_ENDS), slice(self._near)), (slice(-_AT_ENDS, None), slice(-self._near, None))):
            bound[end] = _TIMES_USUAL * float(np.percentile(np.abs(samples[beside]), _USUAL))
        beyond = np.abs(samples) > bound
        samples[beyond] = np.sign(samples[beyond]) * bound[beyond]
        return beyond

    def _above_band(self, samples: NDArray[np.floating]) -> NDArray[np.floating]:
        """What the samples (n,) hold above the pulse's band; they go on mirrored, so that their ends are no steps."""
        return np.asarray(scipy.fft.idct(scipy.fft.dct(samples, 1) * self._above, 1))

    def _responses(self, at: NDArray[np.int64]) -> NDArray[np.float64]:
        """What unit impulses at these samples (m,) leave above the band at each of them, (m, m), with their images."""
        apart, to_image = np.abs(at[:, None] - at), (at[:, None] + at) % len(self._response)
        own_image = (at == 0) | (at == self._n - 1)
        return np.asarray(self._response[apart] + np.where(own_image, 0.0, self._response[to_image]))

    def _without_lines(self, samples: NDArray[np.floating], known_hz: Sequence[float]) -> Freed:
        """Samples less the sines that last as long as the ping, the strongest first.

        Amplitude and phase of each may change linearly over the ping, as those of a motor, and of a frequency that is
        not found exactly.
        """
        found: list[float] = []
        bins = np.arange(self._size // 2 + 1)
        peak = np.full(len(bins), _LINE)
        for known in np.array(known_hz) * self._period_s * self._size:
            peak[np.abs(bins - known) < _NEAR_KNOWN * known] = _KNOWN_LINE
        peak[self._like_echoes] = np.inf
        peak[bins < _LEAST_CYCLES * self._size / self._n] = np.inf
        for _ in range(_MOST_LINES):
            about_zero = samples - samples.mean(dtype=float)
            density = np.abs(scipy.fft.rfft(about_zero * self._window, self._size)) ** 2
            about = scipy.ndimage.median_filter(density, _BINS_ABOUT, mode='nearest')
            stands_out = np.where(density > peak * about, density, 0.0)
            best = int(np.argmax(stands_out))
            if stands_out[best] == 0.0 or not 0 < best < len(density) - 1:
                break
            frequency = (best + _vertex(np.log(density[best - 1:best + 2]))) / self._size
            wave = np.exp(2j * np.pi * frequency * np.arange(self._n))
            if not _lasts(about_zero * wave.conj(), _HARMLESS * float(np.mean(about_zero**2))):
                peak[max(best - 4, 0):best + 5] = np.inf  # echoes of a narrow band, beside which there may be a line
                continue
            columns = np.column_stack((wave.real, wave.imag, self._time * wave.real, self._time * wave.imag))
            samples = samples - (columns @ np.linalg.lstsq(columns, about_zero, rcond=None)[0]).astype(samples.dtype)
            found.append(frequency / self._period_s)
        return Freed(samples, tuple(found))


def _deviation(values: NDArray[np.floating]) -> float:
    """Standard deviation of most of the values (n,), as if they were Gaussian, whatever a few of them are."""
    return median(np.abs(values)) / 0.6745


def _vertex(heights: NDArray[np.floating]) -> float:
    """Where the parabola through three neighbours is highest, from the middle one."""
    before, top, after = heights
    return float(0.5 * (before - after) / (before - 2.0 * top + after))


def _lasts(shifted: NDArray[np.complexfloating], least: float) -> bool:
    """Whether a line, shifted to 0 Hz, is in all parts of the ping, and of so much power."""
    size = len(shifted) // _QUARTERS
    parts = shifted[:_QUARTERS * size].reshape(_QUARTERS, size).mean(axis=1)
    mean = parts.mean()
    if 2.0 * abs(mean) ** 2 < least:
        return False
    lasting, turned = np.abs(parts) > _LEAST_OF_MEAN * abs(mean), np.abs(np.angle(parts / mean))
    return bool(np.all(lasting & (turned < _IN_STEP)))
