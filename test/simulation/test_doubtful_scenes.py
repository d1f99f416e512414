"""Every kind of doubtful scene is what its name says."""

import dataclasses

import numpy as np
import pytest
import shapely

from polymap_ros.simulation.doubtful_scenes import KINDS, ORDINARY, l_shape, t_shape
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import noise_free, pings

SEED, EDGES = 4, 5


def made(name):
    return KINDS[name].make(SEED, EDGES)


def share(part, whole):
    return np.mean(part**2) / np.mean(whole**2)


@pytest.mark.parametrize('name', KINDS)
def test_the_same_seed_gives_the_same_echoes_and_another_one_others(name):
    first, again, other = made(name), made(name), KINDS[name].make(SEED + 2, EDGES)
    assert first.clean.shape == (60, first.scene.n_samples)
    np.testing.assert_array_equal(first.clean, again.clean)
    assert not np.allclose(first.clean, other.clean)


def test_an_ordinary_scene_is_the_random_one():
    np.testing.assert_array_equal(made(ORDINARY).clean, noise_free(random_scene(SEED, EDGES)))


@pytest.mark.parametrize(('name', 'width'), [('straight', 0.0), ('nearly_straight', 0.015), ('bent', 0.05)])
def test_a_path_along_a_line_is_as_wide_as_said(name, width):
    scene = made(name).scene
    along = scene.poses[-1, :2] - scene.poses[0, :2]
    length = np.linalg.norm(along)
    aside = (scene.poses[:, :2] - scene.poses[0, :2]) @ np.array((-along[1], along[0])) / length
    assert length > 0.4
    assert np.ptp(aside) / length == pytest.approx(width, rel=0.02, abs=1e-9)


def test_one_wall_is_not_heard():
    reflection = made('unheard').scene.reflection
    assert sorted(reflection) == [0.0, 1.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize('outline', [l_shape, t_shape])
def test_outlines_are_simple_and_not_convex(outline):
    polygon = shapely.Polygon(outline(np.random.default_rng(2)))
    assert polygon.is_valid
    assert polygon.exterior.is_ccw
    assert polygon.area < 0.95 * polygon.convex_hull.area


@pytest.mark.parametrize('name', ['l_shape', 't_shape'])
def test_the_path_stays_inside_and_spreads(name):
    positions = made(name).scene.poses[:, :2]
    outline = shapely.Polygon(made(name).scene.vertices)
    assert shapely.contains_xy(outline.buffer(-0.05), *positions.T).all()
    assert np.ptp(positions, axis=0).min() > 0.3


@pytest.mark.parametrize('name', ['seam', 'stiffener'])
def test_a_seam_adds_echoes_and_weakens_others(name):
    plain, seamed = noise_free(random_scene(SEED, EDGES)), made(name).clean
    assert 0.05 < share(seamed - plain, plain) < 2.0


@pytest.mark.parametrize(('name', 'ratio'), [('mode_0db', 1.0), ('mode_-10db', 0.1)])
def test_the_second_mode_is_as_strong_as_said(name, ratio):
    plain = noise_free(random_scene(SEED, EDGES))
    assert share(made(name).clean - plain, plain) == pytest.approx(ratio)


@pytest.mark.parametrize('name', ['wrong_speeds', 'wrong_thickness'])
def test_a_mistaken_medium_is_told_to_the_mapper_only(name):
    scene = random_scene(SEED, EDGES)
    np.testing.assert_array_equal(made(name).clean, noise_free(scene))
    assert made(name).scene.parameters().medium != scene.medium


def test_other_echoes_take_the_place_of_the_scene_s_in_its_pings():
    case = made('mode_0db')
    quiet = dataclasses.replace(case.scene, snr_db=None)
    heard = np.array([ping.samples for ping in pings(quiet, case.clean)])
    np.testing.assert_allclose(heard, case.clean, rtol=1e-6, atol=1e-7 * abs(case.clean).max())
