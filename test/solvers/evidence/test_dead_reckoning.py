"""A wall that was heard from a pose which the odometry alone tells: against drives of the simulator's wheels."""

import numpy as np

from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.odometer import odometer_sums
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.simulation.odometry import Drift, reported
from polymap_ros.solvers.estimate import Edge
from polymap_ros.solvers.evidence.dead_reckoning import as_dead_reckoned
from polymap_ros.solvers.evidence.odometry import OdometryNoise
from polymap_ros.solvers.evidence.tracking import Chain

NOISE = OdometryNoise(0.015, np.deg2rad(1.5), 0.05)
NO_ECHO = np.zeros(0)


def driven():
    turns = np.repeat((0.0, 0.8, -0.5), 20)
    steps = 0.05 * np.column_stack((np.cos(turns), np.sin(turns)))
    return np.column_stack((np.vstack((np.zeros(2), np.cumsum(steps, axis=0))), np.append(0.0, turns)))


def test_its_deviations_are_those_of_the_place_from_which_it_was_first_heard():
    true = driven()
    normal, theta = np.array([np.cos(0.4), np.sin(0.4)]), 0.4
    r = 3.0
    ranges = np.where(np.arange(61) >= 40, r - true[:, :2] @ normal, 0.3)  # something else is nearer before
    heard = [Sounding(k, x, y, NO_ECHO, NO_ECHO, rho, yaw=yaw)
             for k, ((x, y, yaw), rho) in enumerate(zip(true.tolist(), ranges.tolist(), strict=True))]
    chain = Chain(true, true, odometer_sums(true), NOISE, tuple(range(61)))
    found = as_dead_reckoned(Edge(r, theta, 1.0, 1e-4, 1e-4), heard, chain, 0.03)
    generator, walls = np.random.default_rng(3), []
    for _ in range(3000):
        told = Pose(*reported(true, Drift(0.015, 1.5, 0.05), generator)[40])
        seen = Edge(r, theta, 1.0).moved(Pose(*true[40]).inverse())
        walls.append((seen.moved(told).r, seen.moved(told).theta))
    spread = np.std(walls, axis=0)
    np.testing.assert_allclose((found.r_std, found.theta_std), spread, rtol=0.15)
