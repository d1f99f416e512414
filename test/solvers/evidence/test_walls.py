"""The block of the walls against its own meaning: what a step does, what is held, what is known before."""

from dataclasses import replace

import numpy as np
import pytest

from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.solvers.evidence.likelihood import Slopes
from polymap_ros.solvers.evidence.walls import LOSS_DEVIATION, Walls

LINES = np.array([(1.0, 2.0), (2.0, -1.0), (3.0, 0.5)])
WALLS = Walls.convex(LINES, np.array([0.9, -0.5, 0.0]))


def test_a_convex_outline_is_sorted_by_angle_with_its_coefficients():
    np.testing.assert_array_equal(WALLS.lines, LINES[[1, 2, 0]])
    np.testing.assert_array_equal(WALLS.reflection, [-0.5, 0.0, 0.9])
    np.testing.assert_array_equal(WALLS.without(1).lines, LINES[[1, 0]])
    np.testing.assert_array_equal(WALLS.without(1).reflection, [-0.5, 0.9])
    more = WALLS.with_line(np.array((0.7, 1.0)), 0.3)
    np.testing.assert_array_equal(more.lines[2], (0.7, 1.0))
    np.testing.assert_array_equal(more.reflection, [-0.5, 0.0, 0.3, 0.9])


def test_a_polygons_walls_reflect_fully_and_are_its_edges(pentagon):
    walls = Walls.of_polygon(pentagon)
    np.testing.assert_array_equal(walls.reflection, np.ones(5))
    assert {tuple(line) for line in walls.lines} == {tuple(line) for line in polygon_lines(pentagon)}


def test_a_step_moves_lines_and_logarithms_of_coefficients_that_stay_below_1_and_keep_their_sign():
    moved = WALLS.moved(np.array((0.1, 0.2, 0.3, 0.01, 0.02, 0.03, 0.2, 0.4, 0.4)))
    np.testing.assert_allclose(moved.lines - WALLS.lines, np.column_stack(((0.1, 0.2, 0.3), (0.01, 0.02, 0.03))))
    np.testing.assert_allclose(moved.reflection, (-0.5 * np.exp(0.2), 0.0, 1.0))


def test_half_a_cycle_out_and_silence_touch_one_wall():
    slipped = WALLS.shifted(0, 0.25, turned=True)
    np.testing.assert_allclose(slipped.lines - WALLS.lines, [(0.25, 0.0), (0.0, 0.0), (0.0, 0.0)])
    np.testing.assert_array_equal(slipped.reflection, [0.5, 0.0, 0.9])
    np.testing.assert_array_equal(WALLS.silenced(2).reflection, [-0.5, 0.0, 0.0])


def test_the_prior_is_a_gaussian_of_the_losses_of_what_is_heard():
    loss = np.log([0.5, 0.9])
    assert WALLS.log_prior() == pytest.approx(-0.5 * np.sum(loss**2) / LOSS_DEVIATION**2)
    steps = 1e-6 * np.eye(9)
    slopes = [(WALLS.moved(step).log_prior() - WALLS.moved(-step).log_prior()) / 2e-6 for step in steps]
    nothing = Slopes(np.zeros((1, 9)), np.zeros((1, 9, 9)), np.zeros((1, 9, 0)), np.zeros((1, 0, 0)))
    np.testing.assert_allclose(WALLS.gradient(nothing), slopes, atol=1e-6)
    assert WALLS.information(nothing)[8, 8] == pytest.approx(-np.diff(
        [WALLS.moved(share * 1e-3 * np.eye(9)[8]).log_prior() for share in (-1.0, 0.0, 1.0)], 2)[0] / 1e-6)


def test_silent_walls_and_what_would_reflect_more_than_all_are_held():
    walls = Walls.convex(LINES, np.array([1.0, 1.0, 0.0]))
    held = walls.held(np.array((1.0,) * 6 + (1.0, 1.0, -1.0)))
    np.testing.assert_array_equal(held.reshape(3, 3), [(False, True, False), (False, True, False), (True, True, False)])


def test_delays_that_are_half_a_turn_apart_are_signs():
    square = Walls.of_polygon(np.array(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))))
    walls = replace(square, reflection=np.array((0.9, 0.9, 0.8, -0.9)), delay=np.array((1.0, 1.1, 0.9, -1.6)))
    bare = walls.without_delays()
    np.testing.assert_array_equal(bare.reflection, (0.9, 0.9, 0.8, 0.9))
    assert not len(bare.delay)
    np.testing.assert_array_equal(bare.without_delays().reflection, bare.reflection)
