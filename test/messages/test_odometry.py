"""Poses from odometry: heading of any quaternion, and what is refused."""

import math

import numpy as np
import pytest
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from polymap_ros.errors import BadOdometry
from polymap_ros.geometry.plane import XY
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.odometry import odometry_from_cdr, stamped_pose
from polymap_ros.messages.outputs import odometry_message
from polymap_ros.recordings.writing import make as recorded

ODOMETRY = 'nav_msgs/msg/Odometry'
STORE = get_typestore(Stores.ROS2_JAZZY)


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


def as_bytes(frame_id='odom', child='base', little_endian=True):
    message = odometry_message(recorded, 1_700_000_000_123_456_789, frame_id, Pose(1.5, -2.5, 0.7))
    message.child_frame_id = child
    return bytes(STORE.serialize_cdr(message, ODOMETRY, little_endian=little_endian))


@pytest.mark.parametrize('frame_id', ['', 'o', 'od', 'odo', 'odom', 'robot/odom'])
@pytest.mark.parametrize('child', ['', 'b', 'ba', 'bas', 'base', 'robot/base_link'])
def test_read_from_bytes_it_is_what_the_message_says(frame_id, child):
    data = as_bytes(frame_id, child)
    expected = stamped_pose(STORE.deserialize_cdr(data, ODOMETRY))
    for padded in (data, data + bytes(3)):
        assert stamped_pose(odometry_from_cdr(padded)) == expected


def test_other_bytes_are_left_to_be_decoded_in_full():
    assert odometry_from_cdr(as_bytes('\u00f6dom')) is None
    assert odometry_from_cdr(as_bytes(little_endian=False)) is None
    assert odometry_from_cdr(as_bytes() + bytes(4)) is None


def test_bytes_that_cannot_be_decoded_are_not_read():
    """Cut off anywhere, or with a byte changed in what comes before the numbers: the decoder has the last word."""
    whole = as_bytes()
    changed = [whole[:at] + bytes([value]) + whole[at + 1:] for at in range(40) for value in (0, 1, 7, 128, 255)]
    for data in [whole[:at] for at in range(len(whole))] + changed:
        quick = odometry_from_cdr(data)
        try:
            message = STORE.deserialize_cdr(data, ODOMETRY)
        except SerdeError:
            assert quick is None
        else:
            assert quick is None or stamped_pose(quick) == stamped_pose(message)
