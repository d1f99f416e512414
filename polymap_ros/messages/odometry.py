"""From nav_msgs/msg/Odometry to a pose in space."""

import math
from typing import Any

from polymap_ros.errors import BadOdometry
from polymap_ros.mapping.plane import SpatialPose
from polymap_ros.mapping.pose import FARTHEST_M
from polymap_ros.messages.echoes import stamp_to_ns

NORM_TOLERANCE = 0.1
"""A quaternion whose norm is further from 1 was never filled in, or is something else."""


def stamped_pose(message: Any) -> tuple[int, str, SpatialPose]:
    """Read an odometry message, of rclpy or of rosbags.

    Returns
    -------
    stamp_ns : int
        Time of the pose [ns].
    frame_id : str
        Frame the pose is given in.
    pose : SpatialPose
        Of the robot's base.

    Raises
    ------
    BadOdometry
        For a pose that is not finite or beyond `FARTHEST_M`, or an orientation that is no rotation.
    """
    position, rotation = message.pose.pose.position, message.pose.pose.orientation
    x, y, z, w = (float(value) for value in (rotation.x, rotation.y, rotation.z, rotation.w))
    if not all(map(math.isfinite, (position.x, position.y, position.z, x, y, z, w))):
        raise BadOdometry('odometry with a pose that is not finite')
    if max(abs(position.x), abs(position.y), abs(position.z)) > FARTHEST_M:
        raise BadOdometry(f'odometry with a position beyond {FARTHEST_M:g} m')
    norm = math.hypot(x, y, z, w)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise BadOdometry(f'odometry with an orientation of norm {norm:g}; a rotation has 1')
    place = float(position.x), float(position.y), float(position.z)
    return stamp_to_ns(message.header.stamp), message.header.frame_id, SpatialPose(place, (x, y, z, w))
