"""Half-planes and polygons against clipping a huge square, shapely, and shapes known by heart."""

import numpy as np
import pytest
import shapely
from references import bounded_area

from polymap_ros.geometry.lines import feet_on_edges, iou, polygon_lines
from polymap_ros.geometry.outline import half_plane_polygon

SQUARE = np.array([(1.0, 0.0), (1.0, np.pi / 2), (1.0, np.pi), (1.0, -np.pi / 2)])


def random_lines(rng, k, scale=1.0):
    lines = np.column_stack((rng.uniform(0.0, 1.0, k) * scale, rng.uniform(0.0, 2 * np.pi, k)))
    return lines if rng.random() < 0.5 else np.column_stack((lines[:, 0], np.deg2rad(rng.integers(0, 360, k))))


@pytest.mark.parametrize('k', [3, 4, 6, 10, 30])
@pytest.mark.parametrize('scale', [1e-3, 1.0])
def test_equals_clipping_the_plane(k, scale):
    rng = np.random.default_rng(k)
    closed = 0
    for _ in range(200):
        lines = random_lines(rng, k, scale)
        vertices, which = half_plane_polygon(lines)
        expected = bounded_area(lines)
        found = shapely.Polygon(vertices) if len(vertices) else shapely.Polygon()
        assert found.symmetric_difference(expected).area <= 1e-9 * max(expected.area, scale**2)
        if len(vertices):
            closed += 1
            assert found.is_valid
            assert found.exterior.is_ccw
            r, theta = lines[which].T
            for x, y in (vertices.T, np.roll(vertices, -1, axis=0).T):  # edge i lies on line which[i]
                np.testing.assert_allclose(x * np.cos(theta) + y * np.sin(theta), r, atol=1e-9 * np.abs(vertices).max())
    assert closed > 20


def test_lines_may_lie_on_any_side_of_the_origin():
    shifted = SQUARE.copy()
    shifted[:, 0] += 5.0 * np.cos(SQUARE[:, 1]) - 7.0 * np.sin(SQUARE[:, 1])
    vertices, which = half_plane_polygon(shifted)
    assert sorted(map(tuple, np.round(vertices, 9))) == [(4.0, -8.0), (4.0, -6.0), (6.0, -8.0), (6.0, -6.0)]
    assert sorted(which) == [0, 1, 2, 3]


@pytest.mark.parametrize('lines', [
    [], SQUARE[:1], SQUARE[:2], SQUARE[:3], SQUARE[[0, 2]],
    [(1.0, 0.0), (1.0, 0.5), (1.0, 1.0), (1.0, np.pi)],  # a strip with one end
    [(1.0, 0.0), (-2.0, np.pi), (1.0, 1.5), (1.0, -1.5)],  # half-planes that do not meet
    [(0.0, 0.0), (0.0, np.pi), (1.0, np.pi / 2), (1.0, -np.pi / 2)],  # of width zero
    [(0.0, 0.0), (0.0, 2.0), (0.0, 4.0)],  # one point
    [(1.0, 0.0), (1.0, np.pi), (2.0, 0.0), (3.0, np.pi), (1.0, 1.0)],
])
def test_what_bounds_no_area_has_no_vertices(lines):
    vertices, which = half_plane_polygon(np.array(lines).reshape(-1, 2))
    assert vertices.shape == (0, 2)
    assert which.shape == (0,)


def test_lines_that_make_no_edge_are_left_out_and_of_equal_lines_the_first_is_kept():
    lines = np.vstack((SQUARE, [(5.0, 0.1)], SQUARE, [(1.0, 2 * np.pi)], [(np.sqrt(2.0), np.pi / 4)]))
    vertices, which = half_plane_polygon(lines)
    assert sorted(which) == [0, 1, 2, 3]
    assert shapely.Polygon(vertices).area == pytest.approx(4.0)


def test_lines_of_a_polygon_give_it_back():
    rng = np.random.default_rng(5)
    for n in (3, 5, 9):
        corners = np.exp(1j * np.sort(rng.uniform(0.0, 2 * np.pi, n)))
        corners = np.column_stack((corners.real, corners.imag)) * (1.0, 0.4) + (3.0, -2.0)
        lines = polygon_lines(corners)
        middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
        normals = np.column_stack((np.cos(lines[:, 1]), np.sin(lines[:, 1])))
        assert not any(shapely.contains_xy(shapely.Polygon(corners), *(middles + 1e-6 * normals).T))
        vertices, which = half_plane_polygon(lines)
        start = int(np.flatnonzero(which == 0)[0])
        np.testing.assert_allclose(np.roll(vertices, -start, axis=0), corners, atol=1e-9)


def test_feet_are_counted_where_the_perpendicular_meets_the_edge():
    corners = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])
    points = np.array([(0.5, 0.5), (1.9, 0.1), (3.0, 0.5), (-1.0, 2.0), (2.0, 1.0)])
    assert feet_on_edges(corners, points).tolist() == [3, 4, 3, 4]
    assert feet_on_edges(corners, np.empty((0, 2))).tolist() == [0, 0, 0, 0]
    # Of the edges' left sides only: (3, 0.5) is behind the edge at x = 2, and (2, 1) on it and on the one at y = 1.
    assert feet_on_edges(corners, points, in_front=True).tolist() == [3, 2, 2, 4]


def test_iou_of_known_shapes():
    one = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    assert iou(one, one) == pytest.approx(1.0)
    assert iou(one, np.add(one, (0.5, 0.0))) == pytest.approx(1.0 / 3.0)
    assert iou(one, np.add(one, (2.0, 0.0))) == 0.0
    assert iou(one, one[::-1]) == pytest.approx(1.0)
    assert iou(one, one[:3]) == iou(one[:3], one) == pytest.approx(0.5)
    assert iou(one, []) == iou(np.empty((0, 2)), one) == 0.0
