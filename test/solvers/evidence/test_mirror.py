"""Mirror images about the path: found where they are another polygon, and none where it is the same one."""

import numpy as np
import pytest
from heard_scenes import hear
from references import inside

from polymap_ros.geometry.lines import mirrored_lines
from polymap_ros.solvers.evidence.mirror import mirror_image
from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.evidence.solver import TOO_LITTLE
from polymap_ros.solvers.evidence.walls import Walls

RECTANGLE = np.array([(-0.6, -0.4), (0.6, -0.4), (0.6, 0.4), (-0.6, 0.4)])


def oval(half_length, half_width, count=40):
    angles = 2.0 * np.pi * (0.5 + np.arange(count)) / count
    return np.column_stack((half_length * np.cos(angles), half_width * np.sin(angles)))


def searching(heard, lines=None):
    """A search over what was heard, and its answer: the walls, or other lines, as they stand."""
    search = Search(heard.data, 10, np.random.default_rng(1))
    lines = heard.lines if lines is None else lines[np.argsort(lines[:, 1])]
    return search, search.judge(search.nothing.with_strength(1.0).with_walls(Walls.convex(lines)))


@pytest.mark.parametrize('half_width', [0.01, 0.25])
def test_a_symmetric_room_has_no_other_image(half_width):
    search, found = searching(hear(RECTANGLE, oval(0.45, half_width), snr_db=10.0))
    assert mirror_image(search, found, False) is None


def test_a_winding_path_leaves_no_image(pentagon):
    search, found = searching(hear(pentagon, inside(pentagon, 40)))
    assert mirror_image(search, found, False) is None


def test_from_a_narrow_path_the_image_is_near_and_worth_less(triangle):
    path = np.array((0.55, 0.3)) + oval(0.25, 0.008)
    search, found = searching(hear(triangle, path))
    other = mirror_image(search, found, False)
    expected = mirrored_lines(found.lines, path.mean(axis=0), (1.0, 0.0))
    np.testing.assert_allclose(other.lines, expected[np.argsort(expected[:, 1])], atol=0.01)
    assert TOO_LITTLE * found.value < other.value < found.value


@pytest.mark.parametrize(('aside', 'turned'), [(0, 0), (3, 0), (0, -4), (2, 3), (-3, 2), (-1, -4)])
def test_of_an_answer_that_is_an_image_about_another_line_the_truth_is_found(aside, turned, triangle):
    """In steps of half a pulse's width, across at the path's middle and at its ends."""
    path = np.array((0.55, 0.3)) + oval(0.25, 0.04)
    heard = hear(triangle, path)
    step = 0.5 * heard.data.pulse.width_m
    angle = 2.0 * turned * step / np.ptp(path[:, 0])
    wrong = mirrored_lines(heard.lines, path.mean(axis=0) + (0.0, aside * step), (np.cos(angle), np.sin(angle)))
    search, found = searching(heard, wrong)
    other = mirror_image(search, found, True)
    assert other.value > found.value
    np.testing.assert_allclose(other.lines, heard.lines, atol=4e-3)
