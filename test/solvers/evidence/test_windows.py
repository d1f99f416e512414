"""Windows of pings at the level `bad` of the odometry, against the simulated truth."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.slam_experiment import CASES
from polymap_ros.evaluation.trials import feed
from polymap_ros.geometry.alignment import alignment
from polymap_ros.geometry.outline import corners_of
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.poses import between
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.evidence.odometry import OdometryNoise
from polymap_ros.solvers.evidence.phase_lock import locked
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.tracking import Chain, judged_track, refined
from polymap_ros.solvers.evidence.windows import SETTLED, if_settled, windows


@pytest.fixture(scope='module')
def scene():
    return dataclasses.replace(CASES['bad'].make(4, 6), snr_db=0.0)


def first_window(scene, shift_m):
    """The first window that is solved, of odometry that began elsewhere; with what it was solved from."""
    mapper = PolygonMapper(scene.parameters(Parameters()), scene.recorded_pulse)
    feed(mapper, scene)
    search = search_of(mapper.evidence, mapper.parameters)
    chain = Chain.of(mapper.evidence.soundings, search.data, OdometryNoise.assumed(mapper.parameters.slam))
    poses = chain.poses + (*shift_m, 0.0)
    search, chain = search.over(search.data.at(poses)), chain._replace(poses=poses)
    return search, chain, next(windows(search, chain))


def test_a_window_is_solved_to_the_millimetre_wherever_the_odometry_began(scene):
    """Where the drift has carried the origin beyond a wall, too: 30 m off, all walls lie on one side of it."""
    for shift_m in ((0.0, 0.0), (30.0, -20.0)):
        _, _, track = first_window(scene, shift_m)
        true = scene.poses[track.pings]
        motion = alignment(track.poses[:, :2], true[:, :2])
        assert np.max(np.abs(motion.apply(track.poses[:, :2]) - true[:, :2])) < 1e-3
        assert compare(motion.apply(corners_of(track.found.lines)[1]), scene.vertices).right


def test_pings_are_locked_in_phase_from_where_power_leaves_them(scene):
    """8 mm off, most of a cycle, between walls that are 1 mm off: a climb of all together does not come back."""
    search, chain, track = first_window(scene, (0.0, 0.0))
    climbed = []
    for seed in range(1, 4):
        generator, poses, lines = np.random.default_rng(seed), track.poses.copy(), track.found.walls.lines.copy()
        poses[:, :2] += generator.normal(0.0, 8e-3, (len(poses), 2))
        lines[:, 0] += generator.normal(0.0, 1e-3, len(lines))
        walls = dataclasses.replace(track.found.walls, lines=lines)
        together = track.found._replace(wave=track.found.wave.with_walls(walls))
        climbed.append(if_settled(refined(search, chain, together, track.pings, poses)))
        unsigned = dataclasses.replace(walls, reflection=np.ones(len(lines)))
        by_power = track.found._replace(power=track.found.power.with_walls(unsigned), wave=None)
        found = if_settled(locked(search, chain, judged_track(search, by_power, track.pings, poses), SETTLED))
        true = scene.poses[found.pings]
        motion = alignment(found.poses[:, :2], true[:, :2])
        assert np.max(np.abs(motion.apply(found.poses[:, :2]) - true[:, :2])) < 1e-3
    assert None in climbed


@pytest.mark.parametrize('pose', [0, 5, -1])
def test_a_heading_that_is_wrong_is_put_right_and_no_slip(scene, pose):
    """By 13 deg, which moves the next pose by 30 mm as it is seen from there: the first one's, too."""
    search, chain, track = first_window(scene, (0.0, 0.0))
    poses = track.poses.copy()
    poses[pose, 2] += 0.23
    again = refined(search, chain, track.found, track.pings, poses)
    away = between(again.poses[:1], again.poses) - between(track.poses[:1], track.poses)
    np.testing.assert_allclose(np.hypot(away[:, 0], away[:, 1]), 0.0, atol=1e-3)
    np.testing.assert_allclose(away[:, 2], 0.0, atol=0.01)
