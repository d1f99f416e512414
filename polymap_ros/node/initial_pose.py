"""Where somebody says that the robot is, in a map that is given: as RViz's "2D Pose Estimate" sends it."""

import math
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from polymap_ros.errors import UsageError
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.odometry import NORM_TOLERANCE
from polymap_ros.node.factory import message_class
from polymap_ros.node.qos import no_events

_PLACE_M, _HEADING_RAD = 0.5, 0.26
"""Deviations that are assumed where a message gives none: those of RViz."""


class InitialPose:
    """Takes poses on `initialpose`.

    Parameters
    ----------
    node : Node
        The subscriber.
    mapper : PolygonMapper
        Looks for the robot there.
    """

    def __init__(self, node: Node, mapper: PolygonMapper) -> None:
        self._logger, self._mapper = node.get_logger(), mapper
        node.create_subscription(message_class('geometry_msgs/msg/PoseWithCovarianceStamped'), 'initialpose',
                                 self._take, QoSProfile(depth=10), event_callbacks=no_events())

    def _take(self, message: Any) -> None:
        position, rotation = message.pose.pose.position, message.pose.pose.orientation
        numbers = (position.x, position.y, rotation.x, rotation.y, rotation.z, rotation.w)
        frame_id = message.header.frame_id
        try:
            if frame_id and frame_id != self._mapper.map_frame:
                raise UsageError(f'it is in frame {frame_id!r}, the map is in {self._mapper.map_frame!r}')
            if not all(map(math.isfinite, numbers)) or abs(math.hypot(*numbers[2:]) - 1.0) > NORM_TOLERANCE:
                raise UsageError('it is no pose: finite numbers and a unit quaternion are needed')
            x, y, z, w = numbers[2:]
            yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
            pose = Pose(float(position.x), float(position.y), yaw)
            place_m = _deviation(max(message.pose.covariance[0], message.pose.covariance[7]), _PLACE_M)
            heading_rad = _deviation(message.pose.covariance[35], _HEADING_RAD)
            self._mapper.expect(pose, place_m, heading_rad)
        except UsageError as error:
            self._logger.warning(f'initialpose is not taken: {error}')
            return
        self._logger.info(f'initialpose: looking for the robot within {3.0 * place_m:.2f} m of {pose.text}')


def _deviation(variance: float, default: float) -> float:
    """Return the deviation that a message gives; the default where it is nothing, or absurd."""
    return math.sqrt(variance) if 0.0 < variance < math.inf else default
