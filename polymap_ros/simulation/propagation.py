"""What a scene's medium does beside being a plate: it takes power on the way, changes with time, differs by direction.

All of it is off by default, and none of it is told to the mapper.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.image_sources import Images
from polymap_ros.specification import Group, parameter


@dataclass(frozen=True)
class Propagation(Group):
    """How waves travel; at the first ping, and on average over directions, as the medium says."""

    PREFIX = 'propagation.'
    attenuation_np_m: float = parameter(
        0.0, "what a metre of the way takes, at the pulse's frequency and in proportion to frequency", unit='Np/m',
        minimum=0.0, maximum=100.0)
    speed_drift: float = parameter(
        0.0, 'share by which waves are faster at the last ping than at the first, evenly with time', minimum=-0.5,
        maximum=0.5)
    anisotropy: float = parameter(
        0.0, 'e of the wavenumber k (1 - e cos 2(phi - phi0)) of a way in the direction phi: a rolled plate',
        minimum=0.0, maximum=0.2)
    anisotropy_deg: float = parameter(0.0, 'phi0, the direction in which waves are fastest', unit='deg', minimum=-360.0,
                                      maximum=360.0)

    def slowness(self, pings: int) -> NDArray[np.float64]:
        """By how much more the way takes at each of so many pings than at the first, shape (T,): a factor."""
        return 1.0 / (1.0 + self.speed_drift * np.linspace(0.0, 1.0, pings))

    @property
    def stretch(self) -> NDArray[np.float64]:
        """Matrix (2, 2) to a plane in which waves are as fast in all directions, but for e^2: there, the law of
        reflection is the ordinary one.
        """
        c, s = np.cos(2.0 * np.deg2rad(self.anisotropy_deg)), np.sin(2.0 * np.deg2rad(self.anisotropy_deg))
        return np.eye(2) - self.anisotropy * np.array([[c, s], [s, -c]])

    def length_m(self, legs: NDArray[np.float64]) -> float:
        """Length of a way along legs (k, 2) [m] in the medium of `Scene.medium` that takes as long."""
        phi = np.arctan2(legs[:, 1], legs[:, 0]) - np.deg2rad(self.anisotropy_deg)
        return float(np.hypot(*legs.T) @ (1.0 - self.anisotropy * np.cos(2.0 * phi)))


class Way(NamedTuple):
    """One path, by the walls that it meets, in order, and its points (k + 2, 2) from emitter to receiver [m]."""

    walls: NDArray[np.int64]
    points: NDArray[np.float64]

    @property
    def legs(self) -> NDArray[np.float64]:
        """From each point to the next, shape (k + 1, 2) [m]."""
        return np.diff(self.points, axis=0)


def ways(images: Images, vertices: NDArray[np.float64], receiver: NDArray[np.float64]) -> list[Way]:
    """Return the way of each of the images of a polygon (n, 2) to its receiver (2,) [m]."""
    along = np.roll(vertices, -1, axis=0) - vertices
    normals = np.column_stack((along[:, 1], -along[:, 0])) / np.hypot(*along.T)[:, None]
    offsets = np.einsum('ij,ij->i', normals, vertices)
    found = []
    for image, met, order in zip(images.position_m, images.walls, images.order, strict=True):
        points, walls = [receiver], met[:order]
        for wall in walls[::-1]:
            beyond = normals[wall] @ image - offsets[wall]
            here = normals[wall] @ points[-1] - offsets[wall]
            points.append(points[-1] + here / (here - beyond) * (image - points[-1]))
            image = image - 2.0 * beyond * normals[wall]
        found.append(Way(walls, np.array([*points, image])[::-1]))
    return found
