"""Odometry freed of its scale and drift: against the simulator's faults, whole paths and pose by pose."""

import numpy as np
import pytest

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.odometry_error import OdometryCorrection, OdometryError
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.odometry import Drift, reported
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import pings


def path():
    generator = np.random.default_rng(3)
    return np.column_stack((np.cumsum(generator.normal(size=(200, 2)), axis=0), generator.uniform(-3, 3, 200)))


@pytest.mark.parametrize(('scale', 'drift'), [(1.02, 0.0), (1.0, -2.0), (0.97, 3.5)])
def test_what_the_simulator_adds_is_taken_away(scale, drift):
    wrong = reported(path(), Drift(scale=scale, heading_deg_m=drift), np.random.default_rng(1))
    assert np.abs(wrong - path()).max() > 0.1
    np.testing.assert_allclose(OdometryError(scale, drift).corrected(wrong), path(), atol=1e-9)


def test_a_circle_driven_with_a_drift_is_a_spiral_made_round():
    """Independent of the simulator: a robot that goes straight and drifts by 1 rad/m reports a unit circle."""
    turn = np.linspace(0.0, 3.0, 3001)
    circle = np.column_stack((np.sin(turn), 1.0 - np.cos(turn), turn))
    straight = OdometryError(1.0, float(np.rad2deg(1.0))).corrected(circle)
    np.testing.assert_allclose(straight, np.column_stack((turn, 0.0 * turn, 0.0 * turn)), atol=1e-6)


def test_pose_by_pose_is_the_same():
    error = OdometryError(1.03, -1.5)
    correction = OdometryCorrection(error)
    one_by_one = [correction(Pose(*row)) for row in path().tolist()]
    np.testing.assert_allclose([(pose.x, pose.y, pose.yaw) for pose in one_by_one], error.corrected(path()), atol=1e-9)


def test_the_mapper_takes_poses_freed_of_it_and_goes_on_from_its_state():
    scene = random_scene(2, 5)
    parameters = Parameters().replaced({'odometry.scale': 1.02, 'odometry.yaw_drift_deg_m': 2.0})
    wrong = reported(scene.poses, Drift(scale=1.02, heading_deg_m=2.0), np.random.default_rng(1))
    mapper = PolygonMapper(parameters)
    for count, (ping, pose) in enumerate(zip(pings(scene), wrong.tolist(), strict=True)):
        if count == 30:
            mapper = PolygonMapper.from_state(parameters, mapper.state())
        mapper.add_pose(ping.emission_ns, Pose(*pose))
        mapper.add_ping(ping)
    places = [(sounding.x, sounding.y) for sounding in mapper.soundings]
    start = Pose(*scene.poses[0].tolist()).inverse()
    np.testing.assert_allclose(places, start.apply(scene.poses[:, :2]), atol=1e-9)


def test_a_damaged_state_is_refused():
    for memory in (np.zeros(4), np.full(5, np.nan)):
        with pytest.raises(StateError):
            OdometryCorrection(OdometryError()).restore({'memory': memory})
