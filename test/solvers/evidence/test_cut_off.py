"""Silent walls across corners: where they are tried, and that only those are told that take away what was not heard."""

import numpy as np
import pytest
import shapely
from heard_scenes import hear
from references import inside

from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.solvers.evidence.cut_off import CUT_SHARES, is_cut_off, silent_cuts, unheard_corners
from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.evidence.walls import Walls


def searching(heard):
    """A search over what was heard, and the true walls as its answer."""
    search = Search(heard.data, 10, np.random.default_rng(1))
    return search, search.judge(search.nothing.with_strength(1.0).with_walls(Walls.convex(heard.lines)))


def test_cuts_take_shares_of_the_shorter_edge_away_on_both_sides(pentagon):
    search, found = searching(hear(pentagon, inside(pentagon, 20, clearance=0.4), snr_db=10.0))
    corners = half_plane_polygon(found.lines)[0]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    inner = [np.pi - np.mod(turn, 2.0 * np.pi) for turn in np.diff(np.roll(polygon_lines(corners)[:, 1], 1), append=(
        polygon_lines(corners)[-1, 1]))]
    expected = sorted(0.5 * (share * min(lengths[k], lengths[k - 1])) ** 2 * np.sin(inner[k])
                      for k in range(5) for share in CUT_SHARES)
    whole, areas = shapely.Polygon(corners), []
    for walls in silent_cuts(search, found):
        assert walls.silent.sum() == 1
        assert walls.convex_outline
        cut = shapely.Polygon(half_plane_polygon(walls.lines)[0])
        assert whole.buffer(1e-9).covers(cut)
        areas.append(whole.area - cut.area)
    np.testing.assert_allclose(sorted(areas), expected, rtol=1e-6)


@pytest.mark.parametrize('corner', range(5))
def test_a_silent_wall_across_a_corner_is_told_by_what_is_missing(corner, pentagon):
    ends = [pentagon[corner] + 0.4 * (pentagon[(corner + step) % 5] - pentagon[corner]) for step in (-1, 1)]
    room = np.insert(np.delete(pentagon, corner, 0), corner, ends, axis=0)
    reflection = np.where(np.arange(6) == corner, 0.0, 1.0)
    places = inside(room, 40)
    search, found = searching(hear(pentagon, places))
    assert not is_cut_off(search, found)
    missing = hear(room, places, reflection=reflection)
    silent = Search(missing.data, 10, np.random.default_rng(1))
    walls = silent.nothing.with_strength(1.0).with_walls(Walls.convex(missing.lines[missing.reflection > 0.0]))
    assert is_cut_off(silent, silent.judge(walls))


def test_of_a_room_heard_from_everywhere_no_corner_is_unheard(pentagon):
    search, found = searching(hear(pentagon, inside(pentagon, 40)))
    assert unheard_corners(search, found) == {}


@pytest.mark.parametrize('end_m', [0.3, 0.8, 1.2])
def test_as_much_of_a_tip_is_told_as_can_be_cut_off_unheard(end_m):
    """A needle of 10 deg, whose tip sends nothing back: all up to the pings, to a factor of two."""
    needle = np.array([(0.0, -0.15), (1.7, 0.0), (0.0, 0.15)])
    places = np.column_stack((np.linspace(0.1, end_m, 30), 0.03 * np.sin(np.arange(30))))
    search, found = searching(hear(needle, places, snr_db=10.0))
    [(tip, depth)] = unheard_corners(search, found).items()
    np.testing.assert_allclose(found.lines[[tip - 1, tip], 1], np.pi / 2.0 * np.array((-1.0, 1.0)), atol=0.1)
    whole = hear(needle, places, snr_db=10.0, clean=True)
    half = 0.15 * depth / 1.7
    room = np.array([(0.0, -0.15), (1.7 - depth, -half), (1.7 - depth, half), (0.0, 0.15)])
    cut = hear(room, places, snr_db=10.0, clean=True, reflection=np.array((1.0, 0.0, 1.0, 1.0)))
    np.testing.assert_allclose(cut.samples, whole.samples, atol=1e-3 * whole.sigma)
    assert depth < 1.7 - end_m < 2.0 * depth
