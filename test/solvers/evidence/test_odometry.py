"""What odometry says of neighbouring poses: against the simulator's wheels, sums of poses, and numeric derivatives."""

import numpy as np
import pytest

from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.poses import between, onward
from polymap_ros.hearing.odometer import odometer_sums
from polymap_ros.simulation.odometry import Drift, reported
from polymap_ros.solvers.estimate import Trajectory
from polymap_ros.solvers.evidence.odometry import FLOOR_M, FLOOR_RAD, SLIP, Increments, OdometryNoise
from polymap_ros.solvers.evidence.path import path_cautions
from polymap_ros.solvers.evidence.tracking import Chain

NOISE = OdometryNoise(0.015, np.deg2rad(1.5), 0.05)


def drawn(count=6, seed=1):
    generator = np.random.default_rng(seed)
    places = np.cumsum(generator.normal(0.0, 0.2, (count, 2)), axis=0)
    return np.column_stack((places, generator.uniform(-3.0, 3.0, count)))


def chain(poses, noise=NOISE):
    return Increments.of(poses, odometer_sums(poses), noise)


def test_a_pose_seen_from_another_is_that_of_composed_poses():
    poses = drawn()
    seen = between(poses[:-1], poses[1:])
    for one, other, found in zip(poses[:-1], poses[1:], seen, strict=True):
        expected = Pose(*one).inverse().compose(Pose(*other))
        np.testing.assert_allclose(found, (expected.x, expected.y, expected.yaw), atol=1e-12)
    np.testing.assert_allclose(onward(poses[:-1], seen), poses[1:], atol=1e-12)


@pytest.mark.parametrize(('turn_deg', 'way_m'), [(0.0, 0.14), (60.0, 0.14), (-120.0, 0.5)])
def test_the_covariance_is_that_of_the_simulators_wheels(turn_deg, way_m):
    """4,000 drives in 40 steps each, of which the first turns: a walk of the heading bends the way all along."""
    turn = np.deg2rad(turn_deg)
    steps = np.linspace(0.0, way_m, 41)
    true = np.column_stack((steps * np.cos(turn), steps * np.sin(turn), np.append(0.0, np.full(40, turn))))
    generator, drift = np.random.default_rng(2), Drift(0.015, 1.5, 0.05)
    drives = np.array([reported(true, drift, generator)[[0, -1]] for _ in range(4_000)])
    true = true[[0, -1]]
    errors = between(drives[:, 0], drives[:, 1]) - between(true[:1], true[1:])
    sample = np.cov(errors.T)
    odometry = chain(true)
    floor = np.diag((FLOOR_M**2, FLOOR_M**2, FLOOR_RAD**2))
    scale = np.sqrt(np.diag(odometry.covariance[0]))
    expected = (odometry.covariance[0] - floor) / np.outer(scale, scale)
    np.testing.assert_allclose(sample / np.outer(scale, scale), expected, atol=0.06)


@pytest.mark.parametrize('trusted', [True, False])
def test_the_gradient_is_that_of_the_log_density(trusted):
    poses = drawn()
    odometry = chain(poses)
    odometry = odometry.trusted() if trusted else odometry
    there = poses + 0.02 * np.random.default_rng(3).normal(size=poses.shape)
    gradient, information = odometry.derivatives(there)
    step = 1e-6 * np.eye(there.size).reshape(-1, *there.shape)
    slopes = [(odometry.log_prior(there + each) - odometry.log_prior(there - each)) / 2e-6 for each in step]
    np.testing.assert_allclose(gradient, slopes, rtol=1e-4, atol=1e-4 * np.abs(slopes).max())
    np.testing.assert_allclose(information, information.T)


def test_without_errors_the_information_is_the_curvature():
    poses = drawn()
    odometry = chain(poses).trusted()
    _, information = odometry.derivatives(poses)
    step = 1e-5 * np.eye(poses.size).reshape(-1, *poses.shape)
    curvature = [(odometry.derivatives(poses - each)[0] - odometry.derivatives(poses + each)[0]) / 2e-5
                 for each in step]
    np.testing.assert_allclose(information, curvature, rtol=1e-4, atol=1e-6 * information.max())


def test_a_frame_of_its_own_changes_nothing():
    poses = drawn()
    c, s = np.cos(0.7), np.sin(0.7)
    moved = np.column_stack((poses[:, :2] @ [[c, s], [-s, c]] + (3.0, -1.0), poses[:, 2] + 0.7 + 2.0 * np.pi))
    np.testing.assert_allclose(chain(poses).squares(moved), 0.0, atol=1e-18)


def test_a_slip_costs_tens_of_nats_and_not_thousands():
    poses = drawn()
    slipped = poses.copy()
    slipped[3:, 0] += 0.3
    odometry = chain(poses)
    assert odometry.squares(slipped).max() > SLIP
    assert -60.0 < odometry.log_prior(slipped) < -10.0
    assert odometry.trusted().log_prior(slipped) < 5.0 * odometry.log_prior(slipped)


def test_the_way_between_pings_that_are_not_kept_counts():
    """Over eight steps with turns, of which only the ends are kept, as 20,000 of the simulator's drives."""
    generator = np.random.default_rng(4)
    heading = np.cumsum(generator.uniform(-1.2, 1.2, 9))
    steps = 0.14 * np.column_stack((np.cos(heading), np.sin(heading)))[1:]
    true = np.column_stack((np.vstack((np.zeros(2), np.cumsum(steps, axis=0))) + (30.0, -20.0), heading))
    drives = np.array([reported(true, Drift(0.015, 1.5, 0.05), generator)[[0, -1]] for _ in range(20_000)])
    sample = np.cov((between(drives[:, 0], drives[:, 1]) - between(true[:1], true[-1:])).T)
    kept = Increments.of(true[[0, -1]], odometer_sums(true)[[0, -1]], NOISE)
    scale = np.sqrt(np.diag(sample))
    np.testing.assert_allclose(kept.covariance[0] / np.outer(scale, scale), sample / np.outer(scale, scale), atol=0.04)


def test_straight_on_the_errors_are_those_of_a_metre_of_wheels():
    along, across, heading = np.sqrt(np.diag(NOISE.straight_on(1.0)))
    assert along == pytest.approx(np.hypot(0.015, FLOOR_M))
    assert across == pytest.approx(np.hypot(np.deg2rad(1.5) / np.sqrt(3.0), FLOOR_M))
    assert heading == pytest.approx(np.hypot(np.deg2rad(1.5), FLOOR_RAD))


def test_far_from_the_start_a_covariance_stays_one():
    """At a million metres rounding alone is more than a step is known to."""
    poses = drawn() + (1e6, -1e6, 0.0)
    assert np.all(np.linalg.eigvalsh(chain(poses).covariance) > 0.0)


def winding():
    """Poses of 60 pings over 8 m with turns."""
    headings = np.cumsum(np.deg2rad(20.0 * np.sin(np.arange(60))))
    steps = 0.14 * np.column_stack((np.cos(headings), np.sin(headings)))
    return np.column_stack((np.cumsum(steps, axis=0), headings))


@pytest.mark.parametrize(('scale', 'told'), [(1.0, None), (1.03, 'too small'), (0.97, 'too large')])
def test_ways_that_are_longer_or_shorter_by_the_odometry_are_told(scale, told):
    """Half of the pings are lost, and where the odometry says: they tell nothing of it."""
    true = winding()
    said = reported(true, Drift(0.005, 0.5, 0.02), np.random.default_rng(3))
    said[:, :2] = true[0, :2] + scale * (said[:, :2] - said[0, :2])
    lost = np.arange(60) >= 30
    found = np.where(lost[:, None], onward(true[29:30], between(said[29:30], said)), true)
    odometry = Chain(said, said, odometer_sums(said), NOISE, tuple(range(60)))
    path = Trajectory(odometry.stamps_ns, found, said, np.zeros((60, 3, 3)), np.where(lost, 0.0, 1.0))
    codes = {each.code: each.finding for each in path_cautions(path, odometry)}
    assert ('odometry_scale' in codes) == (told is not None)
    assert told is None or told in codes['odometry_scale']


@pytest.mark.parametrize('scale', [1.0, 1.027])
def test_the_scale_is_told_with_its_deviation(scale):
    """Of 200 drives of the simulator's wheels over 8 m, with steps that are longer than they are."""
    generator, drift, true = np.random.default_rng(5), Drift(0.015, 1.5, 0.05), winding()
    found = []
    for _ in range(200):
        told = reported(true, drift, generator)
        told[:, :2] = told[0, :2] + scale * (told[:, :2] - told[0, :2])
        found.append(chain(told).scale(true))
    measured, deviations = np.array(found).T
    scores = (measured - scale) / deviations
    assert abs(np.mean(measured) - scale) < 0.001
    assert 0.7 < np.std(scores) < 1.2
    assert np.max(deviations) < 0.007


def test_a_robot_that_stands_tells_no_scale():
    assert chain(np.tile(drawn(1), (4, 1))).scale(np.tile(drawn(1), (4, 1))) == (1.0, np.inf)
