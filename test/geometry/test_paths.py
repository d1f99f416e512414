"""Corners against half-planes and shapely; paths against every sequence of walls; their derivatives by differences."""

import itertools

import numpy as np
import pytest
import shapely
from references import bounded_area, unfold

from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.outline import corners_of, half_plane_polygon, is_convex
from polymap_ros.geometry.path_room import CAPACITY, Paths, room_for_paths
from polymap_ros.geometry.paths import trace_paths
from polymap_ros.geometry.sides import outline_sides
from polymap_ros.geometry.storey import Storey
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.reflectors import Reflectors, heard_images


def sorted_walls(vertices):
    """Corners turned so that edge 0 has the smallest theta, and the lines of the edges."""
    vertices = np.roll(vertices, -int(np.argmin(polygon_lines(vertices)[:, 1])), axis=0)
    return vertices, polygon_lines(vertices)


def traced(vertices, ends, order, range_max, soft, convex=None, storey=None):
    """The audible paths from emitter to receiver, as `trace_paths` gives them; both are on one height unless given."""
    storey = (storey or Storey()).images(order, level=False)
    convex = is_convex(vertices) if convex is None else convex
    paths = room_for_paths(order)
    ends = np.append(ends, np.zeros(5 - len(ends)))
    count = trace_paths(outline_sides(vertices, soft, convex), ends, order, range_max, soft, True, storey, paths)
    assert count < CAPACITY
    return Paths(*(column[:count] for column in paths))


def keys(paths):
    """Walls of each path, in the order they are hit."""
    assert all(np.all(row[count:] == -1) for row, count in zip(paths.walls, paths.hits, strict=True))
    return [tuple(row[:count]) for row, count in zip(paths.walls.tolist(), paths.hits, strict=True)]


def beside(positions, apart_m, seed=0):
    """Receivers `apart_m` from their emitters, in any direction."""
    angles = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(positions))
    return positions + apart_m * np.column_stack((np.cos(angles), np.sin(angles)))


@pytest.mark.parametrize('n', [3, 4, 5, 6, 8])
def test_corners_are_those_of_the_half_planes(n):
    generator = np.random.default_rng(n)
    closed = 0
    for _ in range(400):
        unevenness = generator.uniform()
        theta = np.sort(2.0 * np.pi * (np.arange(n) + 0.7 * unevenness * generator.uniform(-1.0, 1.0, n)) / n - 0.5)
        lines = np.column_stack((1.0 - 1.1 * unevenness * generator.uniform(size=n), theta))
        bounds, corners = corners_of(lines)
        expected, which = half_plane_polygon(lines)
        lengths = np.linalg.norm(np.roll(expected, -1, axis=0) - expected, axis=1)
        if not bounds:
            assert len(which) < n or lengths.min() < 1e-3 * np.abs(expected).max()
            continue
        closed += 1
        order = np.argsort(which)
        np.testing.assert_array_equal(which[order], np.arange(n))
        np.testing.assert_allclose(corners, expected[order], atol=1e-9)
        assert shapely.Polygon(corners).symmetric_difference(bounded_area(lines)).area < 1e-9
    assert 20 < closed < 390


@pytest.mark.parametrize('lines', [
    [], [(1.0, 0.0)], [(1.0, -1.0), (1.0, 1.0)],
    [(1.0, -1.0), (1.0, 0.0), (1.0, 1.0)],  # open behind
    [(1.0, -2.0), (1.0, 0.0), (2.0, 0.0), (1.0, 2.0)],  # one line twice, further out
    [(1.0, -2.0), (3.0, 0.0), (1.0, 0.5), (1.0, 2.0)],  # one line beyond the corner of its neighbours
    [(0.0, -2.0), (0.0, 0.0), (0.0, 2.0)],  # a point
    [(-1.0, -2.0), (-1.0, 0.0), (-1.0, 2.0)],  # half-planes that do not meet
])
def test_lines_that_do_not_all_make_an_edge_bound_nothing(lines):
    assert not corners_of(np.array(lines, dtype=float).reshape(-1, 2))[0]


def test_an_edge_too_short_to_be_heard_is_none():
    square = np.array([(1.0, -np.pi / 2), (1.0, 0.0), (1.0, np.pi / 2), (1.0, 3.0)])
    for cut_m, bounds in ((1e-2, True), (1e-3, True), (2e-5, False), (-1e-3, False)):
        cut = np.array([(np.sqrt(2.0) - cut_m, np.pi / 4)])
        lines = np.vstack((square[:2], cut, square[2:]))
        assert corners_of(lines)[0] == bounds


@pytest.mark.parametrize('shortest_m', [0.0, 0.01, 0.05, 0.1])
def test_edges_no_longer_than_the_shortest_are_none(shortest_m):
    for cut_m in (0.02, 0.04, 0.06, 0.2):
        r = np.sqrt(2.0) - cut_m / 2.0  # takes that long an edge off the corner (1, 1)
        square = [(1.0, -np.pi / 2), (1.0, 0.0), (r, np.pi / 4), (1.0, np.pi / 2), (1.0, np.pi)]
        assert corners_of(np.array(square), shortest_m)[0] == (cut_m > shortest_m)
        assert not corners_of(np.array(square), 2.0)[0]


@pytest.mark.parametrize(('apart_m', 'height_m'), [(0.0, 0.0), (0.05, 0.0), (0.03, 0.2)])
@pytest.mark.parametrize('soft', [1e-6, 1e-3, 0.02])
@pytest.mark.parametrize('n', [3, 4, 5, 7])
def test_every_audible_path_is_traced(n, soft, apart_m, height_m):
    """With half its length and with what the ends of its walls leave of it."""
    scene = random_scene(11, n)
    vertices, lines = sorted_walls(scene.vertices)
    places = scene.positions[::8]
    receivers = beside(places, apart_m)
    expected, between = unfold(lines, places, 3, soft, receivers, height_m), 0
    for i, ends in enumerate(np.column_stack((places, receivers, np.full(len(places), height_m)))):
        paths = traced(vertices, ends, 3, 100.0, soft)
        found = {key: (d, weight) for key, d, weight in zip(keys(paths), paths.half, paths.weight, strict=True)}
        heard = {path.walls: (path.half[i], path.weight[i]) for path in expected if path.weight[i] > 1e-9}
        assert {key for key in found if found[key][1] > 1e-9} == heard.keys()
        for key, values in heard.items():
            assert found[key] == pytest.approx(values, abs=1e-9)
            between += 1e-9 < values[1] < 1.0
        assert len(paths.half) == len(set(keys(paths)))
    assert between > 0 or soft < 0.01


def test_a_rectangles_images_are_weighed_as_merged_ones():
    """The two images behind a right-angled corner count as the one that they are, and all others whole."""
    vertices, _ = sorted_walls(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 0.7), (0.0, 0.7)]))
    for place in ((0.31, 0.22), (0.5, 0.37), (0.1, 0.1), (0.93, 0.04)):
        images = visible_images(vertices, place, 5)
        paths = traced(vertices, (*place, *place), 5, 100.0, 1e-3)
        expected, found = (np.round(places, 6) + 0.0 for places in (images.position_m, paths.images[:, :2]))
        weights = {tuple(at): np.sum(paths.weight[np.all(found == at, axis=1)]) for at in expected}
        assert len(weights) == len(expected)
        assert sum(weights.values()) == pytest.approx(np.sum(paths.weight))
        assert list(weights.values()) == pytest.approx(np.ones(len(expected)), abs=1e-6)
        assert np.sum(np.abs(paths.weight - 0.5) < 1e-6) >= 8


def in_corner(degrees, soft, apart_m=0.0):
    """Weights of the two orders in which the walls of a corner at the origin are hit from 0.5 m away."""
    a, b = np.radians(degrees), np.radians(0.45 * degrees)
    vertices, _ = sorted_walls(np.array([(3.0 * np.cos(a), 3.0 * np.sin(a)), (0.0, 0.0), (3.0, 0.0)]))
    place = 0.5 * np.array([np.cos(b), np.sin(b)])
    paths = traced(vertices, (*place, *(place + apart_m * np.array([-np.sin(b), np.cos(b)]))), 2, 100.0, soft)
    corner = int(np.argmin(np.abs(vertices).sum(axis=1)))
    walls = {corner, corner - 1 if corner else len(vertices) - 1}
    return [weight for key, weight in zip(keys(paths), paths.weight, strict=True) if set(key) == walls]


@pytest.mark.parametrize(('degrees', 'expected'), [(60, 2.0), (85, 2.0), (89, 2.0), (90, 1.0), (91, 0.0), (120, 0.0)])
def test_a_corner_is_heard_twice_once_or_not_at_all(degrees, expected):
    assert sum(in_corner(degrees, 1e-3)) == pytest.approx(expected, abs=1e-6)


def test_between_these_a_corners_echo_changes_smoothly():
    """From R = 0.5 m the walls are hit R cos(a) / cos(b) from the corner, b being their angles to the way there.

    A soft end is steepest, 3/4 per `soft`, at the end itself.
    """
    degrees, soft = np.linspace(89.4, 90.6, 241), 1e-3
    total = np.array([sum(in_corner(angle, soft)) for angle in degrees])
    a = np.radians(degrees)
    inside = np.min([0.5 * np.cos(a) / np.cos(share * a) for share in (0.45, 0.55)], axis=0)
    x = np.clip(inside / soft, -1.0, 1.0)
    np.testing.assert_allclose(total, 2.0 * (0.5 + (3.0 * x - x**3) / 4.0), atol=1e-7)
    assert -np.diff(total).min() <= 2.0 * 0.75 / soft * -np.diff(inside).min() * (1.0 + 1e-6)
    assert (total[0], total[120], total[-1]) == pytest.approx((2.0, 1.0, 0.0), abs=1e-6)


def test_paths_end_with_the_range(triangle):
    vertices, _ = sorted_walls(triangle)
    images = visible_images(vertices, (0.5, 0.3), 5)
    paths = traced(vertices, (0.5, 0.3, 0.5, 0.3), 5, 0.8, 0.0)
    near = images.distance_m <= 1.6
    assert 0 < near.sum() < len(near)
    order = np.argsort(paths.half, kind='stable')
    np.testing.assert_allclose(paths.half[order], images.distance_m[near] / 2.0, atol=1e-12)
    np.testing.assert_array_equal(np.sort(paths.hits), np.sort(images.order[near]))
    assert set(keys(paths)) == {tuple(row[row >= 0].tolist()) for row in images.walls[near]}
    np.testing.assert_array_equal(paths.weight, 1.0)


@pytest.mark.parametrize(('n', 'apart_m', 'height_m'), [
    (3, 0.0, 0.0), (3, 0.05, 0.0), (5, 0.0, 0.0), (5, 0.1, 0.2), (8, 0.05, 0.0)])
def test_derivatives_are_those_of_the_unfolded_lengths(n, apart_m, height_m):
    scene = random_scene(13, n)
    vertices, lines = sorted_walls(scene.vertices)
    order = {3: 5, 5: 4, 8: 3}[n]
    places = scene.positions[::25]
    receivers = beside(places, apart_m)
    step, orders, compared = 1e-6, set(), 0
    slopes = {}
    for wall, axis in itertools.product(range(n), range(2)):
        moved = np.zeros((n, 2))
        moved[wall, axis] = step
        before, after = ({path.walls: path.half
                          for path in unfold(lines + way * moved, places, order, 1e-3, receivers, height_m)}
                         for way in (-1.0, 1.0))
        for key in before.keys() & after.keys():
            slopes[key, wall, axis] = (after[key] - before[key]) / (2.0 * step)
    for i, ends in enumerate(np.column_stack((places, receivers, np.full(len(places), height_m)))):
        paths = traced(vertices, ends, order, 100.0, 1e-3)
        for m, key in enumerate(keys(paths)):
            if paths.weight[m] < 1e-3:  # may be heard on one side only
                continue
            analytic = np.zeros((n, 2))
            np.add.at(analytic, list(key), paths.slopes[m, :len(key)])
            expected = [[slopes[key, wall, axis][i] for axis in range(2)] for wall in range(n)]
            assert analytic == pytest.approx(np.array(expected), abs=2e-6)
            compared += 1
            orders.add(len(key))
    assert compared > 50
    assert orders == set(range(1, order + 1))


L_SHAPE = np.array([(0.0, 0.0), (1.4, 0.0), (1.4, 0.5), (0.6, 0.5), (0.6, 1.2), (0.0, 1.2)])
DENT = np.array([(0.0, 0.0), (0.5, 0.25), (0.9, -0.1), (1.3, 0.5), (0.9, 1.1), (0.1, 0.9)])


@pytest.mark.parametrize('vertices', [L_SHAPE, DENT])
def test_a_ring_of_lines_has_the_corners_of_its_outline(vertices):
    lines = polygon_lines(vertices)
    bounds, corners = corners_of(lines)
    assert bounds
    np.testing.assert_allclose(corners, vertices, atol=1e-12)
    assert not corners_of(lines, 0.6)[0]  # longer than an edge
    assert not corners_of(np.ascontiguousarray(lines[::-1] * (-1.0, 1.0) + (0.0, np.pi)))[0]  # clockwise
    assert not corners_of(np.vstack((lines, lines)))[0]  # twice around


def test_a_ring_whose_edges_cross_is_no_outline():
    """The dent is pushed through the opposite wall, step by step; shapely tells when it is."""
    valid = []
    for depth in np.linspace(0.0, 1.2, 25):
        vertices = DENT.copy()
        vertices[1] += (0.0, depth)
        valid.append(shapely.Polygon(vertices).is_valid)
        assert corners_of(polygon_lines(vertices))[0] == valid[-1]
    assert 2 < sum(valid) < 23


@pytest.mark.parametrize('n', [3, 5, 7])
def test_in_a_convex_outline_the_general_way_gives_the_same_paths(n):
    scene = random_scene(17, n)
    vertices, _ = sorted_walls(scene.vertices)
    places, compared = scene.positions[::10], 0
    for ends in np.column_stack((places, beside(places, 0.03))):
        one, other = (traced(vertices, ends, 4, 100.0, 1e-3, convex) for convex in (True, False))
        expected = dict(zip(keys(one), np.column_stack((one.half, one.weight)).tolist(), strict=True))
        found = dict(zip(keys(other), np.column_stack((other.half, other.weight)).tolist(), strict=True))
        assert found.keys() == expected.keys()
        for key in expected:
            assert found[key] == pytest.approx(expected[key], abs=1e-9)
            compared += 1
    assert compared > 100


@pytest.mark.parametrize('vertices', [L_SHAPE, DENT, sorted_walls(random_scene(13, 5).vertices)[0]])
@pytest.mark.parametrize('height_m', [0.0, 0.2])
def test_derivatives_by_the_sensors_place_and_by_walls_are_differences(vertices, height_m):
    lines, generator, step = polygon_lines(vertices), np.random.default_rng(3), 1e-6
    inside = shapely.Polygon(vertices).buffer(-0.05)
    points = (point for point in generator.uniform(vertices.min(axis=0), vertices.max(axis=0), (999, 2))
              if inside.contains(shapely.Point(point)))
    compared = 0
    for place in itertools.islice(points, 6):
        ends = np.array((*place, *(place + (0.02, -0.03)), height_m))
        paths = traced(vertices, ends, 3, 100.0, 1e-3)

        def half_of(ends, lines=lines):
            moved = traced(corners_of(lines)[1], ends, 3, 100.0, 1e-3)
            return dict(zip(keys(moved), moved.half, strict=True))

        by_place = [[half_of(ends + way * step * (np.arange(5) == k)) for way in (-1.0, 1.0)] for k in range(4)]
        by_wall = [[half_of(ends, lines + way * step * (np.arange(lines.size) == k).reshape(-1, 2))
                    for way in (-1.0, 1.0)] for k in range(lines.size)]
        for m, key in enumerate(keys(paths)):
            if paths.weight[m] < 1.0:
                continue
            analytic = np.zeros((len(lines), 2))
            np.add.at(analytic, list(key), paths.slopes[m, :len(key)])
            for expected, found in ((by_place, paths.moves[m]), (by_wall, analytic.ravel())):
                differences = [(after[key] - before[key]) / (2.0 * step) for before, after in expected]
                assert found == pytest.approx(differences, abs=1e-6)
            compared += 1
    assert compared > 60


def test_behind_a_corner_that_points_inwards_an_echo_fades_smoothly():
    """The sensor passes by; the wall beyond the corner is lost from sight over twice a soft end, monotonously."""
    soft, weights = 5e-3, []
    for x in np.linspace(0.55, 0.75, 401):
        ends = (x, 0.3, x, 0.3)
        paths = traced(L_SHAPE, ends, 1, 100.0, soft)
        weights.append(sum(weight for key, weight in zip(keys(paths), paths.weight, strict=True) if key == (4,)))
    weights = np.array(weights)
    assert weights[0] == 1.0
    assert weights[-1] == 0.0
    assert np.all(np.diff(weights) <= 1e-12)
    assert -np.diff(weights).min() < 2.0 * 0.75 / soft * (0.2 / 400)


@pytest.mark.parametrize('turn', [-2e-5, 0.0, 2e-5], ids=['acute', 'right', 'obtuse'])
def test_soft_ends_at_right_angles_of_a_t_count_the_images_that_are_heard(turn):
    """Every sequence of walls is the reference: at a corner that points outwards two half paths count once, at one that
    points inwards there is none, whichever way the angle is off by far less than the soft end.
    """
    corners = np.array([[0.35, 0.0], [0.9, 0.0], [0.9, 0.6], [1.3, 0.6],
                        [1.3, 1.1], [0.0, 1.1], [0.0, 0.6], [0.35, 0.6]])
    reflectors, compared = Reflectors.outline(corners.copy()), 0
    corners[2:4, 1] += turn * corners[2:4, 0]
    for place in np.random.default_rng(3).uniform((0.4, 0.1), (0.85, 1.0), (20, 2)):
        heard = len(heard_images(reflectors, place, 4)[0])
        weight = traced(corners, np.append(place, place), 4, 10.0, 1e-3).weight
        if np.all(np.abs(weight - np.round(2.0 * weight) / 2.0) < 0.1):  # no other path is near an end
            assert np.sum(weight) == pytest.approx(heard, rel=0.05)
            compared += 1
    assert compared > 5


def test_walls_on_one_line_bound_an_outline_unless_they_meet():
    corners = np.array([[0.0, 0.0], [1.5, 0.0], [1.5, 1.2], [1.0, 1.2],
                        [1.0, 0.5], [0.45, 0.5], [0.45, 1.2], [0.0, 1.2]])
    bounds, found = corners_of(np.ascontiguousarray(polygon_lines(corners)))
    assert bounds
    np.testing.assert_allclose(found, corners, atol=1e-9)
    corners[3, 0], corners[4, 0] = 0.4, 0.4  # the arms overlap
    assert not corners_of(np.ascontiguousarray(polygon_lines(corners)))[0]
