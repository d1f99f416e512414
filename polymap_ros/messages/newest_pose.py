"""Where the robot is in the map: the message of ~/pose, and the transform that corrects the odometry as published."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.plane import XY
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.outputs import Make, pose_message, pose_with_covariance_message, transform_message
from polymap_ros.solvers.evidence.odometry import FLOOR_M, FLOOR_RAD, OdometryNoise

POSE, POSE_TYPE = 'pose', 'geometry_msgs/msg/PoseWithCovarianceStamped'
"""The topic below the node's."""

TF, TF_TYPE = '/tf', 'tf2_msgs/msg/TFMessage'

_REMEMBERED = 1024
"""Pings whose reported pose is remembered until they have a place."""


class NewestPose:
    """The newest ping's pose, and what leads from the odometry's frame to the map's.

    Parameters
    ----------
    make : Make
        Builds messages.
    mapper : PolygonMapper
        Knows where the pings are; its `tap` is taken.

    Attributes
    ----------
    map_to_odom : Pose or None
        The odometry's frame, as published, in the map frame; None as long as no ping has a place.
    """

    def __init__(self, make: Make, mapper: PolygonMapper) -> None:
        self._make, self._mapper, self._slam = make, mapper, mapper.parameters.slam
        self._noise = OdometryNoise.assumed(self._slam)
        self._reported: dict[int, Pose] = {}  # by emission
        self.map_to_odom: Pose | None = None
        mapper.tap = self._used

    def reset(self) -> None:
        """Know nothing until a ping has a place again."""
        self.map_to_odom = None
        self._reported.clear()

    def _used(self, ping: Ping, reported: Pose) -> None:
        if len(self._reported) >= _REMEMBERED:
            del self._reported[next(iter(self._reported))]
        self._reported[ping.emission_ns] = reported

    def updated(self) -> Any:
        """Return the message of where the newest ping is now; None where none has a place."""
        newest, plane = self._mapper.newest(), self._mapper.plane or XY
        if newest is None:
            return None
        emission_ns, pose = newest
        reported = self._reported.get(emission_ns, pose)
        self.map_to_odom = pose.compose(reported.inverse())
        there = pose if self._slam.map_frame else reported
        return pose_with_covariance_message(
            self._make, emission_ns, self._mapper.map_frame, pose_message(self._make, there, plane),
            self._covariance())

    def _covariance(self) -> NDArray[np.float64]:
        """Of x, y and yaw: that of the last estimated pose, and of the way since, as if it led straight on."""
        estimate = self._mapper.estimate
        if estimate is None or estimate.trajectory is None:
            return np.diag((FLOOR_M, FLOOR_M, FLOOR_RAD)) ** 2
        way_m = self._mapper.driven_since_m(estimate.trajectory.stamps_ns[-1])
        along = self._noise.straight_on(way_m)
        spread = max(along[0, 0], along[1, 1])
        return np.asarray(estimate.trajectory.covariances[-1] + np.diag((spread, spread, along[2, 2])))

    def transforms(self, now_ns: int) -> list[Any]:
        """Return the transforms of a TFMessage that is broadcast at a time [ns]: one, or none.

        There is none before a ping has a place, nor where the mapping plane is not the odometry's xy plane.
        """
        if self.map_to_odom is None or not (self._mapper.plane or XY).is_xy:
            return []
        stamp_ns = now_ns + round(1e9 * self._slam.tf_tolerance_s)
        return [transform_message(self._make, stamp_ns, self._slam.map_frame, self._mapper.frame_id, self.map_to_odom)]
