"""The way that a robot has driven by its odometry, added up from ping to ping."""

from dataclasses import dataclass
from math import hypot, remainder, tau

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import FARTHEST_M, Pose


@dataclass(frozen=True)
class Odometer:
    """Way [m] and sum of the squares of the turns [rad^2] up to the last pose; None before the first."""

    driven_m: float = 0.0
    turned_rad2: float = 0.0
    last: Pose | None = None

    def to(self, pose: Pose) -> 'Odometer':
        """Return the state after the next pose."""
        if self.last is None:
            return Odometer(self.driven_m, self.turned_rad2, pose)
        turn = remainder(pose.yaw - self.last.yaw, tau)
        return Odometer(self.driven_m + hypot(pose.x - self.last.x, pose.y - self.last.y),
                        self.turned_rad2 + turn * turn, pose)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return all that is needed to go on, as arrays."""
        last = [] if self.last is None else [(self.last.x, self.last.y, self.last.yaw)]
        return {'sums': np.array([self.driven_m, self.turned_rad2]), 'last': np.array(last, float).reshape(-1, 3)}

    @classmethod
    def restored(cls, state: dict[str, NDArray[np.generic]]) -> 'Odometer':
        """Return what `state` gave."""
        sums, last = np.asarray(state['sums'], float), np.asarray(state['last'], float)
        sound = sums.shape == (2,) and last.shape in ((0, 3), (1, 3)) and np.all(np.abs(last) <= FARTHEST_M)
        if not (sound and np.all(sums >= 0.0) and np.all(np.isfinite(sums))):
            raise StateError('the way driven is not that of a robot')
        driven_m, turned_rad2 = sums.tolist()
        return cls(driven_m, turned_rad2, next((Pose(*row) for row in last.tolist()), None))
