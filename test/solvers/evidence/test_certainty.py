"""What is sure of the walls: the place that all pings share, an edge that is not there."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.outline import corners_of
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.certainty import certainty_of
from polymap_ros.solvers.evidence.likelihood import information_of
from polymap_ros.solvers.evidence.proposals import corner_cuts
from polymap_ros.solvers.evidence.search import Found, Search, search_of
from polymap_ros.solvers.evidence.tuning import PRICE
from polymap_ros.solvers.evidence.walls import Walls


@pytest.mark.parametrize('coherent', [True, False])
def test_an_edge_across_a_corner_that_is_there_is_none_and_costs_the_others_nothing(coherent):
    scene = random_scene(0, 4)
    mapper = filled_mapper(scene, Parameters())
    search = search_of(mapper.evidence, mapper.parameters)
    search.coherent = coherent
    truth = polygon_lines(Pose(*scene.poses[0]).inverse().apply(scene.vertices))
    truth = truth[np.argsort(truth[:, 1])]
    for cut in corner_cuts(truth[:, 1], corners_of(truth)[1], [0.02])[:4]:
        lines = np.vstack((truth, cut))
        order = np.argsort(lines[:, 1])
        found = search.judge(search.power.initial(1.0).with_walls(Walls.convex(lines)))
        likelihood = certainty_of(search, found).likelihood
        np.testing.assert_array_equal(likelihood > 0.9, order < 4)
        assert likelihood.min() < 0.01


def test_a_wall_in_two_halves_that_turn_a_little_could_go_without_either(in_pentagon):
    """As they stand, each is worth more than an edge has to be; the other, refitted, is the whole wall."""
    search = Search(in_pentagon.data, 10, np.random.default_rng(1))
    right = search.judge(search.power.initial(1.0).with_walls(Walls.convex(in_pentagon.lines)))
    wall, corners = right.lines[2], corners_of(right.lines)[1]
    on_wall = np.abs(corners @ (np.cos(wall[1]), np.sin(wall[1])) - wall[0]) < 1e-9
    x, y = corners[on_wall].mean(axis=0)
    angles = wall[1] + np.array([-2.5e-3, 2.5e-3])
    pair = np.column_stack((np.cos(angles) * x + np.sin(angles) * y, angles))
    lines = np.vstack((right.lines[:2], pair, right.lines[3:]))
    walls = Walls.convex(lines, np.insert(right.walls.reflection, 2, right.walls.reflection[2]))
    halves = search.wave.evaluate(walls, right.wave, 5, derive=True)
    lost = [halves.value - search.wave.evaluate(walls.without(half), halves, 5).value for half in (2, 3)]
    assert min(lost) > search.least_gain(halves.value)
    found = Found(right.power.with_walls(walls), halves, right.explained, halves.value - 6.0 * PRICE)
    likelihood = certainty_of(search, found).likelihood
    halved = np.isin(np.arange(6), (2, 3))
    assert likelihood[halved].max() < 0.01
    assert likelihood[~halved].min() > 0.9


def test_what_is_left_unexplained_is_doubt_as_far_as_it_is_no_noise(in_pentagon):
    """From 0.85 of what can be measured to three standard deviations."""
    search = Search(in_pentagon.data, 10, np.random.default_rng(1))
    right = search.judge(search.power.initial(1.0).with_walls(Walls.convex(in_pentagon.lines)))
    assert 0.001 < search.uncertainty < 0.1
    for explained in (0.85, 0.85 - search.uncertainty, 0.5):
        likelihood = certainty_of(search, right._replace(explained=explained)).likelihood
        np.testing.assert_allclose(likelihood, min((explained + search.uncertainty) / 0.85, 1.0), rtol=1e-6)


def test_deviations_grow_with_what_the_pings_disagree_about(in_pentagon):
    """By the sandwich of the scores, each wall by itself; the same scores three times over are three times as much."""
    search = Search(in_pentagon.data, 10, np.random.default_rng(1))
    right = search.judge(search.power.initial(1.0).with_walls(Walls.convex(in_pentagon.lines)))
    wave, pings = right.wave, len(in_pentagon.data.positions)
    inverse = np.linalg.inv(information_of(wave))
    cycle = np.pi / search.data.pulse.carrier
    for times in (1.0, 3.0, 10.0):
        scores = times * wave.slopes.scores
        spread = inverse @ (pings * np.cov(scores.T, bias=True)) @ inverse * pings / (pings - 3)
        walls = np.arange(15).reshape(3, 5)[:2].T
        growth = np.mean(np.diag(spread)[walls] / np.diag(inverse)[walls], axis=1)
        expected = np.diag(inverse)[walls] * np.maximum(growth, 1.0)[:, None]
        expected[:, 0] += (7e-4 * cycle) ** 2
        found = certainty_of(search, right._replace(
            wave=wave.with_slopes(dataclasses.replace(wave.slopes, scores=scores))))
        np.testing.assert_allclose(np.diag(found.covariance).reshape(5, 2), expected, rtol=1e-5)
