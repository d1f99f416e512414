"""How far an estimated path is from the true one, after the best rigid motion, and the walls with it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.pose import Pose


class PathError(NamedTuple):
    """Root mean square [m] and greatest [m] distance of positions, and the root mean square of headings [rad]."""

    ate_m: float
    worst_m: float
    heading_rad: float


def alignment(path: NDArray[np.float64], onto: NDArray[np.float64]) -> Pose:
    """Return the rigid motion, no scale and no mirror, that brings positions (n, 2) closest onto others.

    The least-squares solution of Horn (1987) and Umeyama (1991), which in the plane is the angle of a sum.
    """
    middle, there = path.mean(axis=0), onto.mean(axis=0)
    x, y = (path - middle).T
    u, v = (onto - there).T
    turn = Pose(0.0, 0.0, float(np.arctan2(np.sum(x * v - y * u), np.sum(x * u + y * v))))
    shift = there - turn.apply(middle)
    return Pose(float(shift[0]), float(shift[1]), turn.yaw)


def path_error(poses: NDArray[np.float64], true: NDArray[np.float64], motion: Pose) -> PathError:
    """Compare poses (n, 3), moved, with the true ones."""
    away = np.linalg.norm(motion.apply(poses[:, :2]) - true[:, :2], axis=1)
    turned = wrapped(poses[:, 2] + motion.yaw - true[:, 2])
    return PathError(float(np.sqrt(np.mean(away**2))), float(away.max()), float(np.sqrt(np.mean(turned**2))))
