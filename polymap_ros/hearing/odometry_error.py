"""What an odometry gets wrong in a steady way: the length of what it travels, and a heading that drifts with it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import Pose


@dataclass(frozen=True)
class OdometryError:
    """A scale and a drift, of which the reported poses can be freed.

    Parameters
    ----------
    scale : float
        Reported over true distance.
    yaw_drift_deg_m : float
        Turn of the reported heading per true metre travelled [deg/m], counter-clockwise.
    """

    scale: float = 1.0
    yaw_drift_deg_m: float = 0.0

    def corrected(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """True poses (N, 3) of reported ones, each x, y [m] and yaw [rad]; the first one is taken as true."""
        steps = np.diff(poses[:, 0] + 1j * poses[:, 1]) / self.scale
        travelled = np.concatenate(([0.0], np.cumsum(np.abs(steps))))
        turn = np.deg2rad(self.yaw_drift_deg_m) * travelled
        places = np.concatenate(([0.0], np.cumsum(steps * np.exp(-0.5j * (turn[1:] + turn[:-1])))))
        return np.column_stack((poses[0, 0] + places.real, poses[0, 1] + places.imag, poses[:, 2] - turn))


class OdometryCorrection:
    """Frees one pose after the other from an `OdometryError`."""

    def __init__(self, error: OdometryError) -> None:
        self._error = error
        # Last pose as reported (x, y), corrected (x, y), and how far the heading had turned [rad]; empty at first.
        self._memory: NDArray[np.float64] = np.empty(0)

    def __call__(self, pose: Pose) -> Pose:
        """The true pose of the next reported one."""
        if self._error == OdometryError():
            return pose
        if self._memory.size == 0:
            self._memory = np.array((pose.x, pose.y, pose.x, pose.y, 0.0))
            return pose
        x, y, true_x, true_y, turned = self._memory.tolist()
        # One step of the vectorised form, turned by what the heading had drifted before it.
        step = self._error.corrected(np.array(((0.0, 0.0, 0.0), (pose.x - x, pose.y - y, 0.0))))[1]
        place = Pose(true_x, true_y, -turned).apply(step[:2])
        turned -= float(step[2])
        self._memory = np.array((pose.x, pose.y, *place, turned))
        return Pose(float(place[0]), float(place[1]), pose.yaw - turned)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {'memory': self._memory.copy()}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        memory = np.array(state['memory'], float)
        if memory.shape not in ((0,), (5,)) or not np.all(np.isfinite(memory)):
            raise StateError('the correction of the odometry is not a row of numbers')
        self._memory = memory
