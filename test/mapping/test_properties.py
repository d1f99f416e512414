"""What must not matter does not: where the odometry's origin is, the order of pings, their scale, a save in between."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.pose_track import PoseTrack
from polymap_ros.map_parameters import GridParameters
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.maps.free_area import FreeArea
from polymap_ros.parameters import OdometryParameters, Parameters
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import pings

NS = 10**9
PARAMETERS = Parameters().replaced({
    'medium.model': 'constant', 'medium.speed_m_s': 1500.0, 'grid.range_max_m': 0.2, 'grid.angle_step_deg': 10.0,
    'echo.blanking_m': 0.0})
FEW = settings(max_examples=25, deadline=None)

metres = st.floats(-100.0, 100.0)
angles = st.floats(-np.pi, np.pi)
motions = st.builds(Pose, metres, metres, angles)
near = st.floats(-0.1, 0.1)
places = st.builds(Pose, near, near, angles)
drives = st.lists(places, min_size=2, max_size=8)


def ping(k, ns, scale=1.0):
    return Ping(ns, np.random.default_rng(k).normal(size=256) * scale, 1e-6)


def mapped(drive, scale=1.0):
    mapper = PolygonMapper(PARAMETERS)
    for k, pose in enumerate(drive):
        mapper.add_pose(k * NS // 10, pose)
        mapper.add_ping(ping(k, k * NS // 10, scale))
    mapper.finish()
    return mapper


def same_state(one, other):
    a, b = one.state(), other.state()
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


@FEW
@given(drives, motions)
def test_the_map_does_not_depend_on_where_the_odometry_began(drive, motion):
    here, there = mapped(drive), mapped([motion.compose(pose) for pose in drive])
    np.testing.assert_allclose(there.beam_map.values, here.beam_map.values, atol=1e-5)
    assert there.free_area.area == pytest.approx(here.free_area.area, abs=1e-9)
    moved = motion.compose(here.start_pose)
    np.testing.assert_allclose([there.start_pose.x, there.start_pose.y], [moved.x, moved.y], atol=1e-9)


@FEW
@given(drives, st.integers(-60, 60))
def test_the_map_does_not_depend_on_the_scale_of_the_signal(drive, exponent):
    scaled = mapped(drive, 10.0**exponent)
    np.testing.assert_allclose(scaled.beam_map.values, mapped(drive).beam_map.values, atol=1e-5)


@FEW
@given(st.permutations(range(6)), places, places)
def test_the_order_in_which_pings_between_two_poses_come_does_not_matter(order, first, last):
    mappers = []
    for turn in (range(6), order):
        mapper = PolygonMapper(PARAMETERS)
        mapper.add_pose(0, first)
        for k in turn:
            mapper.add_ping(ping(k, (k + 1) * NS // 40))
        mapper.add_pose(NS // 5, last)
        mappers.append(mapper)
    assert mappers[0].counts.used == 6
    same_state(*mappers)


@FEW
@given(drives, st.data())
def test_a_save_in_between_does_not_matter(drive, data):
    cut = data.draw(st.integers(0, len(drive)))
    whole, saved = PolygonMapper(PARAMETERS), PolygonMapper(PARAMETERS)
    for k, pose in enumerate(drive):
        if k == cut:
            saved = PolygonMapper.from_state(PARAMETERS, saved.state())
        for mapper in (whole, saved):
            mapper.add_ping(ping(k, k * NS // 10 + NS // 20))  # waits for the next pose
            mapper.add_pose(k * NS // 10, pose)
    same_state(whole, PolygonMapper.from_state(PARAMETERS, saved.state()))


@FEW
@given(st.lists(st.tuples(near, near, st.floats(0.01, 0.2)), min_size=1, max_size=6), st.randoms(use_true_random=False))
def test_the_free_area_grows_and_does_not_depend_on_the_order(discs, random):
    areas, free = [0.0], FreeArea()
    for disc in discs:
        free.add(*disc)
        areas.append(free.area)
    assert all(after >= before - 1e-12 for before, after in pairwise(areas))
    other = FreeArea()
    for disc in random.sample(discs, len(discs)):
        other.add(*disc)
    assert other.area == pytest.approx(free.area, rel=1e-9)
    assert 0.0 <= free.iou(np.array([(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)])) <= 1.0


@FEW
@given(st.lists(st.tuples(near, near), min_size=2, max_size=6), st.randoms(use_true_random=False))
def test_the_beamforming_map_does_not_depend_on_the_order(positions, random):
    grid = GridParameters(range_max_m=0.2, angle_step_deg=30.0)
    maps = [BeamformingMap(grid), BeamformingMap(grid)]
    envelopes = np.random.default_rng(1).random((len(positions), len(maps[0].r_m)), np.float32)
    orders = range(len(positions)), random.sample(range(len(positions)), len(positions))
    for beam_map, order in zip(maps, orders, strict=True):
        for k in order:
            beam_map.add(*positions[k], envelopes[k])
    np.testing.assert_allclose(maps[1].values, maps[0].values, atol=1e-5)


@FEW
@given(places, places, st.floats(0.0, 1.0), motions)
def test_a_pose_between_two_moves_with_them(first, last, share, motion):
    at_ns = round(share * NS / 10)
    found = []
    for move in (Pose(0.0, 0.0), motion):
        track = PoseTrack(OdometryParameters())
        for stamp_ns, pose in ((0, first), (NS // 10, last)):
            assert track.add(stamp_ns, move.compose(pose))
        found.append(track.at(at_ns))
    moved = motion.compose(found[0])
    np.testing.assert_allclose([found[1].x, found[1].y], [moved.x, moved.y], atol=1e-9)
    turn = (last.yaw - first.yaw + np.pi) % (2.0 * np.pi) - np.pi
    if abs(abs(turn) - np.pi) > 1e-6:  # half a turn has two short ways
        assert np.cos(found[1].yaw - moved.yaw) == pytest.approx(1.0, abs=1e-9)
    expected = np.array([first.x, first.y]) * (1.0 - share) + np.array([last.x, last.y]) * share
    np.testing.assert_allclose([found[0].x, found[0].y], expected, atol=1e-9)


@pytest.fixture(scope='module')
def triangle():
    scene = load_scene('triangle', None)
    return scene.poses, pings(scene)


@pytest.mark.parametrize('method', ['evidence', 'paper'])
@pytest.mark.parametrize(('motion', 'scale'), [(Pose(40.0, -7.0, 2.5), 1.0), (Pose(0.0, 0.0), 1e-12)])
def test_the_polygon_moves_with_the_scene_and_not_with_the_scale(triangle, method, motion, scale):
    answers = []
    for move, factor in ((Pose(0.0, 0.0), 1.0), (motion, scale)):
        mapper = PolygonMapper(Parameters().replaced({'solver.method': method}))
        for row, one in zip(*triangle, strict=True):
            mapper.add_pose(one.stamp_ns, move.compose(Pose(*row)))
            mapper.add_ping(dataclasses.replace(one, samples=one.samples * np.float32(factor)))
        answers.append(mapper.solve().polygon.vertices)
    still, moved = answers
    expected = motion.apply(still)
    gaps = np.hypot(*(moved[:, None] - expected).transpose(2, 0, 1)).min(axis=1)
    assert len(moved) == len(still)
    assert gaps.max() < 1e-4
