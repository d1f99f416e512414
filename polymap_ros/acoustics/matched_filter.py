"""Eq. (3): correlation of a ping with the echo expected from a wall at every range."""

from typing import Protocol

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from polymap_ros.acoustics.medium import Medium, group_speed
from polymap_ros.acoustics.pulse import Pulse, RecordedPulse
from polymap_ros.jit import kernel

BAND_FLOOR = 1e-3
"""Frequencies at which the expected echo is weaker than this, relative to its strongest, are left out: they hold
1e-6 of its power."""

_TAPS = 8
"""Width of the interpolation kernel in bins of the zero-padded spectrum
(Fessler and Sutton, IEEE Trans. Signal Process. 51, 560, 2003)."""

_PADDING = 1.5
"""Length of the zero-padded ping in pings; with that width the error is 1e-6."""

_LATE = 0.125
"""Share of an echo's energy, the slowest, that may arrive after the ping is over."""


class EchoFilter(Protocol):
    """From the samples of a ping to an analytic signal over the range axis."""

    autocorrelation: NDArray[np.complex128]
    """What a wall's echo looks like over the differences of the range axis, 1 in the middle."""

    heard_m: float
    """Range up to which echoes are over before the ping is [m]."""

    def __call__(self, samples: NDArray[np.floating], finely: bool = True) -> NDArray[np.complex64]:
        """Filter one ping; its magnitude is the envelope e(r). Not finely: at every `fold`-th range only."""


class MatchedFilter:
    r"""Eq. (3) for a whole range axis at once.

    The echo expected from a wall at range r is, by eq. (1), z_hat(r, w) = s(w) a(w) exp(-2 j k(w) r) up to a
    factor that the normalisation of eq. (3) removes. With the frequency replaced by the wavenumber k as the
    variable of integration, the correlation is a Fourier integral over k > 0,

        c(r) = sum_k  z(w) conj(s(w) a(w)) (dw/dk) exp(2 j k r) dk / (pi |z| |z_hat|),

    one-sided and therefore analytic in r: its real part is eq. (3) and its magnitude the envelope, with no Hilbert
    transform left to do. The ping's spectrum is interpolated from an FFT to the uniform grid of k (Kaiser-Bessel
    gridding) and the sum over k is another FFT.

    Parameters
    ----------
    medium : Medium
        Dispersion k(w) and amplitude a(w).
    pulse : Pulse
        Excitation s(t).
    ranges_m : ndarray, shape (n_ranges,)
        Uniform range axis from 0 [m].
    n_samples : int
        Samples of every ping.
    period_s : float
        Sample period [s].
    t0_s : float
        Time of the first sample after emission [s].
    fold : int
        Ranges per range of the coarse axis, which takes as much less work.
    wiener_noise : float, optional
        Deconvolve: divide by |z_hat|^2 plus this share of its largest value, so that all frequencies that stand out of
        such a noise count alike. White noise comes out as strong as of eq. (3), echoes sharper and weaker.

    Attributes
    ----------
    autocorrelation : ndarray, shape (2 * n_ranges - 1,), complex128
        psi(r' - r) = c(r') of a noise-free wall at r, over the differences of the range axis, 1 in the middle.
    heard_m : float
        Range up to which echoes are over before the ping is, but for what is slowest of them, an eighth of their
        energy [m]. An echo from farther away looks like another pulse.
    """

    def __init__(
        self,
        medium: Medium,
        pulse: Pulse,
        ranges_m: NDArray[np.float64],
        n_samples: int,
        period_s: float,
        t0_s: float = 0.0,
        fold: int = 1,
        wiener_noise: float | None = None,
    ) -> None:
        step = float(ranges_m[1] - ranges_m[0])
        band = _band(medium, pulse, period_s)
        wavenumbers = medium.wavenumber(band)
        fastest = float(group_speed(medium, band / (2.0 * np.pi)).max())

        # The sum over k repeats in r with period pi / dk, which has to hold all that the samples between first and
        # last can be echoes of, the axis, and a pulse's length between the two ends.
        last = max(0.55 * fastest * (t0_s + n_samples * period_s), 1.1 * (ranges_m[-1] + step))
        first = min(0.55 * fastest * t0_s, 0.0) - fastest * pulse.duration_s
        self._fold, coarse_size = fold, scipy.fft.next_fast_len(int(np.ceil((last - first) / (fold * step))))
        size = fold * coarse_size
        dk = np.pi / (size * step)
        k = np.arange(wavenumbers[0], wavenumbers[-1], dk)
        omega = np.interp(k, wavenumbers, band)
        for _ in range(3):  # Newton's method on k(w) = k
            step_back = (medium.wavenumber(omega) - k) * group_speed(medium, omega / (2.0 * np.pi))
            omega = np.clip(omega - step_back, band[0], band[-1])
        speed = group_speed(medium, omega / (2.0 * np.pi))
        echo = pulse.spectrum(omega) * medium.excitability(omega)
        energy = float(np.sum(np.abs(echo) ** 2 * speed) * dk / np.pi)

        power = np.abs(echo) ** 2 * speed * dk / np.pi / energy
        weight = np.conj(echo) * speed * np.exp(-1j * omega * t0_s) * dk / np.pi * np.sqrt(period_s / energy)
        slowest = np.argsort(speed)
        share_over = np.cumsum(power[slowest])
        slow = float(speed[slowest[np.searchsorted(share_over, _LATE)]])
        end_s = t0_s + n_samples * period_s
        # A ping hardly longer than its pulse hears in part at any range.
        self.heard_m = 0.5 * slow * max(end_s - pulse.duration_s, 0.5 * end_s)
        if wiener_noise is not None:
            share = np.abs(echo) ** 2 / np.max(np.abs(echo) ** 2)
            inverse = 1.0 / (share + wiener_noise)
            weight *= inverse / np.sqrt(np.sum(power * inverse**2))
            power *= inverse / np.sum(power * inverse)
        self._grid = _Gridding(n_samples, omega * period_s, weight)
        self._size, self._coarse_size = size, coarse_size
        self._carrier = np.exp(2j * k[0] * ranges_m).astype(np.complex64)
        lags = np.arange(1 - len(ranges_m), len(ranges_m))
        folded = scipy.fft.ifft(_fold(power.astype(complex), size), norm='forward')
        self.autocorrelation = folded[lags] * np.exp(2j * k[0] * step * lags)

    def __call__(self, samples: NDArray[np.floating], finely: bool = True) -> NDArray[np.complex64]:
        """Correlate one ping, shape (n_samples,); returns shape (n_ranges,), at most 1 in magnitude."""
        carrier = self._carrier if finely else self._carrier[::self._fold]
        z = np.asarray(samples, dtype=float)
        norm = float(np.linalg.norm(z))
        if norm == 0.0:
            return np.zeros(len(carrier), dtype=np.complex64)
        # A sum over k that is looked at every fold-th range only cannot tell wavenumbers apart that lie so far apart.
        spectrum = self._grid(z, norm, self._size if finely else self._coarse_size)
        total: NDArray[np.complex64] = scipy.fft.ifft(spectrum, norm='forward', overwrite_x=True)[: len(carrier)]
        total *= carrier
        return total


class EnvelopeFilter:
    """For pings that hold magnitudes: the sample at range r = (t - t_c) v / 2, with t_c the pulse's centre.

    Parameters
    ----------
    speed_m_s : float
        Speed, or group speed at the pulse's frequency [m/s].
    centre_s : float
        Centre of the pulse's envelope [s].
    ranges_m, n_samples, period_s, t0_s
        As in `MatchedFilter`.

    Attributes
    ----------
    heard_m : float
        As of `MatchedFilter`.
    """

    def __init__(
        self,
        speed_m_s: float,
        centre_s: float,
        ranges_m: NDArray[np.float64],
        n_samples: int,
        period_s: float,
        t0_s: float = 0.0,
    ) -> None:
        self._sample_ranges = (t0_s + np.arange(n_samples) * period_s - centre_s) * speed_m_s / 2.0
        self._ranges = ranges_m
        self.heard_m = float(self._sample_ranges[-1]) - 0.5 * centre_s * speed_m_s
        # Magnitudes have no finer shape than a Gaussian as long as the pulse: its ends are three deviations away.
        lags = ranges_m[1] * np.arange(1 - len(ranges_m), len(ranges_m))
        deviation = max(speed_m_s * centre_s / 6.0, ranges_m[1])
        self.autocorrelation = np.exp(-0.5 * (lags / deviation) ** 2).astype(complex)

    def __call__(self, samples: NDArray[np.floating], finely: bool = True) -> NDArray[np.complex64]:
        """Resample one ping, shape (n_samples,), to the range axis; scaled by the ping's norm as in eq. (3)."""
        norm = float(np.linalg.norm(np.asarray(samples, dtype=float)))
        if norm == 0.0:
            return np.zeros(len(self._ranges), dtype=np.complex64)
        magnitude = np.interp(self._ranges, self._sample_ranges, np.abs(samples), left=0.0, right=0.0)
        scaled: NDArray[np.complex64] = (magnitude / norm).astype(np.complex64)
        return scaled


class _Gridding:
    """The spectrum sum_n z_n exp(-j w n) of n samples at arbitrary w in (0, pi) [rad / sample], times weights."""

    def __init__(self, n_samples: int, omega: NDArray[np.float64], weight: NDArray[np.complex128]) -> None:
        self._size = _quick_len(int(_PADDING * n_samples) + 2 * _TAPS)
        bins = omega * self._size / (2.0 * np.pi)
        first = np.floor(bins).astype(np.int64) - _TAPS // 2 + 1
        offsets = first[:, None] + np.arange(_TAPS)
        beta = np.pi * _TAPS * (1.0 - n_samples / (2.0 * self._size))
        inside = np.maximum(1.0 - (2.0 * (bins[:, None] - offsets) / _TAPS) ** 2, 0.0)
        self._first = (first + _TAPS).astype(np.int32)
        self._taps = np.i0(beta * np.sqrt(inside)).astype(np.float32)
        # Samples are centred about the middle one, where the kernel's transform is smooth and wide.
        self._middle = n_samples // 2
        self._weight = (weight * np.exp(-1j * omega * self._middle)).astype(np.complex64)
        t = (np.arange(n_samples) - self._middle) * 2.0 * np.pi / self._size
        argument = np.emath.sqrt(beta**2 - (_TAPS / 2.0 * t) ** 2)
        kernel_transform = np.real(_TAPS * np.sinh(argument) / argument)
        self._apodisation = 1.0 / kernel_transform

    def __call__(self, samples: NDArray[np.float64], norm: float, size: int) -> NDArray[np.complex64]:
        """The spectrum of samples / norm, with what an inverse FFT of `size` cannot tell apart added up."""
        centred, middle = np.zeros(self._size, np.float32), self._middle
        apodised = samples * (self._apodisation / norm)
        centred[:len(samples) - middle], centred[self._size - middle:] = apodised[middle:], apodised[:middle]
        half = scipy.fft.rfft(centred)
        above = self._size - len(half)  # beyond the half, a real signal's spectrum comes back conjugated
        whole = np.concatenate((half[_TAPS:0:-1].conj(), half, half[above:above - _TAPS:-1].conj()))
        folded = np.zeros(size, np.complex64)
        _interpolate(whole.view(np.float32), self._first, self._taps, self._weight, folded)
        return folded


def _quick_len(least: int) -> int:
    """Length of a real FFT: with many factors of four it is the quickest."""
    return 64 * int(scipy.fft.next_fast_len(-(-least // 64), real=True))


@kernel
def _interpolate(
    parts: NDArray[np.float32], first: NDArray[np.int32], taps: NDArray[np.float32], weight: NDArray[np.complex64],
    folded: NDArray[np.complex64],
) -> None:
    """Add up each row's taps of a spectrum given as real and imaginary parts in turn, and fold the weighted sums."""
    at = 0
    for i in range(taps.shape[0]):
        real, imaginary, start = np.float32(0.0), np.float32(0.0), 2 * first[i]
        for j in range(taps.shape[1]):
            real += taps[i, j] * parts[start + 2 * j]
            imaginary += taps[i, j] * parts[start + 2 * j + 1]
        folded[at] += weight[i] * np.complex64(complex(real, imaginary))
        at = at + 1 if at + 1 < folded.size else 0


def sampling_step(medium: Medium, pulse: Pulse, frequency_hz: float) -> float:
    """Step of a range axis [m] on which four points interpolate eq. (3) to 1e-3: four per cycle of its full band."""
    period_s = 0.125 / frequency_hz
    if isinstance(pulse, RecordedPulse):  # whose band may end beyond that
        period_s = min(period_s, pulse.period_s)
    wavenumbers = medium.wavenumber(_band(medium, pulse, period_s))
    return float(np.pi / (4.0 * (wavenumbers[-1] - wavenumbers[0])))


def _band(medium: Medium, pulse: Pulse, period_s: float) -> NDArray[np.float64]:
    """Uniform frequencies [rad/s] over the band of the expected echo, fine enough for its pulse's lobes."""
    count = max(4096, int(np.ceil(2.0 * pulse.duration_s / period_s)))
    omega = np.linspace(0.0, np.pi / period_s, count + 1)[1:]
    strength = np.abs(pulse.spectrum(omega)) * medium.excitability(omega)
    inside = np.flatnonzero(strength > BAND_FLOOR * strength.max())
    return omega[inside[0]:inside[-1] + 1]


def _fold(spectrum: NDArray[np.complexfloating], size: int) -> NDArray[np.complexfloating]:
    """Add up coefficients that an inverse FFT of `size` cannot tell apart."""
    padded = np.zeros(-(-len(spectrum) // size) * size, dtype=spectrum.dtype)
    padded[: len(spectrum)] = spectrum
    folded: NDArray[np.complexfloating] = padded.reshape(-1, size).sum(axis=0)
    return folded
