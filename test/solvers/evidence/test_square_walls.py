"""Lines that turn together, against the walls that they are made of; and on the ridge of a T's right angles."""

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.shaped_scenes import clean_echoes, shaped_scene
from polymap_ros.solvers.evidence.likelihood import gradient_of
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.square_walls import free, squared
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
from polymap_ros.solvers.evidence.walls import Walls

L_SHAPE = np.array([(0.0, 0.0), (1.4, 0.0), (1.4, 0.5), (0.6, 0.5), (0.6, 1.2), (0.0, 1.2)])


def walls_of(corners, off_rad=()):
    lines = polygon_lines(corners)
    lines[:len(off_rad), 1] += off_rad
    return Walls(lines, np.ones(len(lines)))


def test_what_is_nearly_square_becomes_so():
    found = squared(walls_of(L_SHAPE, (2e-3, -1e-3, 0.0, 3e-3)))
    quarters = np.mod(found.lines[:, 1], np.pi / 2)
    assert np.ptp(np.minimum(quarters, np.pi / 2 - quarters)) == pytest.approx(0.0, abs=1e-12)
    # Each wall stays where its middle is.
    assert found.lines[:, 0] == pytest.approx(polygon_lines(L_SHAPE)[:, 0], abs=5e-3)


def test_what_is_not_stays_apart():
    assert squared(walls_of(np.array([(0.0, 0.0), (1.0, 0.1), (0.3, 0.9)]))) is None
    skewed = squared(walls_of(L_SHAPE, (0.05,)))
    assert skewed.lines[0, 1] == pytest.approx(polygon_lines(L_SHAPE)[0, 1] + 0.05)
    assert np.sum(skewed.group == skewed.group[0]) == 1
    assert np.sum(skewed.group == skewed.group[1]) == 5


def test_a_step_turns_all_of_a_group_and_moves_each():
    found = squared(walls_of(L_SHAPE))
    n = len(found)
    step = np.concatenate((1e-3 * np.arange(n), [2e-3], np.full(n, -0.1)))
    moved = found.moved(step)
    np.testing.assert_allclose(moved.lines[:, 0] - found.lines[:, 0], 1e-3 * np.arange(n), atol=1e-12)
    np.testing.assert_allclose(moved.lines[:, 1] - found.lines[:, 1], 2e-3)
    np.testing.assert_allclose(moved.reflection, np.exp(-0.1))
    assert type(free(moved)) is Walls
    assert len(found.without(2).group) == n - 1


def test_one_wall_more_sets_all_free():
    square = squared(walls_of(np.array([(0.0, 0.0), (1.4, 0.0), (1.4, 0.9), (0.0, 0.9)])))
    for more in (square.with_line(np.array((1.5, 0.7)), 0.5), square.inserted(2, np.array((1.5, 0.7)), 0.5)):
        assert type(more) is Walls
        assert len(more) == 5
        assert more.moved(np.zeros(15)).reflection.min() == 0.5


def test_a_step_is_shortened_as_a_whole():
    found = squared(walls_of(L_SHAPE))
    step = np.concatenate((np.zeros(len(found)), [0.1], np.zeros(len(found))))
    assert found.limited(step, 1.0, 0.02) == pytest.approx(0.2 * step)


@pytest.mark.heavy
def test_on_the_ridge_of_a_t_a_climb_gets_on_that_by_itself_does_not():
    """The T's lines as they are, but for what they reflect: with each line by itself a step leads off the ridge."""
    scene = shaped_scene('t', 6)
    mapper = filled_mapper(scene, Parameters(), clean_echoes(scene))
    search = search_of(mapper.evidence, mapper.parameters)
    lines = polygon_lines(Pose(*scene.poses[0].tolist()).inverse().apply(scene.vertices))
    alone = Walls(lines, np.full(len(lines), 0.97))
    values = []
    for walls in (alone, squared(alone)):
        begun = search.wave.begun(walls)
        start = search.wave.evaluate(walls, begun, FULL_ORDER, derive=True)
        assert len(gradient_of(start)) == (24 if walls is alone else 17)
        values.append(search.wave.refine(begun, FULL_ORDER, 20).value - start.value)
    assert values[0] < 10.0
    assert values[1] > 50.0
