"""Paths over curved edges and rounded corners, against minimisation, a tube of rays, and mirrors' own formula."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize

from polymap_ros.errors import SceneError
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.simulation.bent_edges import BentOutline
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.propagation import Propagation
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import noise_free

PLATE = random_scene(2, 6)
ALL = np.ones(6)
EMITTERS = PLATE.positions[::12]
RECEIVERS = EMITTERS + (0.01, -0.02)


def bent(curvature, edge=4, corner_radius_m=0.0):
    return BentOutline(PLATE.vertices, np.where(np.arange(6) == edge, curvature, 0.0), corner_radius_m)


def points_on(outline, edge, t):
    """Points (m, 2) of an edge at t from its middle, from its definition."""
    start, end = outline.vertices[edge], outline.vertices[(edge + 1) % len(outline.vertices)]
    along = (end - start) / np.hypot(*(end - start))
    inwards = np.array((-along[1], along[0]))
    t = np.asarray(t)[..., None]
    return 0.5 * (start + end) + t * along + 0.5 * outline.curvature[edge] * t**2 * inwards


def length(way):
    return np.hypot(*way.legs.T).sum()


@pytest.mark.parametrize('at', range(len(EMITTERS)))
def test_straight_edges_give_the_image_sources(at):
    amplitudes, found = bent(0.0).paths(EMITTERS[at], RECEIVERS[at], 4, -0.5 * ALL)
    images = visible_images(PLATE.vertices, EMITTERS[at], 4, -0.5, RECEIVERS[at])
    order = np.argsort([length(way) for way in found])
    assert len(found) == len(images.order)
    np.testing.assert_allclose([length(found[k]) for k in order], images.distance_m, atol=1e-6)
    np.testing.assert_allclose(amplitudes[order], images.amplitude, atol=1e-9)


@pytest.mark.parametrize('curvature', [0.1, 0.02, -0.02, -0.1])
def test_ways_are_where_their_length_is_stationary(curvature):
    outline, compared = bent(curvature), 0
    for emitter, receiver in zip(EMITTERS, RECEIVERS, strict=True):
        for way in outline.paths(emitter, receiver, 3, ALL)[1]:
            if 4 not in way.walls:
                continue

            def whole(t, way=way, emitter=emitter, receiver=receiver):
                hits = [points_on(outline, wall, each) for wall, each in zip(way.walls, t, strict=True)]
                return np.hypot(*np.diff(np.array([emitter, *hits, receiver]), axis=0).T).sum()

            least = minimize(whole, np.zeros(len(way.walls)), method='BFGS', options={'gtol': 1e-10}).fun
            assert length(way) == pytest.approx(least, abs=1e-6)
            compared += 1
    assert compared > 50


def test_a_right_angle_returns_one_echo():
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 0.8), (0.0, 0.8)])
    here = np.array((0.37, 0.31))
    _, found = BentOutline(square, np.zeros(4)).paths(here, here, 3, np.ones(4))
    assert len(found) == len(visible_images(square, here, 3).order)


@pytest.mark.parametrize('curvature', [0.05, -0.05])
def test_a_mirror_focuses_as_its_formula_says(curvature):
    """From d before a mirror and back a tube of rays is as wide as one of the length 2 d (1 - c d)."""
    square = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
    here = np.array((1.0, 0.7))
    amplitudes, found = BentOutline(square, np.array([curvature, 0.0, 0.0, 0.0])).paths(here, here, 1, np.ones(4))
    heard = next(amplitude for amplitude, way in zip(amplitudes, found, strict=True) if way.walls[0] == 0)
    assert heard == pytest.approx((1.0 - 0.7 * curvature) ** -0.5, rel=1e-6)


def test_what_comes_over_several_edges_is_as_strong_as_a_tube_of_rays_is_narrow():
    """The ends of two rays, a microradian apart, that are reflected edge by edge."""
    outline, compared = bent(0.1), 0
    for emitter, receiver in zip(EMITTERS, RECEIVERS, strict=True):
        for amplitude, way in zip(*outline.paths(emitter, receiver, 3, ALL), strict=True):
            first, last = way.legs[0], way.legs[-1]
            start = np.arctan2(first[1], first[0])
            ends = [shot(outline, way, start + turn) for turn in (0.0, 1e-6)]
            wide = abs(across(last / np.hypot(*last), ends[1] - ends[0])) / 1e-6
            assert abs(amplitude) == pytest.approx(np.sqrt(length(way) / wide), rel=1e-3)
            compared += np.sum(way.walls == 4) > 1
    assert compared >= 2


def across(one, other):
    return one[0] * other[1] - one[1] * other[0]


def shot(outline, way, angle):
    """Where a ray from the start of a way ends, over the same edges, at the end of its last leg's normal line."""
    place, direction = way.points[0], np.array((np.cos(angle), np.sin(angle)))
    for wall in way.walls:
        t = np.linspace(-2.0, 2.0, 40001)
        beside = points_on(outline, wall, t) - place
        away = direction[0] * beside[:, 1] - direction[1] * beside[:, 0]
        k = next(k for k in np.flatnonzero(away[1:] * away[:-1] <= 0.0) if beside[k] @ direction > 0.0)
        at = t[k]
        for _ in range(5):  # Newton
            point = points_on(outline, wall, at)
            slope = (points_on(outline, wall, at + 1e-6) - points_on(outline, wall, at - 1e-6)) / 2e-6
            at -= across(direction, point - place) / across(direction, slope)
        place = points_on(outline, wall, at)
        slope /= np.hypot(*slope)
        direction = 2.0 * (direction @ slope) * slope - direction
    last = way.legs[-1] / np.hypot(*way.legs[-1])
    return place + direction * (((way.points[-1] - place) @ last) / (direction @ last))


def test_rounded_corners_take_the_ends_of_edges_and_echo():
    radius_m = 0.05
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    outline = BentOutline(square, np.zeros(4), radius_m)
    here = np.array((0.03, 0.4))  # its foot on edge 0 is where the corner is round
    amplitudes, found = outline.paths(here, here, 1, np.ones(4))
    lengths = {round(length(way), 6): amplitude for amplitude, way in zip(amplitudes, found, strict=True)}
    assert 0.8 not in lengths
    assert {0.06, 1.94} <= lengths.keys()
    assert 1.2 not in lengths
    # the corner at (1, 0): on from the centre of its circle by the radius
    away = np.hypot(0.95 - 0.03, 0.05 - 0.4)
    assert lengths[round(2.0 * (away + radius_m), 6)] == pytest.approx(1j * np.sqrt(radius_m / away))


def test_a_scene_sounds_by_its_bent_edges():
    scene = dataclasses.replace(PLATE, poses=PLATE.poses[:3], order=2)
    straight, curved = noise_free(scene), noise_free(
        dataclasses.replace(scene, edges=Edges(curvature_1_m=0.05, curved_edge=4)))
    assert np.abs(curved - straight).max() > 0.3 * np.abs(straight).max()
    same = noise_free(dataclasses.replace(scene, edges=Edges(curvature_1_m=1e-12, curved_edge=4)))
    np.testing.assert_allclose(same, straight, atol=2e-4 * np.abs(straight).max())


def test_scenes_that_cannot_be_bent_are_refused():
    with pytest.raises(SceneError, match=r'curved_edge must be below 6'):
        dataclasses.replace(PLATE, edges=Edges(curvature_1_m=0.05, curved_edge=6))
    with pytest.raises(SceneError, match=r'corner_radius_m 1 leaves nothing of an edge'):
        dataclasses.replace(PLATE, edges=Edges(corner_radius_m=1.0))
    with pytest.raises(SceneError, match=r'without propagation.anisotropy'):
        dataclasses.replace(PLATE, edges=Edges(corner_radius_m=0.01), propagation=Propagation(anisotropy=0.01))
    with pytest.raises(SceneError, match=r'act in convex outlines'):
        dataclasses.replace(load_scene('l_shape'), edges=Edges(corner_radius_m=0.01))
