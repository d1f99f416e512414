"""A ping placed in the plane: what the map, the free area and the solvers are made from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Sounding:
    """One processed ping in the start frame.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the ping [ns].
    x, y : float
        Position of the sensor in the start frame [m].
    echo : ndarray, shape (n_fine,), complex64
        Eq. (3) as an analytic signal over the fine axis; its real part is eq. (3), its magnitude the envelope.
    envelope : ndarray, shape (n_ranges,), float32
        e_i(r), the magnitude of `echo`.
    rho : float
        Closest range [m]; nan where no echo stands out.
    noise : float
        Standard deviation of the noise in the real part of `echo`.
    confidence : float
        How sure it is that an echo, not noise, is at `rho`; see `ranging.confidence`.
    yaw : float
        Heading of the sensor in the start frame [rad].
    """

    stamp_ns: int
    x: float
    y: float
    echo: NDArray[np.complex64]
    envelope: NDArray[np.float32]
    rho: float
    noise: float = 1.0
    confidence: float = 1.0
    yaw: float = 0.0
