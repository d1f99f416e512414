"""Walls that lie in wrong cycles of range, put where their first echoes add up."""

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.evidence.moves.first_echoes import by_first_echoes
from polymap_ros.solvers.evidence.moves.slip import slipped
from polymap_ros.solvers.evidence.search import Search, search_of
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
from polymap_ros.solvers.evidence.walls import Walls

OFF_CYCLES, OFF_DEG = np.array((0.5, -0.5, 1.0, 0.0, -1.0)), np.array((0.1, -0.1, 0.0, 0.2, 0.1))
"""Walls that are off by half a cycle have the other sign."""


@pytest.fixture(scope='module', params=['plate', 'q_5_file'])
def heard(request) -> tuple[Search, np.ndarray]:
    """A search over the echoes of a plate, and its walls' lines."""
    scene = VARIANTS[request.param].make(2, 5)
    mapper = filled_mapper(scene, Parameters())
    lines = polygon_lines(mapper.start_pose.inverse().apply(scene.vertices))
    return search_of(mapper.evidence, mapper.parameters), lines


def test_walls_in_wrong_cycles_are_all_found_at_once(heard):
    search, lines = heard
    turned = np.where(OFF_CYCLES % 1.0, -1.0, 1.0)
    off = lines + np.column_stack((OFF_CYCLES * search.cycle_m, np.deg2rad(OFF_DEG)))
    true, wave = (search.wave.refine(search.wave.begun(Walls.convex(at, signs)),
                                     FULL_ORDER) for at, signs in ((lines, 1.0), (off, turned)))
    found = by_first_echoes(search, wave)
    assert found.value == pytest.approx(true.value, rel=1e-3)
    np.testing.assert_allclose(found.walls.lines, true.walls.lines, atol=1e-4)
    np.testing.assert_array_equal(np.sign(found.walls.reflection), np.sign(true.walls.reflection))
    one_by_one = wave
    while (better := slipped(search, one_by_one, np.arange(5))) is not None:
        one_by_one = better
    assert one_by_one.value < 0.8 * true.value


def test_where_walls_are_right_nothing_is_changed(heard):
    search, lines = heard
    true = search.wave.refine(search.wave.begun(Walls.convex(lines)), FULL_ORDER)
    assert by_first_echoes(search, true) is None
