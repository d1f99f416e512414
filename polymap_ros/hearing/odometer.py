"""The way that a robot has driven by its odometry, added up from ping to ping, for the errors that wheels make on it.

An error of the heading made at a place p moves a later place e by itself times (e - p), turned by a right angle. So the
covariance of what is reported between any two pings follows from the sums, over the steps between them, of the squares
of the errors, of these times p, and of these times p p^T: from differences of the sums up to each ping, whichever of
the pings between are kept (`solvers.evidence.odometry`).
"""

from dataclasses import dataclass, field
from math import remainder, tau

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import FARTHEST_M, Pose

SUMS = 15
"""Numbers of an odometer's sums."""


@dataclass(frozen=True, eq=False)
class Odometer:
    """Sums up to the last pose; none before the first.

    Parameters
    ----------
    sums : ndarray, shape (SUMS,)
        Of the way [m] (1, x, y, x x, x y, y y) at the places where it was driven; of the squares of the turns [rad^2]
        the same, at the places from which the steps set out; and of the way (u u, u v, v v), where (u, v) is its
        direction.
    last : Pose, optional
        The pose up to which they are.
    """

    sums: NDArray[np.float64] = field(default_factory=lambda: np.zeros(SUMS))
    last: Pose | None = None

    def to(self, pose: Pose) -> 'Odometer':
        """Return the state after the next pose, to which the robot turned before it drove."""
        if self.last is None:
            return Odometer(self.sums, pose)
        before, step = np.array((self.last.x, self.last.y)), np.array((pose.x - self.last.x, pose.y - self.last.y))
        way, turn = float(np.hypot(*step)), remainder(pose.yaw - self.last.yaw, tau)
        middle, along = before + 0.5 * step, _products(step) / max(way, 1e-300)
        driven = way * np.array((1.0, *middle, *_products(middle)))
        driven[3:] += way * _products(step) / 12.0  # of a line about its middle
        turned = turn**2 * np.array((1.0, *before, *_products(before)))
        return Odometer(self.sums + np.concatenate((driven, turned, along)), pose)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return all that is needed to go on, as arrays."""
        last = [] if self.last is None else [(self.last.x, self.last.y, self.last.yaw)]
        return {'sums': self.sums, 'last': np.array(last, float).reshape(-1, 3)}

    @classmethod
    def restored(cls, state: dict[str, NDArray[np.generic]]) -> 'Odometer':
        """Return what `state` gave."""
        sums, last = np.asarray(state['sums'], float), np.asarray(state['last'], float)
        if not (sums.shape == (SUMS,) and last.shape in ((0, 3), (1, 3)) and np.all(np.abs(last) <= FARTHEST_M)
                and np.all(np.isfinite(sums)) and np.all(sums[[0, 3, 5, 6, 9, 11, 12, 14]] >= 0.0)):
            raise StateError('the way driven is not that of a robot')
        return cls(sums, next((Pose(*row) for row in last.tolist()), None))


def odometer_sums(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums (N, SUMS) up to each of poses (N, 3), driven to one after the other."""
    odometer, sums = Odometer(), []
    for pose in poses.tolist():
        odometer = odometer.to(Pose(*pose))
        sums.append(odometer.sums)
    return np.array(sums).reshape(-1, SUMS)


def _products(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = vector
    return np.array((x * x, x * y, y * y))
