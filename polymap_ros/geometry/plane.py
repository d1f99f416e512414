"""The mapping plane: where in space the polygon lies, and how a pose in space is seen in it."""

from dataclasses import dataclass
from functools import cached_property
from math import acos, atan2, hypot, inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import FARTHEST_M, Pose

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class SpatialPose:
    """Position [m] and orientation, a quaternion (x, y, z, w) of any length but 0, in the odometry's frame."""

    position: Vector
    orientation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    @property
    def is_sound(self) -> bool:
        """Whether this can be the pose of a robot: a rotation at a finite place within `FARTHEST_M`."""
        (x, y, z), length = self.position, hypot(*self.orientation)
        return abs(x) <= FARTHEST_M and abs(y) <= FARTHEST_M and abs(z) <= FARTHEST_M and 0.0 < length < inf

    @property
    def forward(self) -> Vector:
        """The x axis."""
        x, y, z, w = self.orientation
        n = x * x + y * y + z * z + w * w
        return (w * w + x * x - y * y - z * z) / n, 2.0 * (x * y + w * z) / n, 2.0 * (x * z - w * y) / n

    @property
    def left(self) -> Vector:
        """The y axis."""
        x, y, z, w = self.orientation
        n = x * x + y * y + z * z + w * w
        return 2.0 * (x * y - w * z) / n, (w * w - x * x + y * y - z * z) / n, 2.0 * (y * z + w * x) / n

    @property
    def up(self) -> Vector:
        """The z axis."""
        x, y, z, w = self.orientation
        n = x * x + y * y + z * z + w * w
        return 2.0 * (x * z + w * y) / n, 2.0 * (y * z - w * x) / n, (w * w - x * x - y * y + z * z) / n

    def apply(self, point: Vector) -> Vector:
        """A point given in this pose's frame, in the frame the pose is expressed in."""
        (a, b, c), axes = point, (self.forward, self.left, self.up)
        x, y, z = (origin + a * f + b * g + c * h for origin, f, g, h in zip(self.position, *axes, strict=True))
        return x, y, z

    def apply_inverse(self, point: Vector) -> Vector:
        """Undo `apply`."""
        away = _minus(point, self.position)
        return _dot(away, self.forward), _dot(away, self.left), _dot(away, self.up)


class Placed(NamedTuple):
    """A pose in the plane, and how far the robot is off it: height [m] and tilt [rad]."""

    pose: Pose
    height_m: float = 0.0
    tilt_rad: float = 0.0

    @property
    def is_sound(self) -> bool:
        """Whether this can be the pose of a robot."""
        return self.pose.is_sound


@dataclass(frozen=True)
class Plane:
    """The mapping plane in the odometry's frame.

    Parameters
    ----------
    frame : SpatialPose
        Its x and y axes span the plane; coordinates in the plane count from its position.
    level_m : float
        Height over the plane's origin at which the robot is on the plane [m].
    """

    frame: SpatialPose
    level_m: float = 0.0

    @classmethod
    def of(cls, kind: str, first: SpatialPose) -> 'Plane':
        """The plane of ``odometry.plane``, with the odometry's first pose on it."""
        return cls(first) if kind == 'first_pose' else cls(XY.frame, first.position[2])

    @property
    def is_xy(self) -> bool:
        """Whether coordinates in the plane are the odometry's x and y."""
        return self.frame == XY.frame

    def named(self, frame_id: str) -> str:
        """What coordinates in the plane are said to be in."""
        return frame_id if self.is_xy else f'the plane of the first pose in {frame_id}'

    @cached_property
    def axes(self) -> tuple[Vector, Vector, Vector]:
        """x, y and normal of the plane, unit vectors in the odometry's frame."""
        return self.frame.forward, self.frame.left, self.frame.up

    def place(self, pose: SpatialPose) -> Placed:
        """A pose as seen in the plane: its heading is that of the robot's x axis."""
        x_axis, y_axis, normal = self.axes
        place = _minus(pose.position, self.frame.position)
        forward = pose.forward
        yaw = atan2(_dot(forward, y_axis), _dot(forward, x_axis))
        tilt_rad = acos(max(-1.0, min(1.0, _dot(pose.up, normal))))
        return Placed(Pose(_dot(place, x_axis), _dot(place, y_axis), yaw), _dot(place, normal) - self.level_m, tilt_rad)

    def points(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (n, 2) of the plane [m] as points (n, 3) in the odometry's frame."""
        within: NDArray[np.float64] = np.asarray(coordinates, dtype=float).reshape(-1, 2)
        points: NDArray[np.float64] = within @ np.array(self.axes[:2]) + self.frame.position
        return points

    def spatial(self, pose: Pose) -> SpatialPose:
        """A pose in the plane as a pose in the odometry's frame."""
        x, y, z, w = self.frame.orientation
        length = hypot(x, y, z, w)
        s, c = float(np.sin(pose.yaw / 2)) / length, float(np.cos(pose.yaw / 2)) / length
        px, py, pz = self.points(np.array([[pose.x, pose.y]]))[0].tolist()
        return SpatialPose((px, py, pz), (x * c + y * s, y * c - x * s, z * c + w * s, w * c - z * s))


XY = Plane(SpatialPose((0.0, 0.0, 0.0)))
"""The odometry's own xy plane."""


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
