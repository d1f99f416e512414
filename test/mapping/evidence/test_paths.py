"""Corners against half-planes and shapely; paths against every sequence of walls; their derivatives by differences."""

import itertools

import numpy as np
import pytest
import shapely

from polymap_ros.acoustics.image_sources import visible_images, walls_of
from polymap_ros.mapping.evidence.paths import CAPACITY, Paths, corners_of, room_for_paths, trace_paths
from polymap_ros.mapping.lines import half_plane_polygon, polygon_lines
from polymap_ros.simulation.random_scenes import random_scene


def sorted_walls(vertices):
    """Corners turned so that edge 0 has the smallest theta, and the lines of the edges."""
    vertices = np.roll(vertices, -int(np.argmin(polygon_lines(vertices)[:, 1])), axis=0)
    return vertices, polygon_lines(vertices)


def traced(vertices, ends, order, range_max, soft):
    """The audible paths from emitter to receiver, as `trace_paths` gives them; both are on one height unless given."""
    paths = room_for_paths(order)
    ends = np.append(ends, np.zeros(5 - len(ends)))
    count = trace_paths(walls_of(vertices, soft), ends, order, range_max, soft, True, paths)
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
def test_corners_are_those_of_the_half_planes(n, bounded_area):
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
def test_every_audible_path_is_traced(n, soft, apart_m, height_m, unfold):
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
        expected, found = (np.round(places, 6) + 0.0 for places in (images.position_m, paths.images))
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
def test_derivatives_are_those_of_the_unfolded_lengths(n, apart_m, height_m, unfold):
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
