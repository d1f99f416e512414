"""The compiled overlap with a convex polygon against shapely, on regions with holes, parts and common edges."""

import numpy as np
import pytest
import shapely
from references import shapely_iou

from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.geometry.overlap import Region

TRIANGLE = np.array([(0.0, 0.0), (4.0, 0.0), (0.0, 4.0)])


def box(x0, y0, x1, y1):
    return shapely.box(x0, y0, x1, y1)


def discs(rng, count, spread):
    return shapely.union_all(shapely.buffer(
        shapely.points(rng.uniform(-spread, spread, (count, 2))), rng.uniform(0.05, 0.5, count)))


REGIONS = {
    'inside': box(0.5, 0.5, 1.0, 1.0),
    'around': box(-9.0, -9.0, 9.0, 9.0),
    'beside': box(5.0, 5.0, 6.0, 6.0),
    'across': box(-1.0, 1.0, 9.0, 1.5),
    'with the same edges': box(0.0, 0.0, 1.0, 1.0),
    'the same': shapely.Polygon(TRIANGLE),
    'beyond an edge': box(0.0, -1.0, 4.0, 0.0),
    'with a hole': box(-1.0, -1.0, 3.0, 3.0) - box(0.5, 0.5, 2.5, 2.5),
    'with a hole around': box(-9.0, -9.0, 9.0, 9.0) - box(-1.0, -1.0, 5.0, 5.0),
    'in two parts': box(-1.0, 0.2, 0.5, 0.4) | box(1.0, 1.0, 5.0, 5.0),
    'a comb': shapely.union_all([box(0.3 * i, -1.0, 0.3 * i + 0.1, 2.0) for i in range(12)] + [box(0, -1, 4, -0.9)]),
    'clockwise': shapely.Polygon([(0.0, 0.0), (0.0, 2.0), (2.0, 2.0), (2.0, 0.0)]),
}


@pytest.mark.parametrize('name', REGIONS)
def test_overlap_with_a_triangle(name):
    shape = REGIONS[name]
    assert Region(shape).iou(TRIANGLE) == pytest.approx(shapely_iou(shape, shapely.Polygon(TRIANGLE)), abs=1e-12)
    assert Region(shape).area == pytest.approx(shape.area)


@pytest.mark.parametrize(('count', 'spread'), [(1, 0.1), (10, 0.5), (60, 0.6), (40, 2.0)])
def test_overlap_with_random_polygons(count, spread):
    rng = np.random.default_rng(count)
    shape = discs(rng, count, spread)
    region, compared = Region(shape), 0
    for _ in range(300):
        k = rng.integers(3, 11)
        vertices, _ = half_plane_polygon(np.column_stack((rng.uniform(0.0, 1.0, k), rng.uniform(0.0, 2 * np.pi, k))))
        if len(vertices):
            expected = shapely_iou(shape, shapely.Polygon(vertices))
            assert region.iou(vertices) == pytest.approx(expected, abs=1e-9)
            compared += 1
    assert compared > 100


def test_overlap_does_not_depend_on_the_corner_a_polygon_starts_with():
    region = Region(REGIONS['with a hole'])
    assert region.iou(np.roll(TRIANGLE, 1, axis=0)) == pytest.approx(region.iou(TRIANGLE), abs=1e-15)


def test_nothing_overlaps_with_nothing():
    assert Region(shapely.Polygon()).iou(TRIANGLE) == 0.0
    assert Region(REGIONS['inside']).iou(np.empty((0, 2))) == 0.0


def test_a_polygon_with_holes_is_what_shapely_says():
    hole = 0.3 * (TRIANGLE - TRIANGLE.mean(axis=0)) + TRIANGLE.mean(axis=0)
    pierced = shapely.Polygon(TRIANGLE, [hole])
    for shape in REGIONS.values():
        assert Region(shape).iou(TRIANGLE, [hole]) == pytest.approx(shapely_iou(shape, pierced), abs=1e-12)
