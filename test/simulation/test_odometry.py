"""Erring odometry against what it is said to be: the size of its walks, and paths put together step by step."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.odometry import LEVELS, Drift, Wheels, reported, with_slips
from polymap_ros.simulation.random_scenes import random_scene

LEGS = np.column_stack((np.arange(41) * 0.25, np.zeros(41), np.zeros(41)))
"""A straight way of 10 m in steps of 0.25 m."""


def drawn(poses, drift, count=400):
    return np.array([reported(poses, drift, np.random.default_rng(seed)) for seed in range(count)])


def test_without_errors_the_path_is_the_true_one():
    poses = random_scene(3, 5).poses
    np.testing.assert_allclose(reported(poses, Drift(), np.random.default_rng(1)), poses, atol=1e-12)


def test_distance_and_heading_walk_with_the_root_of_the_way():
    """After 1 and 4 and 10 m, whatever the steps."""
    paths = drawn(LEGS, Drift(distance_noise=0.01))
    for step in (4, 16, 40):
        assert np.std(paths[:, step, 0]) == pytest.approx(0.01 * np.sqrt(0.25 * step), rel=0.15)
    assert np.all(paths[:, :, 1:] == 0.0)
    headings = np.rad2deg(drawn(LEGS, Drift(heading_noise_deg=0.5))[:, :, 2])
    for step in (4, 16, 40):
        assert np.std(headings[:, step]) == pytest.approx(0.5 * np.sqrt(0.25 * step), rel=0.15)


def test_what_the_heading_errs_by_along_a_step_the_way_follows_half():
    """The place across, s_w^2 d^2 / 4 after one step, and s_w^2 between heading and it by half the distance."""
    one = drawn(LEGS[:2], Drift(heading_noise_deg=1.0), 4000)
    np.testing.assert_allclose(one[:, 1, 1], 0.25 * np.sin(0.5 * one[:, 1, 2]), atol=1e-12)


def test_every_turn_is_misjudged_by_a_share_of_it_before_the_way_is_driven():
    turned = np.array([(0.0, 0.0, 0.0), (0.0, 1.0, np.pi / 2.0), (0.0, 2.0, np.pi / 2.0)])
    paths = drawn(turned, Drift(turn_noise=0.03), 2000)
    assert np.std(paths[:, 1, 2]) == pytest.approx(0.03 * np.pi / 2.0, rel=0.1)
    way = np.arctan2(paths[:, 1, 1], paths[:, 1, 0])
    np.testing.assert_allclose(way, paths[:, 1, 2], atol=1e-12)
    np.testing.assert_allclose(paths[:, 2, 2], paths[:, 1, 2])  # no turn, no error


def test_two_wheels_are_put_together_as_those_of_a_robot_that_rolls_bit_by_bit():
    """Without noise: a turn on the spot, then a thousand short arcs a step."""
    wheels = Wheels(0.0, 1.002, 0.999, 0.3, 1.02)
    poses = random_scene(3, 5).poses
    x, y, heading = poses[0]
    places = [(x, y)]
    for step, turn in zip(np.diff(poses[:, :2], axis=0), np.diff(poses[:, 2]), strict=True):
        relative = np.arctan2(step[1], step[0]) - poses[len(places), 2]  # of the way, to the heading on it
        heading += 0.15 * turn * (0.999 + 1.002) / (0.3 * 1.02)
        left, right = np.hypot(*step) * np.array((1.002, 0.999)) / 1000
        for _ in range(1000):
            heading += 0.5 * (right - left) / (0.3 * 1.02)
            x += 0.5 * (left + right) * np.cos(heading + relative)
            y += 0.5 * (left + right) * np.sin(heading + relative)
            heading += 0.5 * (right - left) / (0.3 * 1.02)
        places.append((x, y))
    found = reported(poses, wheels, np.random.default_rng(1))
    np.testing.assert_allclose(found[-1, 2], heading, atol=1e-9)
    np.testing.assert_allclose(found[:, :2], places, atol=1e-6)


def test_the_heading_of_two_wheels_errs_as_much_as_the_level_typical():
    headings = np.rad2deg(drawn(LEGS, LEVELS['wheels'])[:, :, 2])
    assert np.std(headings[:, 4]) == pytest.approx(LEVELS['typical'].heading_noise_deg, rel=0.15)
    assert np.mean(headings[:, 40]) / 10.0 == pytest.approx(LEVELS['typical'].heading_deg_m, rel=0.2)


def test_a_slip_moves_and_turns_all_that_comes_after_it_once():
    poses = random_scene(3, 5).poses
    jumped = with_slips(poses, 0.05, np.deg2rad(5.0), np.random.default_rng(2))
    same = np.all(jumped == poses, axis=1)
    first = int(np.argmin(same))
    assert 15 <= first <= 45
    assert not np.any(same[first:])
    assert np.linalg.norm(jumped[first, :2] - poses[first, :2]) == pytest.approx(0.05)
    np.testing.assert_allclose(jumped[first:, 2] - poses[first:, 2], np.deg2rad(5.0))
    for path in (poses, jumped):
        np.testing.assert_allclose(np.linalg.norm(np.diff(path[first:, :2], axis=0), axis=1),
                                   np.linalg.norm(np.diff(poses[first:, :2], axis=0), axis=1))


@pytest.mark.parametrize('level', LEVELS)
def test_a_scene_reports_its_first_pose_rightly_and_the_same_path_again(level):
    scene = dataclasses.replace(random_scene(5, 6), faults=Faults(drift=level, slip_m=0.05, slip_deg=5.0))
    path = scene.reported_poses()
    np.testing.assert_array_equal(path[0], scene.poses[0])
    np.testing.assert_array_equal(path, scene.reported_poses())
    other = dataclasses.replace(scene, seed=scene.seed + 1)
    assert not np.allclose(path, other.reported_poses())


def test_the_levels_are_as_far_off_as_wheels_are():
    """Position error after the best rigid motion, and the largest error of heading, over eight plates."""
    scenes, off = [random_scene(seed, 5) for seed in range(0, 16, 2)], {}
    for level in LEVELS:
        ates, headings = [], []
        for plate in scenes:
            scene = dataclasses.replace(plate, faults=Faults(drift=level))
            true, told = scene.poses, scene.reported_poses()
            z, w = ((path[:, :2] - path[:, :2].mean(axis=0)) @ (1.0, 1j) for path in (true, told))
            turn = np.exp(1j * np.angle(np.sum(z * np.conj(w))))
            ates.append(np.sqrt(np.mean(np.abs(z - turn * w) ** 2)))
            headings.append(np.abs(np.rad2deg(told[:, 2] - true[:, 2])).max())
        off[level] = np.median(ates), np.median(headings)
    assert 0.005 < off['mild'][0] < 0.05
    assert off['mild'][0] < off['typical'][0] < off['bad'][0]
    assert 2.0 < off['mild'][1] < off['typical'][1] < off['bad'][1] < 90.0
