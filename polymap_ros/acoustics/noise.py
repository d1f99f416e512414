"""How strong the noise in a ping is, from the frequencies that its pulse does not reach."""

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from polymap_ros.acoustics.medium import Medium
from polymap_ros.acoustics.pulse import Pulse

_QUIET = 1e-2
"""A frequency is quiet where the expected echo is weaker than this, relative to its strongest: -40 dB."""

_LEAST_BINS = 32
"""Fewer quiet frequencies give no estimate: the median of so many is right within 25 %."""

MODEL_ERROR = 0.2
"""Share of a ping's power that counts as noise in any case: no model of a plate, a device and its echoes to a finite
order explains more, and a likelihood that believed so would be ruled by the model's own errors."""


class NoiseGauge:
    """Standard deviation of white noise in pings of one length, relative to the ping's norm as in eq. (3).

    Parameters
    ----------
    medium, pulse
        As in `MatchedFilter`.
    n_samples : int
        Samples of every ping.
    period_s : float
        Sample period [s].
    """

    def __init__(self, medium: Medium, pulse: Pulse, n_samples: int, period_s: float) -> None:
        omega = 2.0 * np.pi * scipy.fft.rfftfreq(n_samples, period_s)
        strength = np.abs(pulse.spectrum(omega)) * medium.excitability(omega)
        self._quiet = np.flatnonzero((strength < _QUIET * strength.max()) & (omega > 0.0))
        self._floor = float(np.sqrt(MODEL_ERROR / n_samples))

    def __call__(self, samples: NDArray[np.floating], used: NDArray[np.floating] | None = None) -> float | None:
        """Noise relative to the norm of the samples; None where no frequency is quiet.

        `used` is what is made of the samples before eq. (3), and normalises it, where that is not the samples.
        """
        if len(self._quiet) < _LEAST_BINS:
            return None
        z = np.asarray(samples, dtype=np.float64)
        quiet = scipy.fft.rfft(z)[self._quiet]
        # A periodogram's values are exponential about the noise's power: the median is ln 2 of the mean.
        variance = median(quiet.real**2 + quiet.imag**2) / np.log(2.0) / len(z)
        norm = float(np.linalg.norm(z if used is None else np.asarray(used, dtype=np.float64)))
        return max(float(np.sqrt(variance)) / norm, self._floor) if norm > 0.0 else self._floor


def median(values: NDArray[np.floating]) -> float:
    """Median of one row of finite values; numpy's spends most of its time on all other cases."""
    middle = len(values) // 2
    parted = np.partition(values, middle)
    upper = float(parted[middle])
    return upper if len(values) % 2 else 0.5 * (float(parted[:middle].max()) + upper)


def noise_from_envelope(envelope: NDArray[np.floating], n_samples: int) -> float:
    """Noise from a correlation's magnitude over range, relative as in `NoiseGauge`: its quietest fifth is noise.

    The squared magnitude of noise is exponential with mean 2 sigma^2, whose lowest fifth ends at 0.22 of that.
    """
    heard = envelope[envelope > 0.0]
    floor = float(np.sqrt(MODEL_ERROR / n_samples))
    if len(heard) == 0:
        return floor
    return max(float(np.quantile(heard, 0.2) / np.sqrt(-2.0 * np.log(0.8))), floor)
