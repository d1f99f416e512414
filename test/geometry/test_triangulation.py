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
