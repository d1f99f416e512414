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
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.tracking import Chain, refined
from polymap_ros.solvers.evidence.windows import windows


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
