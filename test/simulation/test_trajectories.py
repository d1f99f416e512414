import numpy as np
import pytest

from polymap_ros.errors import SceneError
from polymap_ros.simulation.clearance import clearance
from polymap_ros.simulation.trajectories import fitted, legs, random_legs, recorded

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_legs_turn_on_the_spot_and_keep_the_step_across_corners():
    poses = legs((1.0, 2.0, 0.0), [0.0, np.pi / 2], [0.25, 0.25], 0.1)
    np.testing.assert_allclose(poses[:, 0], [1.0, 1.1, 1.2, 1.25, 1.25, 1.25], atol=1e-12)
    np.testing.assert_allclose(poses[:, 1], [2.0, 2.0, 2.0, 2.05, 2.15, 2.25], atol=1e-12)
    np.testing.assert_allclose(poses[:, 2], [0.0, 0.0, 0.0, np.pi / 2, np.pi / 2, np.pi / 2])


def test_a_recorded_path_is_resampled_by_distance_and_standing_still_gives_no_pings():
    path = np.array([[0, 0, 3.0], [0, 0, 3.0], [1, 0, 3.0], [1, 0, 3.1], [1, 0, -3.1], [1, 1, -3.1]])
    poses = recorded(path, 5)
    np.testing.assert_allclose(poses[:, :2], [[0, 0], [0.5, 0], [1, 0], [1, 0.5], [1, 1]], atol=1e-12)
    assert np.all(np.abs(np.exp(1j * poses[:, 2]) - np.exp(3.1j)) < 0.15)  # the short way through pi


def test_a_recorded_path_that_stands_still_is_refused():
    with pytest.raises(SceneError, match='does not move'):
        recorded(np.zeros((4, 3)), 3)


def test_a_fitted_path_is_similar_to_the_given_one_and_touches_the_clearance():
    generator = np.random.default_rng(1)
    given = np.column_stack((generator.normal(size=(40, 2)) + 7.0, generator.uniform(-3, 3, 40)))
    poses = fitted(given, SQUARE, 0.06, turn_rad=0.5)
    assert clearance(SQUARE, poses[:, :2]).min() == pytest.approx(0.06, abs=1e-9)
    complex_given, complex_fitted = given[:, 0] + 1j * given[:, 1], poses[:, 0] + 1j * poses[:, 1]
    ratio = np.diff(complex_fitted) / np.diff(complex_given)
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)
    assert np.angle(ratio[0]) == pytest.approx(0.5)
    np.testing.assert_allclose(poses[:, 2] - given[:, 2], 0.5)


def test_no_path_fits_into_a_room_narrower_than_its_clearance():
    with pytest.raises(SceneError, match='clearance'):
        fitted(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), SQUARE, 0.6)


def test_random_legs_keep_step_heading_and_clearance():
    poses = random_legs(SQUARE, 60, 0.14, 0.06, np.random.default_rng(5))
    assert poses.shape == (60, 3)
    assert clearance(SQUARE, poses[:, :2]).min() >= 0.06 - 1e-9
    moves = np.diff(poses[:, :2], axis=0)
    lengths = np.linalg.norm(moves, axis=1)
    assert 0.13 < lengths.min() < lengths.max() < 0.15
    np.testing.assert_allclose(moves / lengths[:, None],
                               np.column_stack((np.cos(poses[1:, 2]), np.sin(poses[1:, 2]))), atol=1e-9)
    turns = np.abs(np.diff(poses[1:, 2])) > 1e-6
    assert turns.any()
    assert not turns.all()


def test_a_room_too_small_for_a_step_has_no_random_legs():
    assert random_legs(SQUARE * 0.2, 60, 0.14, 0.06, np.random.default_rng(5)) is None
    assert random_legs(SQUARE * 0.1, 60, 0.14, 0.06, np.random.default_rng(5)) is None
