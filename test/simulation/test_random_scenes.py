import numpy as np
import pytest
from shapely import LinearRing, Point, Polygon

from polymap_ros.errors import SceneError
from polymap_ros.simulation.random_scenes import SHAPES, Recipe, air_filled, lossy, random_scene
from polymap_ros.simulation.waveforms import noise_free


def gaps_deg(vertices):
    along = np.diff(np.vstack((vertices, vertices[:1])), axis=0)
    directions = np.rad2deg(np.arctan2(along[:, 1], along[:, 0]))
    return np.diff(np.append(directions, directions[0])) % 360.0


def edge_lengths(vertices):
    return np.linalg.norm(np.diff(np.vstack((vertices, vertices[:1])), axis=0), axis=1)


def feet_per_edge(scene):
    """Count, with shapely, the pings whose nearest point of the infinite line lies on the finite edge."""
    counts = []
    for a, b in zip(scene.vertices, np.roll(scene.vertices, -1, axis=0), strict=True):
        unit = (b - a) / np.linalg.norm(b - a)
        edge = LinearRing([a, b, b + 1e-12 * unit[::-1]])
        feet = [a + unit * ((p - a) @ unit) for p in scene.positions]
        counts.append(sum(edge.distance(Point(foot)) < 1e-9 for foot in feet))
    return np.array(counts)


@pytest.mark.parametrize('edges', range(3, 9))
def test_every_random_scene_meets_the_recipe(edges):
    for seed in range(25):
        scene = random_scene(seed, edges)
        assert scene.vertices.shape == (edges, 2)
        room = Polygon(scene.vertices)
        assert room.is_valid
        assert room.exterior.is_ccw
        gaps = gaps_deg(scene.vertices)
        assert gaps.sum() == pytest.approx(360.0)
        assert 20.0 - 1e-9 <= gaps.min() <= gaps.max() <= 150.0 + 1e-9
        assert edge_lengths(scene.vertices).min() >= (0.15 if edges == 8 else 0.24)
        extent = max(np.linalg.norm(a - b) for a in scene.vertices for b in scene.vertices)
        assert 1.0 <= extent <= 2.0
        assert scene.poses.shape == (60, 3)
        assert all(room.contains(Point(p)) and room.exterior.distance(Point(p)) >= 0.06 - 1e-9
                   for p in scene.positions)
        steps = np.linalg.norm(np.diff(scene.positions, axis=0), axis=1)
        assert 0.13 <= steps.min() <= steps.max() <= 0.15
        assert feet_per_edge(scene).min() >= 6
        deviations = np.linalg.svd(scene.positions - scene.positions.mean(axis=0), compute_uv=False)
        assert deviations[1] >= 0.2 * deviations[0]


def test_the_paper_s_device_is_simulated():
    scene = random_scene(0, 5)
    assert (scene.sample_rate_hz, scene.n_samples, scene.t0_s, scene.order, scene.snr_db) == (1e6, 2048, 0.0, 5, 0.0)
    assert (scene.pulse.frequency_hz, scene.pulse.cycles, scene.pulse.window) == (100e3, 2.0, 'hann')
    assert (scene.medium.model, scene.medium.thickness_m) == ('lamb_a0', 0.006)


def test_a_scene_follows_from_its_seed_and_edges_alone():
    np.testing.assert_array_equal(random_scene(7, 4).vertices, random_scene(7, 4).vertices)
    np.testing.assert_array_equal(random_scene(7, 4).poses, random_scene(7, 4).poses)
    assert not np.allclose(random_scene(7, 4).vertices, random_scene(8, 4).vertices)


def test_shapes_differ_between_seeds_in_size_and_direction():
    scenes = [random_scene(seed, 5) for seed in range(60)]
    extents = [max(np.linalg.norm(a - b) for a in s.vertices for b in s.vertices) for s in scenes]
    assert min(extents) < 1.2
    assert max(extents) > 1.8
    headings = [np.arctan2(*(s.vertices[1] - s.vertices[0])) for s in scenes]
    assert abs(np.mean(np.exp(1j * np.array(headings)))) < 0.3


@pytest.mark.parametrize('pings', [20, 40])
def test_fewer_pings(pings):
    scene = random_scene(3, 6, Recipe(pings=pings))
    assert len(scene.poses) == pings
    assert feet_per_edge(scene).min() >= 6


def test_positions_spread_in_both_directions_as_far_as_the_recipe_asks():
    for seed in range(10):
        positions = random_scene(seed, 4, Recipe(least_spread=0.8)).positions
        deviations = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
        assert deviations[1] >= 0.8 * deviations[0]


@pytest.mark.parametrize('edges', range(3, 9))
def test_right_angled_shapes_have_right_angles(edges):
    for seed in range(5):
        right = np.isclose(gaps_deg(random_scene(seed, edges, Recipe('right_angled')).vertices), 90.0)
        assert right.sum() >= {3: 1, 4: 4, 5: 3, 6: 2, 7: 1, 8: 0}[edges]


def test_special_shapes_are_what_they_are_called():
    for seed in range(5):
        needle = random_scene(seed, 3, Recipe('needle'))
        assert 160.0 <= gaps_deg(needle.vertices).max() <= 170.0
        lengths = edge_lengths(random_scene(seed, 6, Recipe('unequal')).vertices)
        assert lengths.max() >= 6.0 * lengths.min()
        regular = random_scene(seed, 7, Recipe('regular')).vertices
        np.testing.assert_allclose(gaps_deg(regular), 360.0 / 7.0)
        np.testing.assert_allclose(edge_lengths(regular), edge_lengths(regular)[0])


def test_an_impossible_recipe_is_said_so():
    assert set(SHAPES) == {'convex', 'right_angled', 'regular', 'needle', 'unequal'}
    with pytest.raises(SceneError, match='needle with 5 edges'):
        random_scene(0, 5, Recipe('needle'))


def test_lossy_walls_have_any_sign_and_magnitude_in_range():
    coefficients = np.concatenate([lossy(random_scene(seed, 6)).reflection for seed in range(40)])
    assert 0.5 <= np.abs(coefficients).min() < 0.52
    assert 0.98 < np.abs(coefficients).max() <= 1.0
    assert 0.4 < np.mean(coefficients > 0.0) < 0.6
    np.testing.assert_array_equal(lossy(random_scene(3, 6)).reflection, lossy(random_scene(3, 6)).reflection)


@pytest.mark.parametrize('pulse', ['tone_burst', 'chirp'])
def test_air_filled_rooms_are_four_times_larger(pulse):
    plate = random_scene(2, 4)
    room = air_filled(plate, pulse)
    np.testing.assert_allclose(room.vertices, 4.0 * plate.vertices)
    np.testing.assert_allclose(room.positions, 4.0 * plate.positions)
    assert (room.medium.model, room.medium.speed_m_s, room.medium.spreading) == ('constant', 343.0, 1.0)
    assert room.parameters().grid.range_max_m >= 8.0
    nearest = np.min([LinearRing(room.vertices).distance(Point(p)) for p in room.positions[:1]])
    samples = noise_free(air_filled(plate, pulse))[0]
    first = np.flatnonzero(np.abs(samples) > 0.02 * np.abs(samples).max())[0] * room.period_s
    assert first == pytest.approx(2.0 * nearest / 343.0, abs=0.4 * room.pulse.duration_s + 4e-5)
