"""Where the pings were: reported, estimated, and hanging on those whose echoes are kept."""

import numpy as np
import pytest

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.path_log import PathLog
from polymap_ros.solvers.estimate import Trajectory

SECOND_NS = 10**9


def logged(count):
    """Pings a second apart along x, one each 0.1 m."""
    log = PathLog()
    for k in range(count):
        log.add(k * SECOND_NS, Pose(0.1 * k, 0.0, 0.0))
    return log


def trajectory(numbers, poses, lost=()):
    numbers = np.array(numbers)
    reported = np.column_stack((0.1 * numbers, np.zeros((len(numbers), 2))))
    consistency = np.where(np.isin(numbers, lost), 0.0, 1.0)
    return Trajectory(tuple((numbers * SECOND_NS).tolist()), np.array(poses, float), reported,
                      np.zeros((len(numbers), 3, 3)), consistency)


def test_without_an_estimate_the_reported_poses_are_the_path():
    poses, lost = logged(2000).estimated(None, 0)
    np.testing.assert_allclose(poses[:, 0], 0.1 * np.arange(2000))
    assert not np.any(lost)


def test_pings_that_were_never_estimated_follow_the_odometry_from_the_nearest():
    """The robot was turned by a right angle at ping 4: what comes after it goes along y."""
    found = trajectory([0, 4], [(0.0, 0.0, 0.0), (0.4, 0.0, np.pi / 2)])
    poses, _ = logged(7).estimated(found, 0)
    np.testing.assert_allclose(poses[5], (0.4, 0.1, np.pi / 2), atol=1e-12)
    np.testing.assert_allclose(poses[6], (0.4, 0.2, np.pi / 2), atol=1e-12)
    np.testing.assert_allclose(poses[1], (0.1, 0.0, 0.0), atol=1e-12)


def test_a_ping_that_is_let_go_moves_with_the_one_that_stays():
    log = logged(3)
    log.hang(trajectory([0, 1, 2], [(0.0, 0.0, 0.0), (0.1, 0.05, 0.2), (0.2, 0.0, 0.0)]), 0, [0, 2 * SECOND_NS])
    moved = trajectory([0, 2], [(0.0, 0.0, 0.0), (0.2, 0.3, 1.0)])
    poses, _ = log.estimated(moved, 0)
    np.testing.assert_allclose(poses[1], (0.1, 0.35, 1.2))  # of two that are equally near the later one
    np.testing.assert_allclose(poses[2], (0.2, 0.3, 1.0))


def test_what_hung_on_a_ping_that_is_let_go_hangs_on_another():
    log = logged(4)
    every = trajectory([0, 1, 2, 3], [(0.0, 0.0, 0.0), (0.1, 0.01, 0.0), (0.2, 0.02, 0.0), (0.3, 0.03, 0.0)])
    log.hang(every, 0, [0, 2 * SECOND_NS, 3 * SECOND_NS])
    fewer = trajectory([0, 2, 3], [(0.0, 0.0, 0.0), (0.2, 0.02, 0.0), (0.3, 0.03, 0.0)])
    log.hang(fewer, 0, [0, 3 * SECOND_NS])
    poses, _ = log.estimated(trajectory([0, 3], [(0.0, 0.0, 0.0), (0.3, 0.03, 0.0)]), 0)
    np.testing.assert_allclose(poses, every.poses, atol=1e-12)


def test_a_ping_that_was_lost_stays_lost():
    log = logged(3)
    found = trajectory([0, 1, 2], [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.2, 0.0, 0.0)], lost=[1])
    log.hang(found, 0, [0, 2 * SECOND_NS])
    _, lost = log.estimated(trajectory([0, 2], [(0.0, 0.0, 0.0), (0.2, 0.0, 0.0)]), 0)
    np.testing.assert_array_equal(lost, [False, True, False])


def test_stamps_of_pings_are_those_of_emissions_and_a_delay():
    log, delay_ns = PathLog(), 1000
    log.add(5, Pose(1.0, 2.0, 0.0))
    found = Trajectory((5 + delay_ns,), np.array([(1.0, 2.5, 0.0)]), np.array([(1.0, 2.0, 0.0)]),
                       np.zeros((1, 3, 3)), np.ones(1))
    np.testing.assert_allclose(log.estimated(found, delay_ns)[0], [(1.0, 2.5, 0.0)])


def test_a_copy_goes_on_apart():
    log = logged(1024)
    twin = log.copy()
    log.add(2000 * SECOND_NS, Pose(1.0, 1.0, 1.0))
    twin.add(3000 * SECOND_NS, Pose(2.0, 2.0, 2.0))
    assert (log.stamps_ns[-1], twin.stamps_ns[-1]) == (2000 * SECOND_NS, 3000 * SECOND_NS)
    assert len(log.poses) == len(twin.poses) == 1025


def test_its_state_goes_on_where_it_was():
    log = logged(3)
    log.hang(trajectory([0, 1, 2], [(0.0, 0.0, 0.0), (0.1, 0.05, 0.2), (0.2, 0.0, 0.0)]), 0, [0, 2 * SECOND_NS])
    again = PathLog()
    again.restore(log.state())
    found = trajectory([0, 2], [(0.0, 0.0, 0.0), (0.2, 0.3, 1.0)])
    for one, other in zip(log.estimated(found, 0), again.estimated(found, 0), strict=True):
        np.testing.assert_array_equal(one, other)
    again.add(9 * SECOND_NS, Pose(0.0, 0.0, 0.0))
    assert len(again.stamps_ns) == 4


@pytest.mark.parametrize('change', [{'reported': np.zeros((2, 3))}, {'seen': np.full((3, 3), np.inf)},
                                    {'lost': np.zeros(7, bool)}])
def test_a_damaged_state_is_refused(change):
    with pytest.raises(StateError, match='not that of a robot'):
        PathLog().restore({**logged(3).state(), **change})
