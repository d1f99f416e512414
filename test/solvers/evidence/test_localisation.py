"""A ping placed between known walls: against the place where it was simulated."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.poses import between
from polymap_ros.hearing.odometer import odometer_sums
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.localisation import MISLED, Localiser, Prior
from polymap_ros.solvers.evidence.odometry import Increments, OdometryNoise
from polymap_ros.solvers.evidence.search import search_of


@pytest.fixture(scope='module')
def known():
    """Search, answer and level of a plate heard from exact poses."""
    mapper = filled_mapper(random_scene(4, 5), Parameters())
    search = search_of(mapper.evidence, mapper.parameters)
    found = next(each for each in search.polygons() if each is not None)
    power = search.power.fitted(found.walls, found.power, 5)
    level = float(np.median(search.wave.shares(found.wave, 5) / search.data.gain))
    return search, found._replace(power=power), level


@pytest.mark.parametrize('ping', range(3, 60, 9))
def test_a_ping_15_mm_off_is_placed_to_a_fraction_of_a_millimetre(known, ping):
    search, found, level = known
    true, angle = search.data.poses[ping], np.random.default_rng(ping).uniform(0.0, 2.0 * np.pi)
    prior = Prior(true + 0.015 * np.array([np.cos(angle), np.sin(angle), 0.0]), np.diag((0.008, 0.008, 0.05)) ** 2)
    placed = Localiser(search.data, found, level).place(ping, prior)
    assert np.hypot(*(placed.pose - true)[:2]) < 5e-4
    assert placed.wider_m == 0.0
    assert placed.worth > 0.9 * level
    away = placed.pose[:2] - true[:2]
    assert away @ np.linalg.solve(placed.covariance[:2, :2], away) < 25.0


@pytest.mark.parametrize(('by_m', 'wider_m'), [(0.05, 0.04), (0.2, 0.15)])
def test_a_ping_that_slipped_is_looked_for_wider(known, by_m, wider_m):
    search, found, level = known
    ping = 20
    inwards = search.data.positions.mean(axis=0) - search.data.positions[ping]
    off = np.append(by_m * inwards / np.linalg.norm(inwards), 0.1)
    prior = Prior(search.data.poses[ping] + off, np.diag((0.004, 0.004, 0.02)) ** 2)
    placed = Localiser(search.data, found, level).place(ping, prior)
    assert placed.wider_m == wider_m
    assert np.hypot(*(placed.pose - search.data.poses[ping])[:2]) < 5e-4


def test_a_ping_of_another_plate_is_not_found(known):
    search, found, level = known
    other = filled_mapper(random_scene(9, 4), Parameters())
    foreign = search_of(other.evidence, other.parameters).data.chosen(np.array([10]))
    data = dataclasses.replace(foreign, gain=np.ones(1))
    prior = Prior(search.data.poses[10], np.diag((0.02, 0.02, 0.05)) ** 2)
    assert Localiser(data, found, level).place(0, prior, 0.0).worth < MISLED * level


@pytest.mark.parametrize('backwards', [False, True])
def test_what_is_expected_of_a_neighbour_spreads_as_samples_do(backwards):
    """Samples of a pose and of an increment's error, carried through the motion itself."""
    poses = np.array([(0.0, 0.0, 0.3), (0.3, 0.2, 1.1)])
    noise = OdometryNoise(0.015, np.deg2rad(1.5), 0.05)
    step = Increments.of(poses, odometer_sums(poses), noise)
    mine, other = (1, 0) if backwards else (0, 1)
    covariance = np.diag((1e-3, 2e-3, 0.02)) ** 2
    prior = Prior(poses[mine], covariance).next(poses[other], step.covariance[0], backwards)
    generator = np.random.default_rng(1)
    ends = generator.multivariate_normal(poses[mine], covariance, 20_000)
    increments = step.increments[0] + generator.multivariate_normal(np.zeros(3), step.covariance[0], 20_000)
    if backwards:  # the pose from which this one is seen as the increment says
        yaw = ends[:, 2] - increments[:, 2]
        c, s = np.cos(yaw), np.sin(yaw)
        x, y, _ = increments.T
        drawn = np.column_stack((ends[:, 0] - c * x + s * y, ends[:, 1] - s * x - c * y, yaw))
        np.testing.assert_allclose(between(drawn, ends), increments, atol=1e-12)
    else:
        c, s = np.cos(ends[:, 2]), np.sin(ends[:, 2])
        x, y, turn = increments.T
        drawn = ends + np.column_stack((c * x - s * y, s * x + c * y, turn))
    scale = np.sqrt(np.diag(prior.covariance))
    np.testing.assert_allclose(np.cov(drawn.T) / np.outer(scale, scale), prior.covariance / np.outer(scale, scale),
                               atol=0.05)
