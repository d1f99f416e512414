"""What the medium and the device do to echoes beside the model, against ways and spectra worked out by hand."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.optimize import minimize

from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.propagation import Propagation, ways
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import Synthesis, noise_free

PLATE = random_scene(4, 5)
PLATE = dataclasses.replace(PLATE, poses=PLATE.poses[:6], order=2)
EACH_PING = range(len(PLATE.poses))


def echoes(scene, of_paths):
    """Samples of the sum of one wave per path: `of_paths` gives length, amplitude and delay of those of ping i."""
    medium, pulse = make_medium(scene.medium), make_pulse(scene.pulse)
    synthesis = Synthesis(medium, pulse, scene.n_samples, scene.period_s)
    return np.array([sum(synthesis(np.array([length]), np.array([amplitude]), np.array([late]))
                         for length, amplitude, late in of_paths(i)) for i in EACH_PING])


def images(i):
    return visible_images(PLATE.vertices, PLATE.positions[i], PLATE.order, PLATE.reflection)


def shortest(medium, position, walls):
    """Length of the way over points on these walls that is stationary in time, by minimisation and no image."""
    starts, ends = PLATE.vertices[walls], np.roll(PLATE.vertices, -1, axis=0)[walls]

    def length(shares):
        points = starts + shares[:, None] * (ends - starts)
        return medium.length_m(np.diff(np.vstack((position, points, position)), axis=0))

    return minimize(length, np.full(len(walls), 0.5), tol=1e-14).fun


def test_of_a_rolled_plate_ways_are_those_of_least_time():
    medium = Propagation(anisotropy=0.02, anisotropy_deg=25.0)
    position, n = PLATE.positions[2], len(PLATE.vertices)
    expected = [shortest(medium, position, np.array(walls)) for walls in
                [(wall,) for wall in range(n)] + list(itertools.permutations(range(n), 2))]
    heard = noise_free(dataclasses.replace(PLATE, propagation=medium))
    stretched = visible_images(PLATE.vertices @ medium.stretch, medium.stretch @ position, 2)
    lengths = [length for length, walls in zip(
        expected, [(wall,) for wall in range(n)] + list(itertools.permutations(range(n), 2)), strict=True)
        if any(tuple(met[:order]) == walls for met, order in zip(stretched.walls, stretched.order, strict=True))]
    assert len(lengths) == len(stretched.order)
    by_hand = echoes(PLATE, lambda _: [(length, 1.0, 0.0) for length in lengths])[2]
    assert np.abs(heard[2] - by_hand).max() < 2e-3 * np.abs(by_hand).max()  # 1e-6 m by the two laws
    plain = noise_free(PLATE)[2]
    assert np.abs(plain - by_hand).max() > 0.5 * np.abs(by_hand).max()


def test_ways_go_over_the_walls_by_equal_angles():
    found = images(0)
    for way, distance in zip(ways(found, PLATE.vertices, PLATE.positions[0]), found.distance_m, strict=True):
        assert np.hypot(*way.legs.T).sum() == pytest.approx(distance)
        np.testing.assert_allclose(way.points[[0, -1]], PLATE.positions[[0, 0]])
        for wall, point, before, after in zip(way.walls, way.points[1:-1], way.legs, way.legs[1:], strict=False):
            along = PLATE.vertices[(wall + 1) % len(PLATE.vertices)] - PLATE.vertices[wall]
            share = (point - PLATE.vertices[wall]) @ along / (along @ along)
            assert -1e-9 <= share <= 1.0 + 1e-9
            np.testing.assert_allclose(point, PLATE.vertices[wall] + share * along, atol=1e-9)
            along = along / np.hypot(*along)
            assert before @ along / np.hypot(*before) == pytest.approx(after @ along / np.hypot(*after))


def test_a_speed_that_drifts_makes_ways_shorter_from_ping_to_ping():
    heard = noise_free(dataclasses.replace(PLATE, propagation=Propagation(speed_drift=0.05)))
    faster = 1.0 + 0.05 * np.arange(6) / 5
    by_hand = echoes(PLATE, lambda i: [(each / faster[i], a, 0.0) for each, a in zip(*images(i)[:2], strict=True)])
    np.testing.assert_allclose(heard, by_hand, atol=1e-9 * np.abs(by_hand).max())


def test_attenuation_takes_more_of_higher_frequencies():
    loss = Propagation(attenuation_np_m=0.4)
    whole = dataclasses.replace(PLATE, vertices=[[0, 0], [1, 0], [1, 1], [0, 1]], reflection=1.0,
                                poses=[[0.5, 0.5, 0.0]], order=1)
    plain, left = (np.abs(np.fft.rfft(noise_free(scene)[0])) for scene in (
        whole, dataclasses.replace(whole, propagation=loss)))
    frequency = np.fft.rfftfreq(whole.n_samples, 1e-6)
    band = (frequency > 60e3) & (frequency < 140e3)
    np.testing.assert_allclose(left[band] / plain[band], np.exp(-0.4 * frequency[band] / 1e5), rtol=0.01)


def test_a_coating_delays_by_as_much_at_every_reflection():
    heard = noise_free(dataclasses.replace(PLATE, edges=Edges(delay_s=2.5e-6)))
    by_hand = echoes(PLATE, lambda i: [
        (each, a, 2.5e-6 * order) for each, a, order in zip(*images(i)[:3], strict=True)])
    np.testing.assert_allclose(heard, by_hand, atol=1e-9 * np.abs(by_hand).max())


def test_a_device_with_a_direction_is_loudest_ahead():
    scene = dataclasses.replace(PLATE, order=1, poses=[[*PLATE.positions[0], 0.6]], faults=Faults(directivity=0.5))
    found = visible_images(PLATE.vertices, PLATE.positions[0], 1)
    towards = found.position_m - PLATE.positions[0]
    factors = (1.0 + 0.5 * np.cos(np.arctan2(towards[:, 1], towards[:, 0]) - 0.6)) ** 2  # there and back the same way
    synthesis = Synthesis(make_medium(scene.medium), make_pulse(scene.pulse), scene.n_samples, scene.period_s)
    np.testing.assert_allclose(noise_free(scene)[0], synthesis(found.distance_m, factors), atol=1e-9)


def test_coloured_noise_has_the_spectrum_of_what_is_passed_on():
    noise = dataclasses.replace(random_scene(4, 5), faults=Faults(noise_colour=0.9)).noise()
    assert np.mean(noise**2) == pytest.approx(1.0, abs=0.03)
    for lag in (1, 5, 20):
        assert np.mean(noise[:, lag:] * noise[:, :-lag]) == pytest.approx(0.9**lag, abs=0.03)


def test_what_the_medium_does_is_read_from_a_scene_file_and_does_not_go_with_holes(tmp_path):
    from polymap_ros.errors import SceneError
    from polymap_ros.simulation.scene_file import load_scene

    text = 'vertices: [[0, 0], [2, 0], [0, 2]]\nposes: [[0.3, 0.3, 0.0]]\n'
    path = tmp_path / 'plate.scene.yaml'
    path.write_text(text + 'propagation: {anisotropy: 0.02, anisotropy_deg: 30}\n')
    assert load_scene(path).propagation == Propagation(anisotropy=0.02, anisotropy_deg=30.0)
    path.write_text(path.read_text() + 'holes: [[[0.5, 0.5], [0.7, 0.5], [0.5, 0.7]]]\n')
    with pytest.raises(SceneError, match=r'propagation\.anisotropy acts in scenes without holes'):
        load_scene(path)
    path.write_text(text + 'propagation: {speed_drift: 2}\n')
    with pytest.raises(SceneError, match=r'propagation\.speed_drift'):
        load_scene(path)
