"""How much odometry errs, told from positions: against the simulator's errors, and an integral over all headings."""

import numpy as np
import pytest

from polymap_ros.hearing.odometer import odometer_sums
from polymap_ros.simulation.odometry import LEVELS, Drift, reported
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.odometry import Increments, OdometryNoise
from polymap_ros.solvers.evidence.odometry_found import evidence_of, odometry_found

ASSUMED = OdometryNoise(0.015, np.deg2rad(1.5), 0.05)


def told(true, drift, place_m, seed):
    """What is found where the positions are known and the headings are not."""
    generator = np.random.default_rng(seed)
    poses = reported(true, drift, generator)
    poses[:, :2] += place_m * generator.normal(size=(len(poses), 2))
    known = np.column_stack((true[:, :2], poses[:, 2]))
    return odometry_found(poses, odometer_sums(poses), ASSUMED, known)


@pytest.fixture(scope='module')
def true():
    return random_scene(2, 5).poses


@pytest.mark.parametrize('level', ['mild', 'typical', 'wheels'])
def test_errors_as_assumed_or_smaller_are_left_as_assumed(true, level):
    assert [told(true, LEVELS[level], 0.0, seed) for seed in range(10)] == 10 * [ASSUMED]


def test_wheels_that_err_more_are_told(true):
    found = [told(true, LEVELS['bad'], 0.0, seed) for seed in range(10)]
    assert np.median([each.heading for each in found]) == pytest.approx(2.0 * ASSUMED.heading, rel=0.3)
    assert np.median([each.place for each in found]) <= 1e-3


@pytest.mark.parametrize('drift', [Drift(), LEVELS['typical']], ids=['exact wheels', 'typical wheels'])
def test_places_that_are_off_each_by_itself_are_told(true, drift):
    found = [told(true, drift, 0.005, seed) for seed in range(10)]
    assert np.median([each.place for each in found]) == pytest.approx(0.005, rel=0.3)
    assert np.median([each.heading for each in found]) == ASSUMED.heading


def test_few_poses_tell_nothing(true):
    assert told(true[:6], Drift(), 0.05, 1) == ASSUMED


@pytest.mark.parametrize('other', [ASSUMED.times(2.0), OdometryNoise(0.015, np.deg2rad(1.5), 0.05, 0.004)])
def test_the_evidence_is_an_integral_over_all_headings(true, other):
    """Of an increment, by a grid over both headings; what constant is left out is the same for all sizes."""
    poses = true[:2]
    there = poses + ((0.0, 0.0, 0.0), (0.002, -0.003, 0.0))
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 121), np.linspace(-0.6, 0.6, 121))

    def integral(noise):
        odometry = Increments.of(poses, odometer_sums(poses), noise)
        density = [np.exp(odometry.log_prior(there + ((0.0, 0.0, a), (0.0, 0.0, b)))) for a, b in zip(
            x.ravel(), y.ravel(), strict=True)]
        return np.log(np.sum(density)) - 0.5 * np.linalg.slogdet(odometry.covariance[0])[1]

    found = [evidence_of(Increments.of(poses, odometer_sums(poses), noise), there) for noise in (ASSUMED, other)]
    assert found[1] - found[0] == pytest.approx(integral(other) - integral(ASSUMED), abs=0.1)
