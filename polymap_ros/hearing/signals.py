"""What is made of one ping on its way to eq. (3), to be looked at."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Signals:
    """One ping, step by step.

    Parameters
    ----------
    steps : tuple of (str, ndarray)
        Name and samples (n,) after each step that is on; the first is the ping as received.
    time_s : ndarray, shape (n,)
        Time of the samples after emission [s].
    range_m : ndarray, shape (n,)
        Range of a wall whose echo's middle is at the sample [m].
    axis_m : ndarray, shape (n_ranges,)
        Range axis [m].
    envelope : ndarray, shape (n_ranges,)
        e(r) in units of the noise.
    rho : float
        Closest range [m]; nan where no echo stands out.
    blanking_m : float
        End of the blanking [m].
    """

    steps: tuple[tuple[str, NDArray[np.floating]], ...]
    time_s: NDArray[np.float64]
    range_m: NDArray[np.float64]
    axis_m: NDArray[np.float64]
    envelope: NDArray[np.float64]
    rho: float
    blanking_m: float
