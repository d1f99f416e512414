"""Publishes ~/pose at every ping, and broadcasts TF from the map's frame to the odometry's."""

from collections import deque
from typing import Any

from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from polymap_ros.errors import UsageError
from polymap_ros.geometry.plane import XY
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.newest_pose import POSE, POSE_TYPE, TF, TF_TYPE, NewestPose
from polymap_ros.node.factory import make, message_class
from polymap_ros.node.qos import no_events
from polymap_ros.node.stopwatch import Stopwatch

_KNOWN_AS_OWN = 1000
"""Broadcasts that are known as the node's own when they come back."""


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
        self._newest = NewestPose(make, mapper)
        self._origin_told = False
        self._sent: deque[tuple[Any, ...]] = deque(maxlen=_KNOWN_AS_OWN)
        self._poses = node.create_publisher(
            message_class(POSE_TYPE), f'~/{POSE}', QoSProfile(depth=10), event_callbacks=no_events())
        self._tf = self._broadcaster()
        if self._tf is not None:
            node.create_timer(self._slam.tf_period_s, stopwatch.timed('TF', self._broadcast), clock=steady)

    def _broadcaster(self) -> Any:
        if not (self._slam.map_frame and self._slam.publish_tf):
            return None
        try:
            self._message = message_class(TF_TYPE)
        except UsageError as error:
            self._node.get_logger().warning(
                f'no TF from {self._slam.map_frame!r} is broadcast: {error}; ~/path and ~/pose go on')
            return None
        self._node.create_subscription(self._message, TF, self._look, QoSProfile(depth=100), raw=True,
                                       event_callbacks=no_events())
        return self._node.create_publisher(self._message, TF, QoSProfile(depth=100), event_callbacks=no_events())

    def reset(self) -> None:
        """Broadcast nothing until a ping has a place again."""
        self._newest.reset()
        self._origin_told = False

    def update(self) -> None:
        """Publish where the newest ping is now, and broadcast what follows from it."""
        message = self._newest.updated()
        if message is None:
            return
        self._poses.publish(message)
        self._tell_origin()
        self._broadcast()

    def _tell_origin(self) -> None:
        """Say once where the map frame begins, since TF may be off."""
        if self._origin_told or self._slam.map_origin == 'odom' or self._mapper.origin is None:
            return
        self._origin_told = True
        self._node.get_logger().info(f'{self._slam.map_frame}: its origin is at {self._mapper.origin.text} of '
                                     f'{self._mapper.frame_id!r} (slam.map_origin)')

    def _broadcast(self) -> None:
        now_ns = self._node.get_clock().now().nanoseconds
        if self._tf is None or not now_ns:
            return
        if not (self._mapper.plane or XY).is_xy:
            self._node.get_logger().warning('no TF is broadcast where odometry.plane is not the xy plane',
                                            throttle_duration_sec=60.0)
        if transforms := self._newest.transforms(now_ns):
            self._sent.append(_told(transforms[0]))
            self._tf.publish(self._message(transforms=transforms))

    def _look(self, raw: bytes) -> None:
        """Warn where somebody else says where the odometry's frame is: listeners would see it jump to and fro.

        Of the many messages on the topic only those that name that frame are taken apart.
        """
        odom = self._mapper.frame_id
        if not odom or odom.encode() not in raw:
            return
        for each in deserialize_message(raw, self._message).transforms:
            if each.child_frame_id == odom and _told(each) not in self._sent:
                self._node.get_logger().warning(
                    f'somebody else broadcasts TF from {each.header.frame_id!r} to {odom!r}, too, such as another '
                    'localisation: stop it, or set slam.publish_tf to false', throttle_duration_sec=60.0)


def _told(transform: Any) -> tuple[Any, ...]:
    """What a transform says, and when."""
    off, turn, stamp = transform.transform.translation, transform.transform.rotation, transform.header.stamp
    return (transform.header.frame_id, stamp.sec, stamp.nanosec, off.x, off.y, off.z, turn.x, turn.y, turn.z, turn.w)
