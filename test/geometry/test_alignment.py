"""The best rigid motion of a path: against scipy's rotations, and what it may not do."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polymap_ros.geometry.alignment import alignment, path_error
from polymap_ros.geometry.pose import Pose


def path(seed=1, count=30):
    generator = np.random.default_rng(seed)
    return np.column_stack((np.cumsum(generator.normal(size=(count, 2)), axis=0), generator.uniform(-3.0, 3.0, count)))


@pytest.mark.parametrize('seed', range(5))
def test_it_is_the_motion_that_scipy_finds(seed):
    one, other = path(seed)[:, :2], path(seed + 10)[:, :2]
    found = alignment(one, other)
    raised = [np.column_stack((each - each.mean(axis=0), np.zeros(len(each)))) for each in (one, other)]
    up = np.array([[0.0, 0.0, 1.0]])  # held, so that nothing is turned over
    rotation, _ = Rotation.align_vectors(np.vstack((raised[1], up)), np.vstack((raised[0], up)),
                                         np.append(np.ones(len(one)), 1e9))
    assert abs(np.angle(np.exp(1j * (found.yaw - rotation.as_euler('zyx')[0])))) < 1e-6
    np.testing.assert_allclose(found.apply(one).mean(axis=0), other.mean(axis=0), atol=1e-12)


def test_a_moved_path_is_brought_back_with_its_headings():
    true, motion = path(), Pose(3.0, -2.0, 2.5)
    moved = np.column_stack((motion.apply(true[:, :2]), true[:, 2] + motion.yaw))
    error = path_error(moved, true, alignment(moved[:, :2], true[:, :2]))
    assert max(error) < 1e-12


def test_a_longer_path_or_its_mirror_image_stays_off():
    true = path()
    for wrong in (true * (1.1, 1.1, 1.0), true * (1.0, -1.0, 1.0)):
        assert path_error(wrong, true, alignment(wrong[:, :2], true[:, :2])).ate_m > 0.05


def test_errors_are_of_the_worst_ping_and_of_all():
    true = path()
    off = true + np.zeros(3)
    off[4] += (0.3, 0.4, 0.2)
    error = path_error(off, true, Pose(0.0, 0.0))
    assert error.worst_m == pytest.approx(0.5)
    assert error.ate_m == pytest.approx(0.5 / np.sqrt(len(true)))
    assert error.heading_rad == pytest.approx(0.2 / np.sqrt(len(true)))
