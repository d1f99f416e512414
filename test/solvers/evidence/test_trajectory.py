"""Walls and poses as one vector: against numeric derivatives, and rigid motions of ping and walls."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.odometer import odometer_sums
from polymap_ros.parameters import Parameters, SensorParameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.climb import climb
from polymap_ros.solvers.evidence.likelihood import gradient_of, information_of
from polymap_ros.solvers.evidence.odometry import Increments, OdometryNoise
from polymap_ros.solvers.evidence.path import known
from polymap_ros.solvers.evidence.power import PowerLikelihood
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.tracking import Chain, judged_track
from polymap_ros.solvers.evidence.trajectory import Joint, JointLikelihood, World
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import WaveformLikelihood

NOISE = OdometryNoise(0.015, np.deg2rad(1.5), 0.05)
SENSORS = {'on the axis': SensorParameters(), 'off the axis': SensorParameters(x_m=0.03, y_m=0.04),
           'apart': SensorParameters(x_m=0.02, baseline_x_m=0.05)}


def heard(sensor, edges=4, seed=2, pings=10):
    """Search over the first pings of a plate, and the walls as they are in the start frame."""
    scene = dataclasses.replace(random_scene(seed, edges), sensor=sensor)
    scene = dataclasses.replace(scene, poses=scene.poses[:pings])
    mapper = filled_mapper(scene, Parameters())
    search = search_of(mapper.evidence, mapper.parameters)
    lines = polygon_lines(mapper.start_pose.inverse().apply(scene.vertices))
    return search, Walls.convex(lines)


def world_of(search, walls):
    poses = search.data.poses
    return World(walls, poses, Increments.of(poses, odometer_sums(poses), NOISE))


@pytest.mark.parametrize('sensor', SENSORS.values(), ids=SENSORS)
def test_a_ping_that_moves_hears_what_it_would_if_the_walls_moved_against_it(sensor):
    search, walls = heard(sensor)
    motion = Pose(0.02, -0.01, 0.3)
    base = Pose(*search.data.poses[4])
    one = search.data.chosen(np.array([4]))
    there = base.compose(motion)
    away = base.compose(motion.inverse().compose(base.inverse()))  # moves the walls so that base sees what `there` saw
    theta = walls.lines[:, 1] + away.yaw
    r = walls.lines[:, 0] + away.x * np.cos(theta) + away.y * np.sin(theta)
    moved = Walls(np.column_stack((r, theta)), walls.reflection)
    wave = search.aligned(search.power.initial(1.0).with_walls(walls))
    ping = WaveformLikelihood(one.at(np.array([(there.x, there.y, there.yaw)])))
    expected = WaveformLikelihood(one).shares(wave.with_walls(moved), 5)
    np.testing.assert_allclose(ping.shares(wave.with_walls(walls), 5), expected, rtol=1e-6)


@pytest.mark.parametrize('sensor', SENSORS.values(), ids=SENSORS)
def test_the_gradient_by_poses_is_numeric(sensor):
    """By two orders, of which here no path fades at a wall's soft end, which derivatives leave out."""
    search, walls = heard(sensor)
    wave = search.aligned(search.power.initial(1.0).with_walls(walls))
    world, likelihood = world_of(search, wave.walls), JointLikelihood(WaveformLikelihood, search.data)
    off = world.moved(np.concatenate((np.zeros(3 * len(walls)), 1e-3 * np.random.default_rng(1).normal(
        size=world.poses.size))))
    here = likelihood.evaluate(off, Joint(off, wave, 0.0), 2, derive=True)
    gradient = gradient_of(here)
    scale = np.sqrt(np.diag(information_of(here)))
    numbers = np.arange(3 * len(walls), len(gradient), 2)
    slopes = np.empty(len(numbers))
    for row, number in enumerate(numbers):
        step = np.zeros(len(gradient))
        step[number] = 1e-3 / scale[number]
        up, down = (likelihood.evaluate(off.moved(sign * step), here, 2).value for sign in (1.0, -1.0))
        slopes[row] = (up - down) / (2.0 * step[number])
    errors = (slopes - gradient[numbers]) / scale[numbers]
    assert np.abs(slopes / scale[numbers]).max() > 10.0
    assert np.abs(errors).max() < 0.5


def test_the_first_pose_is_the_frame_and_stays():
    search, walls = heard(SensorParameters())
    world = world_of(search, walls)
    held = world.held(np.zeros(3 * len(walls) + world.poses.size))
    np.testing.assert_array_equal(np.flatnonzero(held), 3 * len(walls) + np.arange(3))


@pytest.mark.parametrize('of', [PowerLikelihood, WaveformLikelihood])
def test_walls_and_poses_that_are_off_come_back_together(of):
    """Half a millimetre in phase and 4 mm by power; a maximum as high as from the truth."""
    search, walls = heard(SensorParameters(), edges=5, pings=14)
    power = search.power.fitted(walls, search.power.initial(1.0), 3)
    start = power if of is PowerLikelihood else search.aligned(power)
    world, likelihood = world_of(search, start.walls), JointLikelihood(of, search.data)
    top = climb(likelihood, Joint(world, start, -np.inf), 3, 30)
    off_m = 4e-3 if of is PowerLikelihood else 5e-4
    draws = np.random.default_rng(4).normal(0.0, off_m, (len(world.poses), 3)) * (1.0, 1.0, 2.0)
    draws[0] = 0.0
    moved = World(start.walls.moved(np.concatenate((np.full(5, 0.5 * off_m), np.zeros(10)))), world.poses + draws,
                  world.odometry)
    again = climb(likelihood, Joint(moved, start, -np.inf), 3, 30)
    assert again.value > top.value - 20.0
    limit_m = 3e-3 if of is PowerLikelihood else 2e-5  # of power, a deviation
    assert np.abs(again.unknowns.poses - top.unknowns.poses)[:, :2].max() < limit_m
    assert np.abs(again.unknowns.walls.lines - top.unknowns.walls.lines)[:, 0].max() < limit_m


@pytest.mark.parametrize('place', [0.0, 0.004])
def test_all_is_known_to_turn_about_the_first_pose_as_well_as_odometry_alone_tells(place):
    """Echoes hold walls and places together, and tell nothing of how they lie about the first pose, or where it is."""
    search, walls = heard(SensorParameters(), edges=5, pings=20)
    poses = search.data.poses
    found = search.judge(search.power.fitted(walls, search.power.initial(1.0), 3))
    track = judged_track(search, found, np.arange(len(poses)), poses)
    chain = Chain(poses, poses, odometer_sums(poses), dataclasses.replace(NOISE, place=place), tuple(range(len(poses))))
    told = known(track, chain)
    _, information = chain.between(track.pings).expected().derivatives(poses)
    turn_and_headings = np.zeros((len(information), len(poses)))
    away = poses[:, :2] - poses[0, :2]
    turn_and_headings[0::3, 0], turn_and_headings[1::3, 0] = -away[:, 1], away[:, 0]
    turn_and_headings[2::3, 1:] = np.eye(len(poses))[:, 1:]
    variance = np.linalg.inv(turn_and_headings.T @ information @ turn_and_headings)[0, 0]
    assert np.sqrt(np.diag(told.walls)[1::2]) == pytest.approx(5 * [np.sqrt(variance)], rel=0.02)
    theta = found.lines[:, 1]
    lever = poses[0, 1] * np.cos(theta) - poses[0, 0] * np.sin(theta)
    expected = np.hypot(place, lever * np.sqrt(variance))
    assert np.sqrt(np.diag(told.walls)[::2]) == pytest.approx(expected, abs=2e-4)
