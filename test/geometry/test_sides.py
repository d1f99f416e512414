"""Holes and inner walls: their paths against every sequence of walls, what is no room, derivatives by differences."""

import numpy as np
import pytest
import shapely

from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.path_room import CAPACITY, Paths, room_for_paths
from polymap_ros.geometry.paths import trace_paths
from polymap_ros.geometry.sides import NOTHING, Interior, sides_of
from polymap_ros.geometry.storey import Storey
from polymap_ros.simulation.reflectors import Reflectors, heard_images

OUTLINE = np.array([[0.0, 0.0], [1.5, 0.1], [1.4, 1.2], [0.2, 1.0]])
HOLE = np.array([[0.6, 0.4], [0.55, 0.7], [0.9, 0.75], [0.95, 0.45]])  # clockwise
L_SHAPE = np.array([[0.0, 0.0], [1.5, 0.0], [1.5, 0.6], [0.7, 0.6], [0.7, 1.3], [0.0, 1.3]])
PASSED = 0.8


def with_hole(outline, hole):
    lines = np.vstack((polygon_lines(outline), polygon_lines(hole)))
    return lines, Interior(np.array([len(hole)]), np.empty((0, 3)))


def with_inner(outline, start, end):
    (r, theta), = polygon_lines([start, end])[:1]
    along = [y * np.cos(theta) - x * np.sin(theta) for x, y in (start, end)]
    return (np.vstack((polygon_lines(outline), (r, theta))),
            Interior(np.empty(0, np.int64), np.array([[*along, PASSED]])))


def traced(lines, interior, place, order, soft=1e-9):
    """The paths from a place and back, as `trace_paths` gives them."""
    bound, sides = sides_of(lines, interior, soft)
    assert bound
    paths = room_for_paths(order)
    count = trace_paths(sides, np.array([*place, *place, 0.0]), order, 10.0, soft, True, Storey().images(order), paths)
    assert count < CAPACITY
    return Paths(*(column[:count] for column in paths))


def heard(paths, reflection):
    """Lengths and amplitudes of paths, the shortest first; what is nothing by rounding is left out."""
    walls = np.where(np.arange(paths.walls.shape[1]) < paths.hits[:, None], paths.walls, 0)
    coefficients = np.where(np.arange(paths.walls.shape[1]) < paths.hits[:, None], reflection[walls], 1.0)
    return summed(2.0 * paths.half, paths.weight * coefficients.prod(axis=1))


def summed(lengths, amplitudes):
    """Amplitudes of one length added up: two halves of an echo from a corner are one."""
    nearest = np.argsort(lengths, kind='stable')
    lengths, amplitudes = lengths[nearest], amplitudes[nearest]
    groups = np.concatenate(((0,), np.cumsum(np.diff(lengths) > 1e-6))) if len(lengths) else np.empty(0, int)
    total = np.bincount(groups, amplitudes)
    first = np.array([lengths[groups == group][0] for group in range(len(total))])
    return np.column_stack((first, total))[np.abs(total) > 1e-9]


def places_in(outline, count, seed, hole=None):
    """Places inside an outline, and outside a hole."""
    room, generator, found = shapely.Polygon(outline).buffer(-0.03), np.random.default_rng(seed), []
    room = room if hole is None else room.difference(shapely.Polygon(hole).buffer(0.02))
    while len(found) < count:
        place = generator.uniform(np.min(outline, axis=0), np.max(outline, axis=0))
        if room.contains(shapely.Point(place)):
            found.append(place)
    return found


@pytest.mark.parametrize(('outline', 'start', 'end'), [
    (OUTLINE, (0.5, 0.3), (1.0, 0.9)),  # stands free
    (OUTLINE, (0.7, -0.4), (0.8, 2.0)),  # from wall to wall
    (OUTLINE, (0.4, 0.5), (2.0, 0.6)),  # to one wall
    (L_SHAPE, (0.7, 0.6), (0.7, -0.5)),  # goes on from a corner that points inwards
    (L_SHAPE, (-1.0, 0.27), (2.0, 0.27)),
])
def test_paths_among_an_inner_wall_are_those_of_every_sequence_of_walls(outline, start, end):
    lines, interior = with_inner(outline, start, end)
    reflection = np.append(np.linspace(0.7, 1.0, len(outline)), 0.6)
    reflectors = Reflectors(np.vstack((outline, start)), np.vstack((np.roll(outline, -1, axis=0), end)),
                            reflection, np.append(np.zeros(len(outline)), PASSED))
    for place in places_in(outline, 12, 1):
        images, amplitude = heard_images(reflectors, place, 4)
        expected = summed(np.linalg.norm(images - place, axis=1), amplitude)
        found = heard(traced(lines, interior, place, 4), reflection)
        np.testing.assert_allclose(found, expected, atol=1e-4)


def test_paths_around_a_hole_are_those_of_every_sequence_of_walls():
    lines, interior = with_hole(OUTLINE, HOLE)
    reflection = np.linspace(0.6, 1.0, 8)
    both = np.vstack((OUTLINE, HOLE))
    ends = np.vstack((np.roll(OUTLINE, -1, axis=0), np.roll(HOLE, -1, axis=0)))
    reflectors = Reflectors(both, ends, reflection, np.zeros(8))
    for place in places_in(OUTLINE, 15, 2, HOLE):
        images, amplitude = heard_images(reflectors, place, 4)
        expected = summed(np.linalg.norm(images - place, axis=1), amplitude)
        np.testing.assert_allclose(heard(traced(lines, interior, place, 4), reflection), expected, atol=1e-4)


def test_holes_outside_across_or_counter_clockwise_are_none():
    for hole, valid in ((HOLE, True), (HOLE + (2.0, 0.0), False), (HOLE + (0.6, 0.0), False),
                        (HOLE[::-1], False)):
        assert sides_of(*with_hole(OUTLINE, hole), 1e-3)[0] == valid
    lines, _ = with_hole(OUTLINE, HOLE)
    for by, valid in ((0.1, False), (0.45, True)):  # a second hole that meets the first, and one beside it
        both = np.vstack((lines, polygon_lines(0.5 * (HOLE - HOLE[0]) + HOLE[0] + (by, 0.0))))
        assert sides_of(both, Interior(np.array([4, 4]), np.empty((0, 3))), 1e-3)[0] == valid
    within = np.vstack((lines, polygon_lines(0.3 * (HOLE - HOLE.mean(axis=0)) + HOLE.mean(axis=0))))
    assert not sides_of(within, Interior(np.array([4, 4]), np.empty((0, 3))), 1e-3)[0]


def test_an_inner_wall_ends_where_it_meets_the_outline():
    bound, sides = sides_of(*with_inner(OUTLINE, (0.7, -0.4), (0.8, 2.0)), 0.0)
    assert bound
    ends = sides.rows[4:6, 5:9]
    np.testing.assert_allclose(ends[0], np.roll(ends[1], 2))
    for end, wall in ((ends[0, :2], 0), (ends[0, 2:], 2)):
        c, s, r = sides.rows[wall, :3]
        assert end @ (c, s) == pytest.approx(r)
    assert not sides_of(*with_inner(OUTLINE, (2.0, 0.3), (2.5, 0.9)), 0.0)[0]
    assert not sides_of(*with_inner(OUTLINE, (0.5, 0.3), (0.5, 0.31)), 0.0, 0.05)[0]
    assert sides_of(polygon_lines(OUTLINE), NOTHING, 0.0)[1].convex


@pytest.mark.parametrize(
    'make', [lambda: with_hole(OUTLINE, HOLE), lambda: with_inner(OUTLINE, (0.4, 0.3), (1.2, 0.8))])
def test_slopes_are_differences_of_the_paths(make):
    lines, interior = make()
    step, compared = 1e-6, 0
    for place in ((0.3, 0.3), (1.2, 0.95), (0.35, 0.85), (1.25, 0.4)):
        paths = traced(lines, interior, place, 3, 1e-3)
        keys = [tuple(row) for row in paths.walls.tolist()]
        for number in range(2 * len(lines)):
            moved = lines.copy()
            moved[number // 2, number % 2] += step
            other = traced(moved, interior, place, 3, 1e-3)
            others = [tuple(row) for row in other.walls.tolist()]
            for m, key in enumerate(keys):
                if keys.count(key) != 1 or others.count(key) != 1:
                    continue
                by = sum(paths.slopes[m, level, number % 2] for level in range(paths.hits[m])
                         if paths.walls[m, level] == number // 2)
                change = (other.half[others.index(key)] - paths.half[m]) / step
                assert change == pytest.approx(by, abs=1e-4)
                compared += by != 0.0
    assert compared > 40
