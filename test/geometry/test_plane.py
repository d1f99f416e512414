"""The mapping plane: heading, height and tilt of any pose in space, against scipy's rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from polymap_ros.geometry.plane import XY, Plane, SpatialPose
from polymap_ros.geometry.pose import Pose

ANGLES = st.floats(-3.1, 3.1)
LENGTHS = st.floats(-10.0, 10.0)
POSES = st.tuples(LENGTHS, LENGTHS, LENGTHS, ANGLES, st.floats(-1.5, 1.5), ANGLES)


def spatial(row, length=1.0):
    x, y, z, *angles = row
    return SpatialPose((x, y, z), tuple((length * Rotation.from_euler('ZYX', angles).as_quat()).tolist()))


def rotation(pose):
    return Rotation.from_quat(pose.orientation)


@given(POSES, st.floats(0.9, 1.1))
def test_axes_are_those_of_the_rotation_whatever_the_quaternions_length(row, length):
    pose = spatial(row, length)
    found = np.column_stack([pose.forward, pose.left, pose.up])
    np.testing.assert_allclose(found, rotation(pose).as_matrix(), atol=1e-12)


@given(POSES, POSES)
def test_a_pose_is_placed_in_the_plane_of_the_first_as_its_own_frame_sees_it(first, other):
    first, other = spatial(first), spatial(other)
    placed = Plane.of('first_pose', first).place(other)
    seen = rotation(first).inv().apply(np.subtract(other.position, first.position))
    turned = (rotation(first).inv() * rotation(other)).as_matrix()
    np.testing.assert_allclose([placed.pose.x, placed.pose.y, placed.height_m], seen, atol=1e-10)
    assert np.cos(placed.tilt_rad) == pytest.approx(turned[2, 2], abs=1e-12)
    if np.hypot(turned[0, 0], turned[1, 0]) > 1e-3:
        assert np.exp(1j * placed.pose.yaw) == pytest.approx(
            np.exp(1j * np.arctan2(turned[1, 0], turned[0, 0])), abs=1e-9)


@given(POSES)
def test_in_the_xy_plane_x_y_and_heading_are_the_odometrys_and_height_counts_from_the_first_pose(row):
    placed = Plane.of('xy', SpatialPose((9.0, 9.0, 0.5))).place(spatial(row))
    assert (placed.pose.x, placed.pose.y) == row[:2]
    assert placed.height_m == pytest.approx(row[2] - 0.5)
    assert np.exp(1j * placed.pose.yaw) == pytest.approx(np.exp(1j * row[3]), abs=1e-9)
    assert np.cos(placed.tilt_rad) == pytest.approx(np.cos(row[4]) * np.cos(row[5]), abs=1e-12)


@given(POSES, LENGTHS, LENGTHS, ANGLES)
def test_what_is_placed_in_the_plane_is_found_again_in_space(first, x, y, yaw):
    plane = Plane.of('first_pose', spatial(first, 1.05))
    placed = plane.place(plane.spatial(Pose(x, y, yaw)))
    assert (placed.pose.x, placed.pose.y) == pytest.approx((x, y), abs=1e-9)
    assert np.exp(1j * placed.pose.yaw) == pytest.approx(np.exp(1j * yaw), abs=1e-9)
    assert placed.height_m == pytest.approx(0.0, abs=1e-9)
    assert placed.tilt_rad == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(plane.points([[x, y]])[0], plane.spatial(Pose(x, y)).position, atol=1e-12)


def test_the_xy_plane_is_z_0():
    assert XY.is_xy
    assert Plane.of('xy', SpatialPose((1.0, 2.0, 3.0))).is_xy
    assert not Plane.of('first_pose', SpatialPose((1.0, 2.0, 3.0))).is_xy
    np.testing.assert_array_equal(XY.points([[1.0, 2.0], [3.0, 4.0]]), [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0]])
    assert XY.spatial(Pose(1.0, 2.0, 0.6)) == SpatialPose((1.0, 2.0, 0.0), (0.0, 0.0, np.sin(0.3), np.cos(0.3)))
