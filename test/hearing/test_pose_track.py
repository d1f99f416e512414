"""The odometry's recent past: interpolation, order, gaps and the length of the buffer."""

import numpy as np
import pytest

from polymap_ros.errors import BadPing, StateError
from polymap_ros.geometry.plane import Placed
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.pose_track import PoseTrack
from polymap_ros.parameters import OdometryParameters

S = 1_000_000_000
START = 1_700_000_000 * S


def track(*rows, **parameters):
    poses = PoseTrack(OdometryParameters(**parameters))
    for stamp_s, pose in rows:
        assert poses.add(START + round(stamp_s * S), pose)
    return poses


def reason(poses, stamp_s):
    with pytest.raises(BadPing) as caught:
        poses.at(START + round(stamp_s * S))
    return caught.value.reason


def test_positions_are_interpolated_linearly_at_nanosecond_stamps_of_today():
    poses = track((0.0, Pose(1.0, 2.0, 0.0)), (0.001, Pose(2.0, 0.0, 0.0)))
    for part in (0, 1, 250_000, 999_999, 1_000_000):
        found = poses.at(START + part)
        assert (found.x, found.y) == pytest.approx((1.0 + part * 1e-6, 2.0 - 2.0 * part * 1e-6), abs=1e-12)


@pytest.mark.parametrize(('first', 'second', 'middle'), [
    (3.0, -3.0, np.pi), (-3.0, 3.0, np.pi), (0.1, 0.5, 0.3), (0.2, 0.2 + 6 * np.pi, 0.2), (-0.4, 0.2, -0.1),
    (100.0, 100.5, 100.25),
])
def test_heading_turns_the_short_way(first, second, middle):
    found = track((0.0, Pose(0.0, 0.0, first)), (1.0, Pose(0.0, 0.0, second))).at(START + S // 2)
    assert np.exp(1j * found.yaw) == pytest.approx(np.exp(1j * middle), abs=1e-12)


def test_a_time_still_to_come_is_none_and_one_before_the_first_pose_never_comes():
    poses = track()
    assert poses.at(START) is None
    poses.add(START, Pose(1.0, 1.0))
    assert poses.at(START) == Pose(1.0, 1.0)
    assert poses.at(START + 1) is None
    assert reason(poses, -1e-9) == 'no_pose'


def test_poses_out_of_order_or_twice_are_not_taken():
    poses = track((0.0, Pose(0.0, 0.0)), (1.0, Pose(1.0, 0.0)))
    assert not poses.add(START + S, Pose(9.0, 9.0))
    assert not poses.add(START + S // 2, Pose(9.0, 9.0))
    assert poses.at(START + S // 2).x == pytest.approx(0.5)


def test_no_pose_is_made_up_across_a_gap_but_its_ends_are_known():
    poses = track((0.0, Pose(0.0, 0.0)), (0.5, Pose(1.0, 0.0)), (0.8, Pose(2.0, 0.0)), max_gap_s=0.4)
    assert poses.outliers == 0
    assert reason(poses, 0.25) == 'pose_gap'
    assert poses.at(START) == Pose(0.0, 0.0)
    assert poses.at(START + S // 2) == Pose(1.0, 0.0)
    assert poses.at(START + round(0.65 * S)).x == pytest.approx(1.5)


def test_a_gap_of_just_the_allowed_length_is_bridged():
    assert track((0.0, Pose(0.0, 0.0)), (0.4, Pose(1.0, 0.0)), max_gap_s=0.4).at(START + S // 5).x == pytest.approx(0.5)


def test_the_buffer_is_as_long_as_said_whenever_it_is_trimmed_and_its_memory_is_bounded():
    poses = PoseTrack(OdometryParameters(buffer_s=2.0))
    for i in range(20_000):
        poses.add(START + i * S // 100, Pose(float(i), 0.0))
        newest_s = i / 100
        if i in (250, 700, 12_345, 19_999):
            assert reason(poses, newest_s - 2.001) == 'stale'
            assert poses.at(START + round((newest_s - 2.0) * S)).x == pytest.approx(i - 200)
    assert len(poses) < 1000


def test_a_restored_track_answers_alike():
    poses = track(*((0.1 * i, Pose(np.cos(i), np.sin(i), 0.3 * i)) for i in range(20)))
    again = PoseTrack(OdometryParameters())
    again.restore(poses.state())
    assert [again.at(START + k * S // 30) for k in range(50)] == [poses.at(START + k * S // 30) for k in range(50)]
    assert again.newest_ns == poses.newest_ns


@pytest.mark.parametrize('change', [
    {'stamps_ns': np.array([1, 1])}, {'stamps_ns': np.array([2, 1])}, {'stamps_ns': np.array([1])},
    {'poses': np.zeros((2, 3))}, {'poses': np.full((2, 5), np.nan)}, {'held': np.array(2)}, {'held': np.array(-1)},
    {'stamps_ns': np.empty(0, np.int64), 'poses': np.empty((0, 5)), 'held': np.array(1)},
])
def test_a_damaged_track_is_refused(change):
    whole = track((0.0, Pose(0.0, 0.0)), (0.1, Pose(0.0, 0.0))).state()
    PoseTrack(OdometryParameters()).restore(whole)
    with pytest.raises(StateError):
        PoseTrack(OdometryParameters()).restore({**whole, **change})


def places(poses, *stamps_s):
    return [poses.at(START + round(stamp_s * S)).x for stamp_s in stamps_s]


@pytest.mark.parametrize('ahead_s', [1.01, 30.0, 3e8])
@pytest.mark.parametrize('after', [0, 1, 3])
def test_one_stamp_far_ahead_changes_nothing(after, ahead_s):
    """Also where it comes first."""
    rows = [(0.1 * k, Pose(float(k), 0.0)) for k in range(6)]
    rows.insert(after, (rows[after][0] + ahead_s + 0.1, Pose(99.0, 99.0)))
    poses = track(*rows)
    assert places(poses, 0.0, 0.25, 0.5) == pytest.approx([0.0, 2.5, 5.0])
    assert poses.newest_ns == START + S // 2
    assert poses.outliers == 1


def test_time_that_has_gone_on_is_believed_with_the_second_pose_and_nothing_is_lost():
    poses = track((0.0, Pose(0.0, 0.0)), (10.0, Pose(1.0, 0.0)))
    assert poses.newest_ns == START
    assert poses.at(START + 10 * S) is None
    assert poses.add(START + 10 * S + S // 10, Pose(2.0, 0.0))
    assert places(poses, 10.0, 10.05) == pytest.approx([1.0, 1.5])
    assert poses.outliers == 0


def test_poses_further_apart_than_a_gap_are_all_known():
    poses = track(*((2.0 * k, Pose(float(k), 0.0)) for k in range(8)), max_gap_s=1.0)
    poses.finish()
    assert places(poses, *(2.0 * k for k in range(8))) == list(range(8))
    assert poses.outliers == 0


def test_a_wild_stamp_before_a_real_gap_is_told_from_it():
    poses = track((0.0, Pose(0.0, 0.0)), (1e6, Pose(9.0, 9.0)), (5.0, Pose(1.0, 0.0)), (5.1, Pose(2.0, 0.0)))
    assert places(poses, 5.0, 5.1) == [1.0, 2.0]
    assert poses.outliers == 1


def test_what_is_held_back_is_kept_in_the_state():
    poses = track((0.0, Pose(0.0, 0.0)), (10.0, Pose(1.0, 0.0)))
    again = PoseTrack(OdometryParameters())
    again.restore(poses.state())
    for each in (poses, again):
        each.add(START + 11 * S, Pose(2.0, 0.0))
        assert places(each, 10.0, 10.5) == pytest.approx([1.0, 1.5])


def placed(height_m=0.0, tilt_deg=0.0):
    return Placed(Pose(0.0, 0.0), height_m, np.deg2rad(tilt_deg))


@pytest.mark.parametrize(('first', 'second', 'says'), [
    (placed(tilt_deg=9.0), placed(tilt_deg=10.8), None),
    (placed(tilt_deg=9.0), placed(tilt_deg=11.5), 'tilted by 10.2 deg off the mapping plane'),
    (placed(tilt_deg=180.0), placed(tilt_deg=180.0), r'180.0 deg .*; odometry.max_tilt_deg allows 10'),
    (placed(height_m=-0.15), placed(height_m=0.15), None),
    (placed(height_m=0.0), placed(height_m=0.21), '0.105 m off the mapping plane'),
    (placed(height_m=-0.11), placed(height_m=-0.11), r'-0.110 m .*; odometry.max_height_m allows 0.1'),
])
def test_half_way_between_two_poses_off_the_plane(first, second, says):
    poses = track((0.0, first), (1.0, second))
    if says is None:
        assert poses.at(START + S // 2) == Pose(0.0, 0.0)
    else:
        assert reason(poses, 0.5) == 'off_plane'
        with pytest.raises(BadPing, match=says):
            poses.at(START + S // 2)


def test_limits_are_the_parameters():
    poses = track((0.0, placed(1.9, 170.0)), max_tilt_deg=180.0, max_height_m=2.0)
    assert poses.at(START) == Pose(0.0, 0.0)
    assert reason(track((0.0, placed(0.0, 0.5)), max_tilt_deg=0.4), 0.0) == 'off_plane'
    assert reason(track((0.0, placed(0.02, 0.0)), max_height_m=0.01), 0.0) == 'off_plane'
