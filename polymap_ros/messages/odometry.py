"""From nav_msgs/msg/Odometry to a pose in space."""

import math
import struct
from typing import Any, NamedTuple

from polymap_ros.errors import BadOdometry
from polymap_ros.geometry.plane import SpatialPose
from polymap_ros.geometry.pose import FARTHEST_M
from polymap_ros.messages.echoes import stamp_to_ns

NORM_TOLERANCE = 0.1
"""A quaternion whose norm is further from 1 was never filled in, or is something else."""

_HEAD, _LENGTH, _POSE = struct.Struct('<iII'), struct.Struct('<I'), struct.Struct('<7d')
_PLAIN_CDR, _START = b'\x00\x01', 4
_NUMBERS = 8 * (7 + 36 + 6 + 36)


class Reported(NamedTuple):
    """What is needed of an odometry message, as it was sent."""

    stamp_ns: int
    frame_id: str
    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]


def stamped_pose(message: Any) -> tuple[int, str, SpatialPose]:
    """Read an odometry message, of rclpy or of rosbags, or what `odometry_from_cdr` left of one.

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
    stamp_ns, frame_id, position, orientation = message if isinstance(message, Reported) else _reported(message)
    if not all(map(math.isfinite, position + orientation)):
        raise BadOdometry('odometry with a pose that is not finite')
    if max(position) > FARTHEST_M or min(position) < -FARTHEST_M:
        raise BadOdometry(f'odometry with a position beyond {FARTHEST_M:g} m')
    norm = math.hypot(*orientation)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise BadOdometry(f'odometry with an orientation of norm {norm:g}; a rotation has 1')
    return stamp_ns, frame_id, SpatialPose(position, orientation)


def _reported(message: Any) -> Reported:
    position, rotation = message.pose.pose.position, message.pose.pose.orientation
    return Reported(stamp_to_ns(message.header.stamp), message.header.frame_id,
                    (float(position.x), float(position.y), float(position.z)),
                    (float(rotation.x), float(rotation.y), float(rotation.z), float(rotation.w)))


def odometry_from_cdr(data: bytes) -> Reported | None:
    """What is needed of the bytes of a message, in a fifth of the time that all of it takes.

    None where they are not those of plain little-endian CDR, whole, with frames in ASCII: to be decoded in full, or
    refused.
    """
    try:
        sec, nanosec, length = _HEAD.unpack_from(data, _START)
        end = _START + _HEAD.size + length
        child = end + -end % 4
        child_end = child + _LENGTH.size + _LENGTH.unpack_from(data, child)[0]
        at = child_end + (_START - child_end) % 8
        frame, child_frame = data[_START + _HEAD.size:end], data[child + _LENGTH.size:child_end]
        whole = 0 <= len(data) - at - _NUMBERS < 4 and frame[-1] == child_frame[-1] == 0
        if not (whole and data[:2] == _PLAIN_CDR and frame.isascii() and child_frame.isascii()):
            return None
        x, y, z, *orientation = _POSE.unpack_from(data, at)
    except (struct.error, IndexError):
        return None
    return Reported(1_000_000_000 * sec + nanosec, frame[:-1].decode('ascii'), (x, y, z), tuple(orientation))
