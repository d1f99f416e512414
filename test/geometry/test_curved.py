"""Paths over curved sides, against minimisation over their points and differences of their lengths."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize

from polymap_ros.geometry.outline import corners_of
from polymap_ros.geometry.path_room import CAPACITY, room_for_paths
from polymap_ros.geometry.paths import trace_paths
from polymap_ros.geometry.storey import Storey
from polymap_ros.simulation.bent_edges import BentOutline
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.walls import Walls

SOFT_M, ORDER = 1e-3, 3


def walls_of(seed, edges, curvature):
    """A random plate of which one wall is curved, and a place with the receiver beside the emitter in it."""
    scene = random_scene(seed, edges)
    walls = Walls.of_polygon(scene.vertices)
    _, sides = walls.sides(0.0, 0.0)
    bend = np.column_stack((np.zeros(edges), 0.5 * (sides.rows[:, 3] + sides.rows[:, 4]) + 0.01))
    bend[1, 0] = curvature
    return dataclasses.replace(walls, bend=bend), np.array([*scene.positions[20], *scene.positions[20] + 0.02, 0.1])


def traced(walls, ends, order=ORDER):
    """By the walls hit: half the length, the weight, the slopes and the moves of every path."""
    _, sides = walls.sides(SOFT_M, 0.0)
    paths = room_for_paths(order)
    count = trace_paths(sides, ends, order, 100.0, SOFT_M, True, Storey().images(order), paths)
    assert count < CAPACITY
    found = {}
    for m in range(count):
        hits = paths.hits[m]
        found[tuple(paths.walls[m, :hits])] = (
            paths.half[m], paths.weight[m], paths.slopes[m, :hits].copy(), paths.moves[m].copy())
    return found


def half_of(walls, ends, sequence):
    """Half the length of the shortest way over points of these walls."""
    def whole(along):
        points = [ends[:2]]
        for wall, t in zip(sequence, along, strict=True):
            (r, theta), (curvature, touching) = walls.lines[wall], walls.bend[wall]
            normal = np.array((np.cos(theta), np.sin(theta)))
            points.append((r - 0.5 * curvature * (t - touching) ** 2) * normal + t * np.array((-normal[1], normal[0])))
        return np.hypot(*np.diff(np.array([*points, ends[2:4]]), axis=0).T).sum()
    flat = minimize(whole, walls.bend[list(sequence), 1], method='BFGS', options={'gtol': 1e-10}).fun
    return 0.5 * np.hypot(flat, ends[4])


@pytest.mark.parametrize(('seed', 'edges', 'curvature'), [(2, 4, 0.05), (2, 4, -0.05), (4, 6, 0.02), (6, 8, 0.1)])
def test_half_lengths_are_those_of_the_shortest_ways(seed, edges, curvature):
    walls, ends = walls_of(seed, edges, curvature)
    found = traced(walls, ends)
    for sequence, (half, *_) in found.items():
        assert half == pytest.approx(half_of(walls, ends, sequence), abs=1e-6)
    assert sum(1 in sequence for sequence in found) >= 3


@pytest.mark.parametrize('curvature', [0.05, -0.05])
def test_slopes_are_differences_of_half_lengths(curvature):
    walls, ends = walls_of(2, 5, curvature)
    here, step = traced(walls, ends), 1e-6
    for wall in range(5):
        for axis in range(2):
            sides = []
            for sign in (1.0, -1.0):
                lines = walls.lines.copy()
                lines[wall, axis] += sign * step
                sides.append(traced(walls.on(lines), ends))
            for sequence in here.keys() & sides[0].keys() & sides[1].keys():
                change = (sides[0][sequence][0] - sides[1][sequence][0]) / (2.0 * step)
                slopes = here[sequence][2][np.array(sequence) == wall, axis]
                assert change == pytest.approx(slopes.sum(), abs=2e-4)


def test_moves_are_differences_of_half_lengths():
    walls, ends = walls_of(2, 5, 0.05)
    here, step = traced(walls, ends), 1e-6
    for k in range(4):
        before, after = (traced(walls, ends + sign * step * (np.arange(5) == k)) for sign in (-1.0, 1.0))
        for sequence in here.keys() & before.keys() & after.keys():
            change = (after[sequence][0] - before[sequence][0]) / (2.0 * step)
            assert here[sequence][3][k] == pytest.approx(change, abs=2e-4)


def test_sides_that_hardly_bend_are_straight_ones():
    walls, ends = walls_of(4, 6, 1e-12)
    bent, straight = traced(walls, ends, 5), traced(dataclasses.replace(walls, bend=np.empty((0, 2))), ends, 5)
    assert straight.keys() <= bent.keys()
    assert all(bent[sequence][1] < 1e-6 for sequence in bent.keys() - straight.keys())
    for sequence, (half, weight, slopes, moves) in straight.items():
        for found, expected in zip(bent[sequence], (half, weight, slopes, moves), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize(('seed', 'edges'), [(4, 6), (2, 4)])
def test_round_corners_take_the_ends_of_walls_and_echo_themselves(seed, edges):
    """By another tracer, which begins with the same straight paths only where corners are sharp."""
    scene, radius_m = random_scene(seed, edges), 0.03
    walls = Walls.of_polygon(scene.vertices)
    outline = BentOutline(vertices_of(walls), np.zeros(edges), radius_m)
    rounded = dataclasses.replace(walls, round=np.array((radius_m, 0.0)))
    compared = 0
    for place in scene.positions[::10]:
        _, sides = rounded.sides(1e-9, 0.0)
        paths = room_for_paths(ORDER)
        count = trace_paths(sides, np.array([*place, *place, 0.0]), ORDER, 100.0, 1e-9, True, Storey().images(ORDER),
                            paths)
        amplitudes, ways = outline.paths(place, place, ORDER, np.ones(edges))
        expected = sorted(zip([0.5 * np.hypot(*way.legs.T).sum() for way in ways], np.abs(amplitudes), strict=True))
        found = sorted(zip(paths.half[:count], paths.weight[:count], strict=True))
        np.testing.assert_allclose(found, expected, atol=1e-6)
        compared += np.sum(np.abs(amplitudes) < 0.9)
    assert compared > 3


def vertices_of(walls):
    """Corners before each wall, which begins there."""
    bound, corners = corners_of(walls.lines)
    assert bound
    return corners


def test_corners_that_leave_nothing_of_a_wall_are_none():
    walls = Walls.of_polygon(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 0.5), (0.0, 0.5)]))
    for radius_m, bounds in ((0.2, True), (0.26, False)):
        assert dataclasses.replace(walls, round=np.array((radius_m, 0.0))).sides(1e-3, 0.0)[0] == bounds
