"""The baseline against a search over all combinations."""

import itertools

import numpy as np
import pytest
import shapely

from polymap_ros.geometry.overlap import Region
from polymap_ros.map_parameters import GridParameters
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.solvers.rectangle import RectangleSolver, best_rectangle
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.solver import Evidence


def snapshot(likelihood, step_deg, first_deg=0.0, circle=True):
    n_theta, n_r = likelihood.shape
    theta = np.deg2rad(first_deg + step_deg * np.arange(n_theta))
    return Snapshot(likelihood.astype(np.float32), 0.1 * np.arange(n_r), theta, circle,
                    Region(shapely.box(-1, -1, 1, 1)), np.zeros((3, 2)), 0, np.ones(3, int))


@pytest.mark.parametrize('step_deg', [30.0, 45.0, 10.0])
def test_equals_the_search_over_all_rectangles(step_deg):
    rng = np.random.default_rng(int(step_deg))
    n, quarter = round(360 / step_deg), round(90 / step_deg)
    likelihood = rng.random((n, 5)).astype(np.float32)
    best = max(
        (float(sum(likelihood[(i + turn * quarter) % n, r] for turn, r in enumerate(ranges))),
         {(round(((i + turn * quarter) % n) * step_deg), r) for turn, r in enumerate(ranges)})
        for i in range(n) for ranges in itertools.product(range(5), repeat=4))
    lines, values = best_rectangle(snapshot(likelihood, step_deg), np.deg2rad(step_deg))
    assert values.sum() == pytest.approx(best[0])
    found = {(round(np.rad2deg(theta)) % 360, round(r / 0.1)) for r, theta in lines}
    assert found == best[1]


def test_uneven_steps_take_the_nearest_cell():
    step = 7.0  # 360 / 7 is not whole: 52 cells up to 357 degrees, and 3 degrees from there to the first
    likelihood = np.zeros((52, 20))
    for degrees, column in ((14.0, 3), (105.0, 5), (196.0, 7), (287.0, 9)):
        likelihood[round(degrees / step), column] = 1.0
    lines, values = best_rectangle(snapshot(likelihood, step), np.deg2rad(step))
    assert values.tolist() == [1.0] * 4
    assert {(round(np.rad2deg(theta)) % 360, round(r / 0.1)) for r, theta in lines} == {
        (14, 3), (104, 5), (194, 7), (284, 9)}


def test_a_window_that_holds_no_four_directions_holds_no_rectangle():
    likelihood = np.ones((270, 4))
    lines, values = best_rectangle(snapshot(likelihood, 1.0, -30.0, circle=False), np.deg2rad(1.0))
    assert (lines.shape, values.shape) == ((0, 2), (0,))


def test_a_window_of_more_than_three_quarters_holds_some():
    likelihood = np.full((300, 4), 0.1)
    for degrees in (20, 110, 200, 290):
        likelihood[degrees, 2] = 1.0
    lines, _ = best_rectangle(snapshot(likelihood, 1.0, circle=False), np.deg2rad(1.0))
    assert np.rint(np.rad2deg(lines[:, 1])).tolist() == [20, 110, 200, 290]
    for degrees in (20, 110, 200, 290):
        likelihood[degrees, 2] = 0.1
    for degrees in (30, 120, 210):  # the fourth is beyond the window
        likelihood[degrees, 3] = 5.0
    lines, _ = best_rectangle(snapshot(likelihood, 1.0, circle=False), np.deg2rad(1.0))
    assert np.rad2deg(lines[:, 1]).max() < 300.0


def test_a_rectangular_plate_is_found_with_what_is_said_about_it(heard):
    solver = RectangleSolver(heard.parameters)
    estimate = solver.solve(Evidence(tuple(heard.soundings), heard.beam_map, heard.free_area))
    assert (estimate.status, estimate.method, estimate.cost) == ('closed', 'rectangle', None)
    sides = np.roll(estimate.polygon.vertices, -1, axis=0) - estimate.polygon.vertices
    np.testing.assert_allclose(np.einsum('nk,nk->n', sides, np.roll(sides, -1, axis=0)), 0.0, atol=1e-12)
    assert estimate.iou_free_area == pytest.approx(heard.free_area.iou(estimate.polygon.vertices))


def test_an_empty_map_is_no_rectangle():
    parameters = GridParameters()
    empty = Snapshot.of(Evidence((), BeamformingMap(parameters), _Empty()))
    lines, values = best_rectangle(empty, np.deg2rad(1.0))
    assert values.tolist() == [0.0] * 4
    assert lines[:, 0].tolist() == [0.0] * 4


class _Empty:
    region = Region(shapely.Polygon())
