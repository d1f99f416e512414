"""One ping: the samples received after one emission."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FAINTEST, LOUDEST = 1e-100, 1e100
"""The largest sample of a ping lies between these: its energy is a number then, in whatever unit."""


@dataclass(frozen=True, eq=False)
class Ping:
    """An A-scan with its timing.

    Parameters
    ----------
    stamp_ns : int
        Time of the first sample on the odometry's clock [ns].
    samples : ndarray, shape (n,), float32 or float64
        Signed signal, or its magnitude where `echo.kind` is ``envelope``.
    period_s : float
        Sample period [s].
    t0_s : float
        Time of the first sample after emission [s].
    range_min_m, range_max_m : float
        Near-field blanking and last useful range [m]; 0: not set.
    frame_id : str
        Frame of the sensor.
    """

    stamp_ns: int
    samples: NDArray[np.floating]
    period_s: float
    t0_s: float = 0.0
    range_min_m: float = 0.0
    range_max_m: float = 0.0
    frame_id: str = ''

    @property
    def emission_ns(self) -> int:
        """Time of emission [ns], at which the sensor's pose is taken."""
        return self.stamp_ns - round(self.t0_s * 1e9)
