"""Where the robot is in the map: ~/pose at every ping, and TF from the map's frame to the odometry's."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.plane import XY
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.outputs import pose_message, pose_with_covariance_message, transform_message
from polymap_ros.node.factory import make, message_class
from polymap_ros.node.qos import no_events
from polymap_ros.node.stopwatch import Stopwatch
from polymap_ros.solvers.evidence.odometry import FLOOR_M, FLOOR_RAD, OdometryNoise

_REMEMBERED = 1024
"""Pings whose reported pose is remembered until they have a place."""


class MapFrame:
    """Publishes the newest ping's pose, and broadcasts what corrects the odometry as it is published.

    Parameters
    ----------
    node : Node
        Owner of publishers and timer.
    mapper : PolygonMapper
        Knows where the pings are.
    steady : Clock
        The steady clock.
    stopwatch : Stopwatch
        Times the callbacks.
    """

    def __init__(self, node: Node, mapper: PolygonMapper, steady: Clock, stopwatch: Stopwatch) -> None:
        self._node, self._mapper, self._slam = node, mapper, mapper.parameters.slam
        self._noise = OdometryNoise.assumed(self._slam)
        self._reported: dict[int, Pose] = {}  # by emission
        self._map_to_odom: Pose | None = None
        mapper.tap = self._used
        self._poses = node.create_publisher(message_class('geometry_msgs/msg/PoseWithCovarianceStamped'), '~/pose',
                                            QoSProfile(depth=10), event_callbacks=no_events())
        self._tf = self._broadcaster()
        if self._tf is not None:
            node.create_timer(self._slam.tf_period_s, stopwatch.timed('TF', self._broadcast), clock=steady)

    def _broadcaster(self) -> Any:
        if not (self._slam.map_frame and self._slam.publish_tf):
            return None
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError as error:
            self._node.get_logger().warning(
                f'no TF from {self._slam.map_frame!r} is broadcast: tf2_msgs is not installed ({error}); ~/path and '
                '~/pose go on')
            return None
        self._message = TFMessage
        return self._node.create_publisher(TFMessage, '/tf', QoSProfile(depth=100), event_callbacks=no_events())

    def reset(self) -> None:
        """Broadcast nothing until a ping has a place again."""
        self._map_to_odom = None
        self._reported.clear()

    def _used(self, ping: Ping, base: Pose) -> None:
        if len(self._reported) >= _REMEMBERED:
            del self._reported[next(iter(self._reported))]
        self._reported[ping.emission_ns] = base

    def update(self) -> None:
        """Publish where the newest ping is now, and broadcast what follows from it."""
        newest, plane = self._mapper.newest(), self._mapper.plane or XY
        if newest is None:
            return
        emission_ns, pose = newest
        reported = self._reported.get(emission_ns, pose)
        self._map_to_odom = pose.compose(reported.inverse())
        there = pose if self._slam.map_frame else reported
        self._poses.publish(pose_with_covariance_message(
            make, emission_ns, self._mapper.map_frame, pose_message(make, there, plane), self._covariance()))
        self._broadcast()

    def _covariance(self) -> NDArray[np.float64]:
        """Of x, y and yaw: that of the last estimated pose, and of the way since."""
        estimate = self._mapper.estimate
        if estimate is None or estimate.trajectory is None:
            return np.diag((FLOOR_M, FLOOR_M, FLOOR_RAD)) ** 2
        way_m = self._mapper.driven_since_m(estimate.trajectory.stamps_ns[-1])
        along = self._noise.covariance(np.array([way_m]), np.zeros(1))[0]
        spread = max(along[0, 0], along[1, 1])
        return np.asarray(estimate.trajectory.covariances[-1] + np.diag((spread, spread, along[2, 2])))

    def _broadcast(self) -> None:
        now = self._node.get_clock().now()
        if self._tf is None or self._map_to_odom is None or not now.nanoseconds:
            return
        if not (self._mapper.plane or XY).is_xy:
            self._node.get_logger().warning('no TF is broadcast where odometry.plane is not the xy plane',
                                            throttle_duration_sec=60.0)
            return
        stamp = now + Duration(nanoseconds=round(1e9 * self._slam.tf_tolerance_s))
        self._tf.publish(self._message(transforms=[transform_message(
            make, stamp.nanoseconds, self._slam.map_frame, self._mapper.frame_id, self._map_to_odom)]))
