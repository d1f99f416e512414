"""Diffraction at corners: near the ends of walls echoes fade over a Fresnel zone, and corners echo by themselves.

Image sources end at once where a hit leaves its wall. The uniform theory of diffraction (`acoustics.wedge`) adds, for
every corner and every pair of ways to it and on, a path over the corner whose amplitude makes the whole continuous.
What is left out is what is diffracted twice.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.wedge import diffracts, wedge_coefficient
from polymap_ros.simulation.reflectors import Reflectors, straight, traced

_ASIDE = 1e-5
"""Ways are traced to a place this share of the room's size inside a corner, which is on two walls itself."""
_ALONG_RAD = 1e-9
"""Ways nearer to a wall's own direction than this lead over the wall: the coefficient has its image already."""


class Corner(NamedTuple):
    """A corner of the room.

    Attributes
    ----------
    place : ndarray, shape (2,)
        Where it is [m].
    first_rad : float
        Direction of the wall that begins there; the room is to the left of it.
    angle_rad : float
        Interior angle; more than pi where it points into the room.
    reflection : tuple of float
        Coefficients of the wall that begins there and of the one that ends there.
    """

    place: NDArray[np.float64]
    first_rad: float
    angle_rad: float
    reflection: tuple[float, float]


def diffracting_corners(vertices: NDArray[np.float64], reflection: NDArray[np.float64]) -> list[Corner]:
    """Return the corners of a ring (n, 2), with the room on the left of its edges, at which waves are diffracted."""
    found = []
    for index, place in enumerate(vertices):
        on, back = vertices[(index + 1) % len(vertices)] - place, vertices[index - 1] - place
        first, last = np.arctan2(on[1], on[0]), np.arctan2(back[1], back[0])
        angle = float((last - first) % (2.0 * np.pi))
        if diffracts(angle):
            found.append(Corner(place, float(first), angle, (float(reflection[index]), float(reflection[index - 1]))))
    return found


def diffracted(
    corners: Sequence[Corner], walls: Reflectors, emitter: NDArray[np.float64], receiver: NDArray[np.float64],
    order: int, wavenumber: float,
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Paths over one corner each, with reflections on the way to it and on.

    Parameters
    ----------
    corners : sequence of Corner
        Where waves are diffracted.
    walls : Reflectors
        All walls.
    emitter, receiver : ndarray, shape (2,)
        Their places [m].
    order : int
        Largest number of reflections, the diffraction being one of them.
    wavenumber : float
        k at the pulse's frequency [rad/m].

    Returns
    -------
    length_m : ndarray, shape (m,)
        Lengths of the paths [m].
    amplitude : ndarray, shape (m,), complex
        Their amplitudes before spreading.
    """
    lengths, amplitudes = [np.empty(0)], [np.empty(0, complex)]
    for corner in corners:
        to, strength, hits = _ways(corner, walls, emitter, order - 1)
        on, left, more = (to, strength, hits) if receiver is emitter else _ways(corner, walls, receiver, order - 1)
        i, j = np.nonzero(hits[:, None] + more[None] < order)
        if len(i):
            near, far = to[i, 0], on[j, 0]
            focus = near * far / (near + far)
            turned = wedge_coefficient(corner.angle_rad, corner.reflection, to[i, 1], on[j, 1], wavenumber, focus)
            lengths.append(near + far)
            amplitudes.append(strength[i] * left[j] * turned / np.sqrt(focus))
    return np.concatenate(lengths), np.concatenate(amplitudes)


def _ways(
    corner: Corner, walls: Reflectors, source: NDArray[np.float64], order: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return length and angle (m, 2) of the ways from a source to a corner, their amplitudes and reflections (m,)."""
    size = float(np.ptp(walls.starts, axis=0).max())
    middle = corner.first_rad + 0.5 * corner.angle_rad
    inside = corner.place + _ASIDE * size * np.array((np.cos(middle), np.sin(middle)))
    found = np.array([[*source, straight(walls, source, inside), 0.0]])
    if order:
        found = np.vstack((found, traced(walls, source, order, inside)))
    from_corner = found[:, :2] - corner.place
    angle = (np.arctan2(from_corner[:, 1], from_corner[:, 0]) - corner.first_rad) % (2.0 * np.pi)
    heard = (found[:, 2] != 0.0) & (angle > _ALONG_RAD) & (angle < corner.angle_rad - _ALONG_RAD)
    return np.column_stack((np.hypot(*from_corner.T), angle))[heard], found[heard, 2], found[heard, 3]
