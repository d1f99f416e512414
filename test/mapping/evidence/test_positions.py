"""Positions that are off: moved pings against the true ones, and what all of them share against shapely's motions."""

import dataclasses

import numpy as np
import pytest
import shapely
from shapely import affinity

from polymap_ros.acoustics.ping import Ping
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.mapping.comparison import compare
from polymap_ros.mapping.evidence.positions import _moves, anchored, drift
from polymap_ros.mapping.evidence.search import Search
from polymap_ros.mapping.lines import half_plane_polygon, polygon_lines
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.results.dimensions import dimensions
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import simulate


def test_what_all_pings_share_is_taken_back_together_with_the_walls():
    scene = random_scene(4, 5)
    reported, generator = scene.positions, np.random.default_rng(1)
    own = 1e-3 * generator.normal(size=reported.shape)
    offsets, lines = anchored(reported, own, polygon_lines(scene.vertices))
    turn, shift = 1e-3, np.array([2e-3, -1e-3])  # small, as it is linear in the turn
    moved = affinity.translate(affinity.rotate(
        shapely.MultiPoint(reported + own), turn, tuple(reported.mean(axis=0)), use_radians=True), *shift)
    room = affinity.translate(affinity.rotate(
        shapely.Polygon(scene.vertices), turn, tuple(reported.mean(axis=0)), use_radians=True), *shift)
    corners = np.array(room.exterior.coords)[:-1]
    places = np.array([point.coords[0] for point in moved.geoms])
    again, back = anchored(reported, places - reported, polygon_lines(corners))
    np.testing.assert_allclose(again, offsets, atol=3e-6)
    np.testing.assert_allclose(half_plane_polygon(back)[0], half_plane_polygon(lines)[0], atol=3e-6)
    assert np.abs(again.mean(axis=0)).max() < 1e-12


@pytest.mark.parametrize(('edges', 'seed'), [(4, 0)])
def test_with_positions_5_mm_off_the_room_is_known_to_a_tenth_of_that(edges, seed):
    """The room's place is known as well as the mean of all positions; its shape far better."""
    scene = VARIANTS['position_noise'].make(edges=edges, seed=seed)
    estimate = filled_mapper(scene, Parameters()).solve()
    assert estimate.status == 'closed'
    assert [caution.code for caution in estimate.cautions] == ['misplaced']
    assert 'moved by' in estimate.cautions[0].text
    found = dimensions(estimate.polygon)
    true = np.linalg.norm(np.roll(scene.vertices, -1, axis=0) - scene.vertices, axis=1)
    turns = [np.abs(np.roll(true, k) - found.lengths_m).max() for k in range(edges)]
    assert min(turns) < 5e-4
    errors = np.roll(true, int(np.argmin(turns))) - found.lengths_m
    assert np.abs(errors / found.length_stds_m).max() < 4.0
    assert found.length_stds_m.max() < 5e-4
    shift = np.linalg.norm(np.mean(estimate.polygon.vertices, axis=0) - np.mean(scene.vertices, axis=0))
    assert 1e-4 < shift < 4.0 * 5e-3 / np.sqrt(len(scene.poses)) * 1.5


@pytest.mark.parametrize('step_m', [1e-3, 4e-3])
def test_every_ping_is_moved_to_its_most_likely_place(step_m, hear, pentagon, inside, finished):
    """By two Gaussians, one of them about the reported place; on a grid about the place of today."""
    heard, generator = hear(pentagon, inside(pentagon, 30), order=1), np.random.default_rng(2)
    today = heard.data.positions
    reported, told = (today + generator.normal(0.0, 2e-3, (30, 2)) for _ in range(2))
    steps = _moves(heard.data, reported, lambda data: -0.5 * np.sum((data.positions - told) ** 2, axis=1) / 1e-3**2,
                   step_m, 3, 2e-3)
    offsets, deviation = finished(steps)
    best = (4.0 * told + reported) / 5.0
    nearest = today + np.clip(np.round((best - today) / step_m), -3, 3) * step_m
    np.testing.assert_allclose(reported + offsets, nearest, atol=1e-12)
    assert deviation == pytest.approx(max(np.sqrt(np.mean(offsets**2)), step_m))


def test_moves_of_noise_are_told_from_those_of_a_drift():
    """Scale, yaw drift and a random walk, twice the noise beside them; a path, and one that comes by places again."""
    generator = np.random.default_rng(3)
    drifting = {'none': 0, 'scale': 0, 'yaw': 0, 'walk': 0}
    for seed in range(50):
        scene = random_scene(seed, 5)
        reported, times = scene.positions, np.sort(generator.uniform(0.0, 600.0, len(scene.poses)))
        reported = reported[generator.permutation(len(reported))] if seed % 2 else reported
        away = reported - reported[0]
        turned = away @ [[0.0, 1.0], [-1.0, 0.0]]
        ways = {'none': np.zeros_like(reported), 'scale': away, 'yaw': times[:, None] * turned,
                'walk': np.cumsum(generator.normal(size=reported.shape), axis=0)}
        for name, way in ways.items():
            own = 2.0 * way / max(way.std(), 1e-9) + generator.normal(size=way.shape)
            offsets, _ = anchored(reported, 1e-3 * own, polygon_lines(scene.vertices))
            drifting[name] += drift(times, reported, offsets)
    assert drifting['none'] <= 3
    assert min(drifting['scale'], drifting['yaw'], drifting['walk']) >= 47


def test_pings_are_not_said_to_be_misplaced_where_only_the_walls_were_off():
    """The first polygon found here has no phase; the one that moved pings lead to has it without the moves."""
    scene = random_scene(125, 6)
    estimate = filled_mapper(scene, Parameters()).solve()
    assert compare(estimate.polygon.vertices, scene.vertices).right
    assert estimate.cautions == ()


@pytest.mark.parametrize('noise_m', [0.001, 0.004])
def test_pings_that_come_later_join_those_that_were_moved_without_another_search(noise_m, monkeypatch):
    scene = dataclasses.replace(random_scene(800, 4), position_noise_m=noise_m)
    messages = list(zip(scene.stamps_ns.tolist(), scene.reported_poses().tolist(), simulate(scene), strict=True))
    mapper = PolygonMapper(scene.parameters(Parameters()))

    def feed(some):
        for stamp_ns, pose, samples in some:
            mapper.add_pose(stamp_ns, Pose(*pose))
            mapper.add_ping(Ping(stamp_ns, samples, scene.period_s, scene.t0_s))

    feed(messages[:55])
    mapper.solve()
    monkeypatch.setattr(Search, 'starts', lambda search: pytest.fail('searched again'))
    for message in messages[55:]:
        feed([message])
        estimate = mapper.solve()
        assert [caution.code for caution in estimate.cautions] == ['misplaced']
        assert compare(estimate.polygon.vertices, scene.vertices).right
        said_mm = float(estimate.cautions[0].text.split('moved by ')[1].split(' mm')[0])
        assert said_mm == pytest.approx(1e3 * noise_m, rel=0.3)
