"""What is done to a ping's samples before eq. (3): one function per step, each on samples (n,) or (N, n)."""

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from polymap_ros.parameters import FrontEndParameters

_CLIPPED_RUN = 2
"""A ping's largest or smallest value, so many times in a row, is the end of the converter: noise hardly repeats it."""

_DROPOUT_RUN = 16
"""So many equal samples, whatever their value, are a dropout: a converter's last digit flickers."""

_OFFSET = 0.5
"""In deviations of the samples. Pings of plates stay below 0.05; walls are found up to 3, and none from 10 on."""

_DRIFT = 0.5
"""Variance of a ping's eighths' means over the rest. Pings of plates stay below 0.01; walls are lost from 10 on."""

_SURE_FLOOR = 1.0
"""In deviations of the magnitudes; a lower one hides no peak."""

_TRANSITION = 0.1
"""Width of a band's edge as a share of its frequency."""


def clipped(samples: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Which samples (n,) are at the ping's largest or smallest value, where that is the converter's end."""
    again = _in_runs(samples, _CLIPPED_RUN)
    ends = [samples == end for end in (samples.max(), samples.min())]
    found: NDArray[np.bool_] = np.any([at & np.any(at & again) for at in ends], axis=0)
    return found


def dropped_out(samples: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Which samples (n,) are in a run of at least sixteen equal ones."""
    return _in_runs(samples, _DROPOUT_RUN)


def _in_runs(samples: NDArray[np.floating], length: int) -> NDArray[np.bool_]:
    """Which samples are in a run of at least `length` equal ones."""
    starts = np.flatnonzero(np.concatenate(([True], samples[1:] != samples[:-1])))
    lengths = np.diff(np.append(starts, len(samples)))
    return np.repeat(lengths >= length, lengths)


def has_offset(samples: NDArray[np.floating]) -> bool:
    """Whether the mean of the samples (n,) is more than a signal about zero has."""
    return bool(abs(samples.mean(dtype=float)) > _OFFSET * samples.std(dtype=float))


def drifts(samples: NDArray[np.floating]) -> bool:
    """Whether the baseline of a ping (n,) moves within it: a ramp, a recovery after the pulse, hum."""
    if (length := len(samples) // 8) < 8:
        return False
    eighths = np.asarray(samples[:8 * length], dtype=float).reshape(8, length)
    slow = float(eighths.mean(axis=1).var())
    return slow > _DRIFT * max(float(eighths.var()) - slow, 0.0)


def floor_of(magnitudes: NDArray[np.floating]) -> float:
    """Return what lies below all magnitudes (n,), those of noise included; 0 where their noise begins at 0 itself.

    Magnitudes of 0 are a device's own blanking. Noise (Rayleigh) has its lowest fiftieth at 0.201 and its median at
    1.177 deviations, which tells where it begins.
    """
    heard = magnitudes[magnitudes > 0.0]
    if len(heard) < 2:
        return 0.0
    low, middle = len(heard) // 50, len(heard) // 2
    parted = np.partition(heard, (low, middle))
    floor = float(parted[low]) - 0.201 / (1.177 - 0.201) * float(parted[middle] - parted[low])
    return floor if floor > _SURE_FLOOR * float(heard.std(dtype=float)) else 0.0


def without_slope(samples: NDArray[np.floating], over: int) -> NDArray[np.floating]:
    """Samples (n,) less the line through the means of `over` samples at both ends, so that none of them is a step."""
    n = len(samples)
    over = min(max(over, 1), n)
    first, last = (float(part.mean(dtype=float)) for part in (samples[:over], samples[-over:]))
    share = np.arange(n) - 0.5 * (over - 1)
    less: NDArray[np.floating] = samples - (first + (last - first) * share / max(n - over, 1)).astype(samples.dtype)
    return less


def without_dc(samples: NDArray[np.floating]) -> NDArray[np.floating]:
    """Samples less their mean."""
    less: NDArray[np.floating] = samples - samples.mean(axis=-1, keepdims=True)
    return less


def band_pass(n_samples: int, period_s: float, low_hz: float, high_hz: float) -> NDArray[np.float64]:
    """Gain of a zero-phase band-pass at the frequencies of `in_band`, shape (n,); an edge of 0 Hz is none.

    The edges are raised cosines that reach one half at the frequency given.
    """
    frequency = scipy.fft.rfftfreq(_padded(n_samples), period_s)
    gain: NDArray[np.float64] = np.ones(len(frequency))
    for edge, sign in ((low_hz, 1.0), (high_hz, -1.0)):
        if edge > 0.0:
            share = np.clip(0.5 + sign * (frequency - edge) / (_TRANSITION * edge), 0.0, 1.0)
            gain *= 0.5 - 0.5 * np.cos(np.pi * share)
    return gain


def in_band(samples: NDArray[np.floating], gain: NDArray[np.float64]) -> NDArray[np.floating]:
    """Samples after the band-pass of `gain`; the ping is taken as silent before and after."""
    n = samples.shape[-1]
    spectrum = scipy.fft.rfft(samples, _padded(n), axis=-1)
    return np.asarray(scipy.fft.irfft(spectrum * gain, _padded(n), axis=-1)[..., :n])


def _padded(n_samples: int) -> int:
    """So that the end of a ping does not ring in its beginning."""
    return int(scipy.fft.next_fast_len(2 * n_samples, real=True))


def mute(n_samples: int, period_s: float, t0_s: float, until_s: float, over_s: float) -> NDArray[np.float64]:
    """Weights (n,) that are 0 up to `over_s` before the time `until_s` after emission [s] and 1 from there on."""
    t = t0_s + np.arange(n_samples) * period_s
    share = np.clip(1.0 - (until_s - t) / max(over_s, period_s), 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * share))


def time_gain(n_samples: int, period_s: float, t0_s: float, gain_db_s: float) -> NDArray[np.float64]:
    """Factors (n,) of a gain that is 1 at emission and grows by so many dB per second."""
    t = t0_s + np.arange(n_samples) * period_s
    return np.asarray(10.0 ** (gain_db_s * t / 20.0))


class FrontEnd:
    """The steps that the parameters ask for, on pings of one length, period and start.

    Parameters
    ----------
    parameters : FrontEndParameters
        Which steps.
    magnitudes : bool
        The samples are magnitudes, and stay so: nothing gets below 0.
    n_samples, period_s, t0_s
        Of every ping.
    pulse_s : float
        Duration of the pulse [s], over which muting fades.
    """

    def __init__(
        self, parameters: FrontEndParameters, magnitudes: bool, n_samples: int, period_s: float, t0_s: float,
        pulse_s: float,
    ) -> None:
        self._parameters, self._magnitudes = parameters, magnitudes
        self._axis = n_samples, period_s, t0_s
        self._pulse_s = pulse_s
        self._gain = time_gain(*self._axis, parameters.gain_db_s) if parameters.gain_db_s else None
        low_hz, high_hz = parameters.band_low_hz, parameters.band_high_hz
        self._band = band_pass(n_samples, period_s, low_hz, high_hz) if low_hz or high_hz else None
        self._slow = round(min(1.0 / (low_hz * period_s), n_samples / 8)) if low_hz and not magnitudes else 0

    def levelled(self, samples: NDArray[np.floating]) -> NDArray[np.floating]:
        """Samples without DC and with the time's gain: their noise is still white.

        An offset is taken out in any case, since the step at both ends of the ping would drown what is between them,
        and so is a floor of magnitudes, beside which no peak stands out. Where the band has a lower end, so is the
        slope of a baseline that drifts, whose steps would be in the band.
        """
        if self._parameters.remove_dc or (not self._magnitudes and has_offset(samples)):
            samples = without_dc(samples)
        elif self._magnitudes and (floor := floor_of(samples)):
            samples = np.maximum(samples - samples.dtype.type(floor), 0.0)
        if self._slow and drifts(samples):
            samples = without_slope(samples, self._slow)
        if self._gain is not None:
            samples = samples * self._gain
        return samples

    def limited(self, samples: NDArray[np.floating], blanked_s: float) -> NDArray[np.floating]:
        """What `levelled` gave, in the band, and silent before the time `blanked_s` after emission [s]."""
        if self._band is not None:
            samples = in_band(samples, self._band)
        if self._parameters.mute_blanking:
            samples = samples * mute(*self._axis, blanked_s, self._pulse_s)
        return np.maximum(samples, 0.0) if self._magnitudes else samples
