"""Poses as arrays: one seen from another, and back."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import Pose


def between(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses `after` (n, 3) as seen from those `before` (n, 3)."""
    c, s = np.cos(before[:, 2]), np.sin(before[:, 2])
    x, y, turn = (after - before).T
    return np.stack((c * x + s * y, c * y - s * x, turn), axis=1)


def onward(before: NDArray[np.float64], increments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the poses (n, 3) that increments (n, 3) lead to from those `before` (n, 3)."""
    c, s = np.cos(before[:, 2]), np.sin(before[:, 2])
    x, y, turn = increments.T
    moved: NDArray[np.float64] = before + np.stack((c * x - s * y, s * x + c * y, turn), axis=1)
    return moved


def in_frame(poses: NDArray[np.float64], frame: Pose) -> NDArray[np.float64]:
    """Return poses (n, 3), seen from the frame in which `frame` is their own origin."""
    return np.column_stack((frame.apply(poses[:, :2]), poses[:, 2] + frame.yaw))
