"""Triangles of a polygon against shapely: together they are the polygon, and none lies on another."""

import numpy as np
import pytest
import shapely

from polymap_ros.geometry.triangulation import triangles
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.shaped_scenes import SHAPE_KINDS

OUTLINES = [kind.corners(np.random.default_rng(seed)) for kind in SHAPE_KINDS.values() for seed in range(3)]
OUTLINES += [random_scene(1, n).vertices for n in (3, 5, 8)]


@pytest.mark.parametrize('corners', OUTLINES)
def test_they_are_the_polygon(corners):
    found = triangles(corners)
    assert found.shape == (len(corners) - 2, 3)
    parts = [shapely.Polygon(corners[each]) for each in found]
    assert all(part.exterior.is_ccw for part in parts)
    whole = shapely.Polygon(corners)
    assert sum(part.area for part in parts) == pytest.approx(whole.area)
    assert shapely.symmetric_difference(shapely.union_all(parts), whole).area < 1e-9


def test_a_comb_is_cut_between_its_teeth():
    x = np.arange(0.0, 9.0)
    comb = np.column_stack((np.concatenate((x[::-1], [0.0, 8.0])), np.concatenate((np.arange(9) % 2, [-1.0, -1.0]))))
    assert len(triangles(comb)) == len(comb) - 2


def test_fewer_than_three_corners_are_none():
    assert triangles(np.empty((0, 2))).shape == (0, 3)


def hole(x, y, size, n=4, turn=0.0):
    angles = turn - 2.0 * np.pi * np.arange(n) / n
    return np.column_stack((x + size * np.cos(angles), y + size * np.sin(angles)))


SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
L_SHAPE = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])
GRID = [hole(0.35 + 0.4 * x, 0.35 + 0.4 * y, 0.1, turn=np.pi / 4) for x in range(4) for y in range(4)]
PIERCED = [
    (SQUARE, [hole(1.0, 1.0, 0.5, turn=np.pi / 4)]), (SQUARE, [hole(1.0, 1.0, 0.9, 12)]), (SQUARE, GRID),
    (SQUARE[[0, 1, 2]], [hole(1.5, 0.3 + 0.3 * k, 0.1, 5, 0.2 * k) for k in range(4)]),
    (L_SHAPE, [hole(0.5, 0.5, 0.3, 3, 0.1), hole(2.2, 0.5, 0.4), hole(0.5, 2.2, 0.4, 7)]),
    (SQUARE, [np.array([[0.2, 0.2], [0.2, 1.8], [1.8, 1.8], [1.8, 1.6], [0.4, 1.6], [0.4, 0.2]]), hole(1.0, 1.0, 0.3)]),
]


@pytest.mark.parametrize(('corners', 'holes'), [*PIERCED, (SQUARE + (6.9e5, 5.3e6), [
    hole(1.0, 1.0, 0.5, turn=np.pi / 4) + (6.9e5, 5.3e6)])])
def test_holes_are_left_out(corners, holes):
    found = triangles(corners, holes)
    every = np.concatenate((corners, *holes))
    assert found.shape == (len(every) + 2 * len(holes) - 2, 3)
    parts = [shapely.Polygon(every[each]) for each in found]
    whole = shapely.Polygon(corners, holes)
    assert sum(part.area for part in parts) == pytest.approx(whole.area)
    assert max(shapely.Polygon(each).intersection(part).area for each in holes for part in parts) < 1e-9
    assert shapely.symmetric_difference(shapely.union_all(parts), whole).area < 1e-6


@pytest.mark.parametrize('seed', range(12))
def test_holes_at_random_places_are_left_out(seed):
    generator = np.random.default_rng(seed)
    disc, holes = shapely.Point(0.0, 0.0).buffer(2.0), []
    while len(holes) < 8:
        x, y, size = *generator.uniform(-1.7, 1.7, 2), generator.uniform(0.05, 0.4)
        apart = shapely.Point(x, y).buffer(size)
        if disc.contains(apart) and not any(apart.intersects(shapely.Polygon(each)) for each in holes):
            holes.append(hole(x, y, size, int(generator.integers(3, 8)), generator.uniform(0.0, 6.0)))
    corners = hole(0.0, 0.0, 2.05 / np.cos(np.pi / 9), 9)[::-1]
    every, whole = np.concatenate((corners, *holes)), shapely.Polygon(corners, holes)
    parts = [shapely.Polygon(every[each]) for each in triangles(corners, holes)]
    assert sum(part.area for part in parts) == pytest.approx(whole.area)
    assert shapely.symmetric_difference(shapely.union_all(parts), whole).area < 1e-9


def test_a_hole_that_lies_outside_is_left_filled():
    parts = [shapely.Polygon(SQUARE[each]) for each in triangles(SQUARE, [hole(5.0, 5.0, 0.5)])]
    assert sum(part.area for part in parts) == pytest.approx(4.0)
