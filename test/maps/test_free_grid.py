"""The grid of probabilities against what is known of a room, with ranges that are right, missed and false."""

import io

import numpy as np
import pytest
import shapely

from polymap_ros.errors import StateError
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps import free_grid
from polymap_ros.maps.free_area import FreeArea
from polymap_ros.maps.free_grid import FreeGrid, make_free_area
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.clearance import half_planes
from polymap_ros.simulation.random_scenes import random_scene

SCENE = random_scene(6, 5)
ROOM = shapely.Polygon(SCENE.vertices)
NORMALS, OFFSETS = half_planes(SCENE.vertices)
WALLS = np.sort(OFFSETS - SCENE.positions @ NORMALS.T, axis=1)
"""Distances of the walls at every ping, the nearest first."""


def filled(ranges, area=None):
    area = area or FreeGrid(0.01, 0.2)
    for (x, y), rho in zip(SCENE.positions, ranges, strict=True):
        area.add(x, y, rho)
    return area


def outside(area):
    return area.shape.difference(ROOM).area / ROOM.area


def test_with_right_ranges_it_is_the_discs_less_what_one_ping_alone_says():
    grid, discs = filled(WALLS[:, 0]), filled(WALLS[:, 0], FreeArea())
    assert outside(grid) < 0.005
    assert 0.85 * discs.area < grid.area < 1.0 * discs.area
    assert grid.shape.difference(discs.shape.buffer(0.01)).area < 1e-3
    assert grid.area == pytest.approx(grid.shape.area)


def test_a_fifth_of_too_long_ranges_does_not_spoil_it():
    generator = np.random.default_rng(0)
    ranges = np.where(generator.uniform(size=len(WALLS)) < 0.2, WALLS[:, 1], WALLS[:, 0])
    grid, discs = filled(ranges), filled(ranges, FreeArea())
    assert outside(discs) > 0.15
    assert outside(grid) < 0.5 * outside(discs)
    assert grid.iou(SCENE.vertices) > discs.iou(SCENE.vertices) + 0.05


def test_probabilities_are_those_of_independent_pings():
    grid = FreeGrid(0.02, 0.25)
    for x in (0.0, 0.1, 0.2):
        grid.add(x, 0.0, 0.5)
    probability, (left, low), cell = grid.probability

    def at(x, y):
        return probability[int((y - low) / cell), int((x - left) / cell)]

    assert at(1.2, 1.0) == at(-0.44, -0.4) == pytest.approx(0.1)  # prior: nobody knows
    assert at(0.1, 0.01) == pytest.approx(1.0 / (1.0 + 9.0 * 0.25**3))
    assert at(-0.41, 0.01) == pytest.approx(1.0 / (1.0 + 9.0 * 0.25))
    ring = at(-0.49, 0.01)  # of the first ping only
    assert ring == pytest.approx(1.0 / (1.0 + 9.0 * np.exp(0.5)))


def test_standing_still_says_nothing_new_and_nan_says_nothing():
    once, often = FreeGrid(0.01, 0.2), FreeGrid(0.01, 0.2)
    once.add(0.0, 0.0, 0.3)
    for _ in range(50):
        often.add(0.001, 0.0, 0.3)
        often.add(0.0, 0.0, float('nan'))
    assert often.probability[0].max() == once.probability[0].max() < 0.5
    assert often.area == 0.0
    assert FreeGrid(0.01, 0.2).area == 0.0


def test_what_is_not_connected_with_the_path_is_not_free():
    """Rings of many pings along a wall keep what a few long ranges reach beyond it apart."""
    grid = FreeGrid(0.01, 0.2)
    for k in range(60):
        grid.add(0.02 * k, 0.0, 0.2 if k % 5 else 0.45)
    assert grid.shape.geom_type == 'Polygon'
    assert all(grid.shape.covers(shapely.Point(0.02 * k, 0.0)) for k in range(10, 50))
    assert grid.shape.bounds[3] < 0.47


def test_a_large_grid_gets_larger_cells(monkeypatch):
    fine = filled(WALLS[:, 0])
    monkeypatch.setattr(free_grid, '_MAX_CELLS', 20_000)
    coarse = filled(WALLS[:, 0])
    assert coarse.probability[0].size <= 20_000 < fine.probability[0].size
    assert coarse.probability[2] in (0.02, 0.04)
    assert coarse.area == pytest.approx(fine.area, rel=0.1)


def test_copies_and_saved_grids_go_on_alike_and_on_their_own():
    grid = FreeGrid(0.01, 0.2)
    for (x, y), rho in zip(SCENE.positions[:30], WALLS[:30, 0], strict=True):
        grid.add(x, y, rho)
    half = grid.area
    file = io.BytesIO()
    np.savez(file, **grid.state())
    file.seek(0)
    saved = FreeGrid(0.01, 0.2)
    with np.load(file, allow_pickle=False) as state:
        saved.restore(dict(state))
    copied = grid.copy()
    for (x, y), rho in zip(SCENE.positions[30:], WALLS[30:, 0], strict=True):
        for other in (copied, saved):
            other.add(x, y, rho)
    assert grid.area == half
    np.testing.assert_array_equal(copied.probability[0], saved.probability[0])
    assert copied.area == saved.area == filled(WALLS[:, 0]).area


@pytest.mark.parametrize('wrong', [{'odds': np.zeros(3)}, {'visited': np.zeros((2, 2))}, {'cell': np.array(0.0)}])
def test_a_damaged_state_is_refused(wrong):
    with pytest.raises(StateError, match='free area'):
        FreeGrid(0.01, 0.2).restore(filled(WALLS[:, 0]).state() | wrong)


def test_the_parameters_choose_the_model():
    assert type(make_free_area('discs', 0.01, 0.2)) is FreeArea
    mapper = PolygonMapper(Parameters().replaced({'free_area.model': 'grid', 'free_area.cell_m': 0.025}))
    mapper.free_area.add(0.0, 0.0, 0.3)
    assert mapper.free_area.probability[2] == 0.025
    mapper.reset()
    assert mapper.free_area.area == 0.0
