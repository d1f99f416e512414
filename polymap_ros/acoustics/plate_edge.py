r"""How a plate's free edge turns the phase of bending waves that it reflects.

A thin plate (Kirchhoff) whose edge is free of bending moment and effective shear reflects all of a bending wave that
comes in at an angle theta to the normal. With exp(+j w t), s = sin(theta), c = cos(theta) and Poisson's ratio nu,

    R = -(g a^2 + j c b^2) / (g a^2 - j c b^2),   a = c^2 + nu s^2,   b = 1 + (1 - nu) s^2,   g = sqrt(1 + s^2),

which follows from w = exp(-j k c x) + R exp(+j k c x) + B exp(k g x) in x < 0 with w_xx + nu w_yy = 0 and
w_xxx + (2 - nu) w_xyy = 0 at x = 0. At normal incidence R = -j whatever nu is.
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.parameters import MediumParameters


def poisson_ratio(medium: MediumParameters) -> float:
    """Return Poisson's ratio of a plate by its longitudinal and shear wave speeds."""
    ratio = (medium.longitudinal_speed_m_s / medium.shear_speed_m_s) ** 2
    return float(0.5 * (ratio - 2.0) / (ratio - 1.0))


def free_edge_delay(cosine: NDArray[np.float64], poisson: float) -> NDArray[np.float64]:
    """Return how far a free edge delays the phase [rad], -arg R, at these cosines of the angle of incidence."""
    sine2 = 1.0 - cosine**2
    a, b = cosine**2 + poisson * sine2, 1.0 + (1.0 - poisson) * sine2
    return np.asarray(np.pi - 2.0 * np.arctan2(cosine * b**2, np.sqrt(1.0 + sine2) * a**2))
