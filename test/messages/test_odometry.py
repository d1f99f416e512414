"""Poses from odometry: heading of any quaternion, and what is refused."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polymap_ros.errors import BadOdometry
from polymap_ros.mapping.plane import XY
from polymap_ros.mapping.pose import Pose
from polymap_ros.messages.odometry import stamped_pose
from polymap_ros.messages.outputs import odometry_message

ODOMETRY = 'nav_msgs/msg/Odometry'


@pytest.mark.parametrize('yaw', [0.0, 1.2, -3.0, math.pi, -0.5 * math.pi])
def test_written_odometry_reads_back(make, transported, yaw):
    message = odometry_message(make, 7_000_000_009, 'map', Pose(1.5, -2.5, yaw))
    for received in (message, transported(message, ODOMETRY)):
        stamp_ns, frame_id, spatial = stamped_pose(received)
        pose = XY.place(spatial).pose
        assert (stamp_ns, frame_id, pose.x, pose.y) == (7_000_000_009, 'map', 1.5, -2.5)
        assert math.remainder(pose.yaw - yaw, math.tau) == pytest.approx(0.0, abs=1e-12)


def test_heading_of_a_tilted_robot_is_the_rotation_about_z(make):
    message = odometry_message(make, 0, 'odom', Pose(0.0, 0.0))
    message.pose.pose.position.z = 0.25
    rotation = Rotation.from_euler('ZYX', [0.7, 0.2, -0.1])
    x, y, z, w = rotation.as_quat()
    message.pose.pose.orientation = make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)
    placed = XY.place(stamped_pose(message)[2])
    assert placed.pose.yaw == pytest.approx(0.7)
    assert placed.height_m == 0.25
    assert placed.tilt_rad == pytest.approx(np.arccos(np.cos(0.2) * np.cos(0.1)))


def test_stamps_are_integer_nanoseconds(make):
    message = odometry_message(make, 1_700_000_000_123_456_789, 'odom', Pose(0.0, 0.0))
    assert stamped_pose(message)[0] == 1_700_000_000_123_456_789


@pytest.mark.parametrize('field', ['position', 'orientation'])
@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_pose_that_is_not_finite_is_refused(make, field, value):
    message = odometry_message(make, 0, 'odom', Pose(0.0, 0.0))
    getattr(message.pose.pose, field).x = value
    with pytest.raises(BadOdometry, match='finite'):
        stamped_pose(message)


def test_orientation_never_filled_in_is_refused(make):
    message = odometry_message(make, 0, 'odom', Pose(0.0, 0.0))
    message.pose.pose.orientation.w = 0.0
    with pytest.raises(BadOdometry, match='norm 0'):
        stamped_pose(message)
