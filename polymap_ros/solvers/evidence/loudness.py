"""How loud the echo over a path is, beside what its walls and its length take.

What a metre of the way takes grows with frequency, mostly in proportion to it. Then the spectrum of an echo leans to
low frequencies, which of a pulse psi(r) is, while it is little, a range with an imaginary part,
exp(-(k - k0) b) psi(r) = psi(r + j b / 2).

A wall may give back low frequencies later, or sooner, than high ones, as one with a coating or an edge that is not cut
square does: of an echo's phase that is a constant, and a slope over frequency, which shifts its envelope.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.path_room import Paths
from polymap_ros.geometry.paths import falloff
from polymap_ros.jit import kernel, within_kernels
from polymap_ros.solvers.evidence.tuning import FULL_ORDER


class Loudness(NamedTuple):
    """What the echoes of a device and a medium count for.

    Attributes
    ----------
    strengths : ndarray, shape (orders,)
        Factors by order: more or less than one where walls of one coefficient each do not say how echoes decay.
    ahead, left : float
        The device hears and speaks by 1 + `ahead` cos(phi) + `left` sin(phi) in the direction phi from the x axis of
        the base.
    loss : float
        What the way takes [Np / m], at the middle of the pulse's band.
    lean : float
        How the spectrum leans: the imaginary part of a range over the range.
    late : float
        Range by which each reflection from a wall delays the envelope [m]; what it delays the phase by is of
        `edge_phase`.
    """

    strengths: NDArray[np.float64]
    ahead: float = 0.0
    left: float = 0.0
    loss: float = 0.0
    lean: float = 0.0
    late: float = 0.0

    def up_to(self, order: int) -> 'Loudness':
        """Return the same for echoes of so many orders."""
        return self._replace(strengths=self.strengths[:order])


PLAIN = Loudness(np.ones(FULL_ORDER))
"""A device that is alike in all directions, in a medium that takes nothing."""


@kernel
def is_directed(loudness: Loudness) -> bool:
    """Whether directions count."""
    return bool(loudness.ahead != 0.0 or loudness.left != 0.0)


@within_kernels
def amplitude(
    paths: Paths, m: int, spreading: float, reflection: NDArray[np.float64], yaw: float, loudness: Loudness
) -> float:
    """b of a path: what its order counts for, its spreading, its walls' coefficients, its directions and its length.

    The directions need the derivatives `moves` of the path.
    """
    half = paths.half[m]
    b: float = paths.weight[m] * falloff(half, spreading) * loudness.strengths[paths.hits[m] + paths.bounces[m] - 1]
    for level in range(paths.hits[m]):
        b *= reflection[paths.walls[m, level]]
    if loudness.loss != 0.0:
        b *= np.exp(-2.0 * loudness.loss * half)
    if is_directed(loudness):
        c, s = np.cos(yaw), np.sin(yaw)
        for end in range(2):
            x, y = -2.0 * paths.moves[m, 2 * end], -2.0 * paths.moves[m, 2 * end + 1]
            b *= max(1.0 + loudness.ahead * (x * c + y * s) + loudness.left * (y * c - x * s), 0.0)
    return b
