import dataclasses

import numpy as np
import pytest

from polymap_ros.errors import SceneError
from polymap_ros.parameters import SensorParameters
from polymap_ros.simulation.clearance import audible_feet, clearance, half_planes
from polymap_ros.simulation.scenes import Scene

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
INSIDE = [[0.5, 0.5, 0.0], [0.6, 0.5, 0.0]]


def test_clockwise_corners_are_reversed_and_keep_their_reflections():
    def coefficients(scene):
        edges = zip(scene.vertices, np.roll(scene.vertices, -1, axis=0), scene.reflection, strict=True)
        return {frozenset([tuple(a), tuple(b)]): coefficient for a, b, coefficient in edges}

    given = Scene('room', SQUARE, INSIDE, reflection=[0.1, 0.2, 0.3, 0.4])
    clockwise = Scene('room', SQUARE[::-1], INSIDE, reflection=[0.3, 0.2, 0.1, 0.4])
    assert coefficients(clockwise) == coefficients(given)
    assert clearance(clockwise.vertices, clockwise.positions).min() > 0.0


@pytest.mark.parametrize(('change', 'word'), [
    ({'vertices': [[0, 0], [1, 0]]}, 'vertices'),
    ({'vertices': [[0, 0], [1, 0], [1, np.nan]]}, 'vertices'),
    ({'vertices': [[0, 0], [2, 2], [2, 0], [0, 1]]}, 'cross'),
    ({'vertices': [[0, 0], [1, 0], [2, 0], [0, 2]]}, 'straight on'),
    ({'vertices': [[np.cos(a), np.sin(a)] for a in np.arange(5) * 4 * np.pi / 5]}, 'cross'),
    ({'poses': [[0.5, 0.5, 0.0], [1.5, 0.5, 0.0]]}, 'pose 1'),
    ({'poses': [[0.5, 0.5]]}, 'poses'),
    ({'reflection': [1.0, 1.0]}, 'reflection'),
    ({'reflection': 1.2}, 'reflection'),
    ({'sample_rate_hz': 0.0}, 'sample_rate_hz'),
    ({'snr_db': np.nan}, 'snr_db'),
    ({'position_noise_m': -1.0}, 'position_noise_m'),
])
def test_an_impossible_scene_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        Scene(**({'name': 'room', 'vertices': SQUARE, 'poses': INSIDE} | change))


def test_the_sensor_is_placed_by_position_and_heading():
    scene = Scene('room', SQUARE, [[0.5, 0.5, 0.0], [0.5, 0.5, np.pi / 2]], sensor=SensorParameters(0.2, 0.1))
    np.testing.assert_allclose(scene.positions, [[0.7, 0.6], [0.4, 0.7]], atol=1e-12)


def test_options_draw_from_streams_of_their_own():
    scene = Scene('room', SQUARE, INSIDE * 2000)
    noisy = dataclasses.replace(scene, gain_range_db=6.0, position_noise_m=0.005)
    np.testing.assert_array_equal(scene.noise(), noisy.noise())
    np.testing.assert_array_equal(scene.gains(), 1.0)
    np.testing.assert_array_equal(scene.reported_poses(), scene.poses)
    gains_db = 20.0 * np.log10(noisy.gains())
    assert -3.0 <= gains_db.min() < -2.9
    assert 2.9 < gains_db.max() <= 3.0
    errors = noisy.reported_poses() - scene.poses
    np.testing.assert_array_equal(errors[:, 2], 0.0)
    np.testing.assert_allclose(errors[:, :2].std(axis=0), 0.005, rtol=0.05)
    assert abs(np.corrcoef(errors[:, :2].T)[0, 1]) < 0.06


def test_stamps_are_those_of_the_first_sample():
    scene = Scene('room', SQUARE, INSIDE, t0_s=5.5e-5, ping_period_s=0.25)
    np.testing.assert_array_equal(scene.stamps_ns, [1_250_055_000, 1_500_055_000])


def test_half_planes_clearance_and_feet_of_a_square():
    square = np.array(SQUARE)
    normals, offsets = half_planes(square)
    np.testing.assert_allclose(normals, [[0, -1], [1, 0], [0, 1], [-1, 0]], atol=1e-15)
    np.testing.assert_allclose(offsets, [0, 1, 1, 0], atol=1e-15)
    points = np.array([[0.3, 0.9], [1.5, 0.5]])
    np.testing.assert_allclose(clearance(square, points), [0.1, -0.5])
    np.testing.assert_array_equal(audible_feet(square, points), [[True] * 4, [False, True, False, True]])
