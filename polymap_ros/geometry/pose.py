"""A pose in the plane."""

from dataclasses import dataclass
from math import cos, degrees, isfinite, sin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.errors import UsageError

FARTHEST_M = 1e9
"""Coordinates beyond this are no place on Earth; below it cells of any grid can be counted in 64 bits."""


@dataclass(frozen=True)
class Pose:
    """Position and heading.

    Parameters
    ----------
    x, y : float
        Position [m].
    yaw : float
        Heading [rad], counter-clockwise from x (REP-103).
    """

    x: float
    y: float
    yaw: float = 0.0

    @classmethod
    def of(cls, triple: ArrayLike) -> 'Pose':
        """Return the pose of x, y [m] and yaw [rad]; raises `UsageError` for anything else."""
        try:
            x, y, yaw = np.asarray(triple, dtype=float).tolist()
            if isfinite(x + y + yaw):
                return cls(x, y, yaw)
        except (TypeError, ValueError):
            pass
        found = ' '.join(repr(triple).split())
        raise UsageError(f'pose: found {found:.80}; allowed: a Pose, or finite x, y [m] and yaw [rad]')

    @property
    def is_sound(self) -> bool:
        """Whether this can be the pose of a robot: finite, and within `FARTHEST_M`."""
        return abs(self.x) <= FARTHEST_M and abs(self.y) <= FARTHEST_M and abs(self.yaw) <= FARTHEST_M

    @property
    def text(self) -> str:
        """In words."""
        return f'({self.x:.3f}, {self.y:.3f}) m, {degrees(self.yaw):.1f} deg'

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform points (..., 2) given in this pose's frame into the frame it is expressed in."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        turned: NDArray[np.float64] = np.asarray(points, dtype=float) @ np.array([[c, s], [-s, c]])
        return turned + (self.x, self.y)

    def compose(self, other: 'Pose') -> 'Pose':
        """Express `other`, given in this pose's frame, in the frame this pose is expressed in."""
        c, s = cos(self.yaw), sin(self.yaw)
        return Pose(self.x + c * other.x - s * other.y, self.y + s * other.x + c * other.y, self.yaw + other.yaw)

    def inverse(self) -> 'Pose':
        """The pose of the outer frame, seen from this one."""
        c, s = cos(self.yaw), sin(self.yaw)
        return Pose(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)
