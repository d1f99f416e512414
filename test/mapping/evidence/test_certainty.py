"""What is sure of the walls: the place that all pings share, an edge that is not there."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from shapely import affinity

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.mapping.evidence.certainty import _shared_by_all, certainty_of
from polymap_ros.mapping.evidence.paths import corners_of
from polymap_ros.mapping.evidence.power_search import PRICE
from polymap_ros.mapping.evidence.proposals import corner_cuts
from polymap_ros.mapping.evidence.search import Found, Search, least_gain, without_wall
from polymap_ros.mapping.evidence.solver import search_of
from polymap_ros.mapping.lines import polygon_lines
from polymap_ros.mapping.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene


def test_where_positions_are_off_all_walls_share_their_shift_and_turn():
    """Against rooms that shapely moves by the mean and the turn of so many errors of 5 mm."""
    scene, generator, off_m = random_scene(2, 5), np.random.default_rng(1), 5e-3
    positions = scene.positions + (0.7, -0.4)
    room = affinity.translate(shapely.Polygon(scene.vertices), 0.7, -0.4)
    away = positions - positions.mean(axis=0)
    lines, moved = polygon_lines(np.array(room.exterior.coords)[:-1]), []
    for _ in range(4000):
        errors = generator.normal(0.0, off_m, positions.shape)
        turn = np.sum(away[:, 0] * errors[:, 1] - away[:, 1] * errors[:, 0]) / np.sum(away**2)
        turned = affinity.rotate(room, turn, tuple(positions.mean(axis=0)), use_radians=True)
        corners = np.array(affinity.translate(turned, *errors.mean(axis=0)).exterior.coords)[:-1]
        change = polygon_lines(corners) - lines
        moved.append(np.column_stack((change[:, 0], np.angle(np.exp(1j * change[:, 1])))).ravel())
    covariance = _shared_by_all(SimpleNamespace(lines=lines, misplaced_m=off_m), positions)
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(np.cov(np.array(moved).T) / np.outer(scale, scale),
                               covariance / np.outer(scale, scale), atol=0.1)


@pytest.mark.parametrize('coherent', [True, False])
def test_an_edge_across_a_corner_that_is_there_is_none_and_costs_the_others_nothing(coherent, finished):
    scene = random_scene(0, 4)
    mapper = filled_mapper(scene, Parameters())
    search = search_of(mapper.evidence, mapper.parameters)
    search.coherent = coherent
    truth = polygon_lines(Pose(*scene.poses[0]).inverse().apply(scene.vertices))
    truth = truth[np.argsort(truth[:, 1])]
    for cut in corner_cuts(truth[:, 1], corners_of(truth)[1], [0.02])[:4]:
        lines = np.vstack((truth, cut))
        order = np.argsort(lines[:, 1])
        found = search.judge(search.power.initial(1.0).with_lines(lines[order]))
        likelihood = finished(certainty_of(search, found)).likelihood
        np.testing.assert_array_equal(likelihood > 0.9, order < 4)
        assert likelihood.min() < 0.01


def test_a_wall_in_two_halves_that_turn_a_little_could_go_without_either(in_pentagon, finished):
    """As they stand, each is worth more than an edge has to be; the other, refitted, is the whole wall."""
    search = Search(in_pentagon.data, 10, np.random.default_rng(1))
    right = search.judge(search.power.initial(1.0).with_lines(in_pentagon.lines))
    wall, corners = right.lines[2], corners_of(right.lines)[1]
    on_wall = np.abs(corners @ (np.cos(wall[1]), np.sin(wall[1])) - wall[0]) < 1e-9
    x, y = corners[on_wall].mean(axis=0)
    angles = wall[1] + np.array([-2.5e-3, 2.5e-3])
    pair = np.column_stack((np.cos(angles) * x + np.sin(angles) * y, angles))
    lines = np.vstack((right.lines[:2], pair, right.lines[3:]))
    halves = search.wave.evaluate(lines, np.insert(right.reflection, 2, right.reflection[2]), right.wave.phase, 5)
    lost = [halves.value - without_wall(search.wave, halves, half).value for half in (2, 3)]
    assert min(lost) > least_gain(halves.value)
    found = Found(right.model.with_lines(lines), halves, right.explained, halves.value - 6.0 * PRICE)
    likelihood = finished(certainty_of(search, found)).likelihood
    halved = np.isin(np.arange(6), (2, 3))
    assert likelihood[halved].max() < 0.01
    assert likelihood[~halved].min() > 0.9


def test_what_is_left_unexplained_is_doubt_as_far_as_it_is_no_noise(in_pentagon, finished):
    """From 0.85 of what can be measured to three standard deviations."""
    search = Search(in_pentagon.data, 10, np.random.default_rng(1))
    right = search.judge(search.power.initial(1.0).with_lines(in_pentagon.lines))
    assert 0.001 < search.uncertainty < 0.1
    for explained in (0.85, 0.85 - search.uncertainty, 0.5):
        likelihood = finished(certainty_of(search, right._replace(explained=explained))).likelihood
        np.testing.assert_allclose(likelihood, min((explained + search.uncertainty) / 0.85, 1.0), rtol=1e-6)


def test_deviations_grow_with_what_the_pings_disagree_about(in_pentagon, finished):
    """By the sandwich of the scores, each wall by itself; the same scores three times over are three times as much."""
    search = Search(in_pentagon.data, 10, np.random.default_rng(1))
    right = search.judge(search.power.initial(1.0).with_lines(in_pentagon.lines))
    wave, pings = right.wave, len(in_pentagon.data.positions)
    inverse = np.linalg.inv(wave.information)
    cycle = np.pi / search.data.pulse.carrier
    for times in (1.0, 3.0, 10.0):
        scores = times * wave.scores
        spread = inverse @ (pings * np.cov(scores.T, bias=True)) @ inverse * pings / (pings - 3)
        walls = np.arange(15).reshape(5, 3)[:, :2]
        growth = np.mean(np.diag(spread)[walls] / np.diag(inverse)[walls], axis=1)
        expected = np.diag(inverse)[walls] * np.maximum(growth, 1.0)[:, None]
        expected[:, 0] += (7e-4 * cycle) ** 2
        found = certainty_of(search, right._replace(wave=dataclasses.replace(wave, scores=scores)))
        np.testing.assert_allclose(np.diag(finished(found).covariance).reshape(5, 2), expected, rtol=1e-5)
