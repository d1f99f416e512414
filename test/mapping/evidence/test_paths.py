"""Corners against half-planes and shapely; paths against every sequence of walls; their derivatives by differences."""

import itertools

import numpy as np
import pytest
import shapely

from polymap_ros.acoustics.image_sources import visible_images
from polymap_ros.mapping.evidence.paths import CAPACITY, corners_of, path_derivatives, trace_paths
from polymap_ros.mapping.lines import half_plane_polygon, polygon_lines
from polymap_ros.simulation.random_scenes import random_scene


def sorted_walls(vertices):
    """Corners turned so that edge 0 has the smallest theta, and the lines of the edges."""
    vertices = np.roll(vertices, -int(np.argmin(polygon_lines(vertices)[:, 1])), axis=0)
    return vertices, polygon_lines(vertices)


def traced(vertices, position, order, range_max):
    """Half lengths, walls and numbers of hits of the audible paths, as `trace_paths` gives them."""
    found, walls = np.empty((CAPACITY, 2)), np.empty((CAPACITY, order), np.int64)
    half, hits = np.empty(CAPACITY), np.empty(CAPACITY, np.int64)
    count = trace_paths(vertices, *position, order, range_max, found, walls, half, hits)
    return half[:count], walls[:count], hits[:count]


def audible(vertices, position, sequence):
    """Whether a ray comes back by exactly these walls, and half its length; unfolded with complex numbers."""
    corners = vertices @ (1, 1j)
    source = image = complex(*position)
    images = []
    for wall in sequence:
        a, along = corners[wall], corners[(wall + 1) % len(corners)] - corners[wall]
        image = a + along * np.conj((image - a) / along)
        images.append(image)
    here = source
    for wall, image in zip(sequence[::-1], images[::-1], strict=True):
        a, along = corners[wall], corners[(wall + 1) % len(corners)] - corners[wall]
        p, q = (here - a) / along, (image - a) / along
        if p.imag <= 0.0 or q.imag >= 0.0:
            return False, np.nan
        share = p.real + (q.real - p.real) * p.imag / (p.imag - q.imag)
        if not 0.0 <= share <= 1.0:
            return False, np.nan
        here = a + share * along
    return True, abs(images[-1] - source) / 2.0


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


@pytest.mark.parametrize('n', [3, 4, 5, 7])
def test_every_audible_path_is_traced(n):
    scene = random_scene(11, n)
    vertices, _ = sorted_walls(scene.vertices)
    sequences = [sequence for order in (1, 2, 3) for sequence in itertools.product(range(n), repeat=order)
                 if all(a != b for a, b in itertools.pairwise(sequence))]
    for position in scene.positions[::15]:
        expected = {}
        for sequence in sequences:
            heard, half = audible(vertices, position, sequence)
            if heard:
                expected[sequence] = half
        half, walls, hits = traced(vertices, position, 3, 100.0)
        found = {tuple(row[:count]): d for row, count, d in zip(walls.tolist(), hits, half, strict=True)}
        assert found.keys() == expected.keys()
        np.testing.assert_allclose([found[key] for key in expected], list(expected.values()), atol=1e-9)
        assert all(np.all(row[count:] == -1) for row, count in zip(walls, hits, strict=True))


def test_paths_end_with_the_range(triangle):
    vertices, _ = sorted_walls(triangle)
    images = visible_images(vertices, (0.5, 0.3), 5)
    half, walls, hits = traced(vertices, (0.5, 0.3), 5, 0.8)
    near = images.distance_m <= 1.6
    assert 0 < near.sum() < len(near)
    order = np.argsort(half, kind='stable')
    np.testing.assert_allclose(half[order], images.distance_m[near] / 2.0, atol=1e-12)
    np.testing.assert_array_equal(np.sort(hits), np.sort(images.order[near]))
    rows = {tuple(row) for row in walls.tolist()}
    assert rows == {tuple(row) for row in images.walls[near].tolist()}


def distances(lines, position, order):
    """Half the length of each audible path by the lines it hits, through `visible_images`."""
    vertices, which = half_plane_polygon(lines)
    images = visible_images(vertices, position, order)
    return {tuple(which[row[:count]]): d / 2.0
            for row, count, d in zip(images.walls, images.order, images.distance_m, strict=True)}


@pytest.mark.parametrize('n', [3, 5, 8])
def test_derivatives_are_those_of_the_images_distances(n):
    scene = random_scene(13, n)
    vertices, lines = sorted_walls(scene.vertices)
    step, compared, orders = 1e-6, 0, set()
    for position in scene.positions[::25]:
        half, walls, hits = traced(vertices, position, 5, 100.0)
        analytic = np.zeros((len(half), n, 2))
        for m in range(len(half)):
            out = np.empty((5, 2))
            path_derivatives(lines, *position, walls[m], hits[m], out)
            np.add.at(analytic[m], walls[m, :hits[m]], out[:hits[m]])
        for wall, axis in itertools.product(range(n), range(2)):
            moved = [lines.copy(), lines.copy()]
            moved[0][wall, axis] -= step
            moved[1][wall, axis] += step
            before, after = (distances(each, position, 5) for each in moved)
            for m in range(len(half)):
                key = tuple(walls[m, :hits[m]])
                if key in before and key in after:  # one at the end of its wall may be heard on one side only
                    difference = (after[key] - before[key]) / (2.0 * step)
                    assert analytic[m, wall, axis] == pytest.approx(difference, abs=2e-6)
                    compared += 1
                    orders.add(len(key))
    assert compared > 200
    assert orders == {1, 2, 3, 4, 5}
