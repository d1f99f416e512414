"""One ping: the samples received after one emission."""

from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.errors import UsageError

FAINTEST, LOUDEST = 1e-100, 1e100
"""The largest sample of a ping lies between these: its energy is a number then, in whatever unit."""


@dataclass(frozen=True, eq=False)
class Ping:
    """An A-scan with its timing.

    Parameters
    ----------
    stamp_ns : int
        Time of the first sample on the odometry's clock [ns].
    samples : array_like, shape (n,)
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

    def __post_init__(self) -> None:
        """Take whole numbers and lists for samples, too."""
        for name in ('stamp_ns', 'period_s', 't0_s'):
            if not isinstance(value := getattr(self, name), Real):
                raise UsageError(f'{name}: found {value!r:.80}; allowed: a number')
        samples = row_of(self.samples)
        if samples.dtype.kind in 'iu' and samples.ndim == 1:
            samples = samples.astype(np.float64 if samples.dtype.itemsize > 2 else np.float32)
        elif samples.dtype.kind == 'f' and samples.dtype.itemsize > 8:  # more than a transform takes
            samples = samples.astype(np.float64)
        if samples is not self.samples:
            object.__setattr__(self, 'samples', samples)

    def __repr__(self) -> str:
        return (f'Ping(stamp_ns={self.stamp_ns}, samples: {"x".join(map(str, self.samples.shape))} of '
                f'{self.period_s:g} s from {self.t0_s:g} s)')

    @property
    def emission_ns(self) -> int:
        """Time of emission [ns], at which the sensor's pose is taken."""
        return self.stamp_ns - round(self.t0_s * 1e9)


def row_of(samples: ArrayLike) -> NDArray[Any]:
    """Return samples as an array; raises `UsageError` for rows of several lengths."""
    try:
        return np.asarray(samples)
    except ValueError as error:
        raise UsageError('samples: found rows of several lengths; allowed: one row of numbers for each ping') from error
