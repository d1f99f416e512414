"""A resonant transducer between the excitation and the medium, and back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.acoustics.pulse import Pulse

_DECAYS = 6.0
"""Time constants after which the ringing is taken for over: 0.25 % of its amplitude are left."""


@dataclass(frozen=True)
class Transduced:
    """A pulse that has gone through a resonance of second order, once or several times.

    Parameters
    ----------
    pulse : Pulse
        What excites it.
    quality : float
        Q: f0 over the width at half power.
    centre_hz : float
        f0 [Hz].
    times : int
        2 where emitter and receiver are alike.
    """

    pulse: Pulse
    quality: float
    centre_hz: float
    times: int

    @property
    def duration_s(self) -> float:
        """Length of the pulse [s]; the ringing has decayed then."""
        return self.pulse.duration_s + self.times * _DECAYS * self.quality / (np.pi * self.centre_hz)

    @property
    def centre_s(self) -> float:
        """Centre of its energy [s]."""
        period_s = 0.05 / self.centre_hz
        energy = self.samples(period_s) ** 2
        return float(period_s * (energy @ np.arange(len(energy))) / energy.sum())

    def samples(self, period_s: float) -> NDArray[np.float64]:
        """s(k * period) for all k within the pulse, of its spectrum."""
        count = int(self.duration_s / period_s + 1e-9) + 1
        size = 4 * count
        omega = 2.0 * np.pi * np.fft.rfftfreq(size, period_s)
        return np.asarray(np.fft.irfft(self.spectrum(omega), size)[:count] / period_s)

    def spectrum(self, omega_rad_s: ArrayLike) -> NDArray[np.complex128]:
        """Fourier transform at each w [rad/s]: that of the pulse times (1 + j Q (f / f0 - f0 / f))^-times."""
        omega = np.asarray(omega_rad_s, dtype=float)
        share = omega / (2.0 * np.pi * self.centre_hz)
        detuned = share - np.divide(1.0, share, out=np.full_like(share, np.inf), where=share != 0.0)
        with np.errstate(invalid='ignore'):
            response = np.where(share == 0.0, 0.0, 1.0 / (1.0 + 1j * self.quality * detuned))
        return np.asarray(self.pulse.spectrum(omega) * response**self.times)
