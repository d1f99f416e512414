"""Walls that first echoes prove: real ones only, whatever the path is like."""

import numpy as np
import pytest
import shapely

from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.solvers.evidence.first_walls import first_walls

ROOM = np.array([(1.0, 0.1), (0.7, 1.3), (0.9, 2.9), (0.8, 4.4)])
WIDTH = 0.01


def heard(places):
    """The range of the nearest wall, by shapely."""
    boundary = shapely.Polygon(half_plane_polygon(ROOM)[0]).exterior
    return np.array([boundary.distance(shapely.Point(place)) for place in places])


def off(wall):
    """How far a wall is from the true line that is nearest, in its own deviations."""
    turn = np.angle(np.exp(1j * (wall.theta - ROOM[:, 1])))
    nearest = np.argmin(np.abs(turn) + np.abs(wall.r - ROOM[:, 0]))
    return max(abs(turn[nearest]) / wall.theta_std, abs(wall.r - ROOM[nearest, 0]) / wall.r_std)


def around(count, size=0.5):
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return size * np.column_stack((np.cos(angles), 0.8 * np.sin(angles)))


@pytest.mark.parametrize('seed', range(8))
def test_a_path_around_proves_all_walls(seed):
    generator = np.random.default_rng(seed)
    places = around(60)
    ranges = heard(places) + generator.uniform(-0.3, 0.3, 60) * WIDTH
    walls = [wall for wall in first_walls(places, ranges, WIDTH) if wall.likelihood >= 0.9]
    assert len(walls) == len(ROOM)
    assert max(map(off, walls)) < 3.0
    assert sum(wall.pings for wall in walls) >= 58


def test_a_straight_path_proves_no_side():
    places = np.column_stack((np.linspace(-0.3, 0.3, 30), np.full(30, 0.2)))
    walls = first_walls(places, heard(places), WIDTH)
    assert walls
    assert all(wall.likelihood <= 0.51 for wall in walls if abs(np.sin(wall.theta)) > 0.2)


def test_places_that_repeat_count_once():
    places = around(3)
    assert first_walls(np.repeat(places, 20, axis=0), np.repeat(heard(places), 20), WIDTH) == ()


def test_ranges_by_chance_prove_nothing():
    """Of 50 paths with ranges at random, 90 % at least must not give a wall that is certain."""
    generator = np.random.default_rng(5)
    found = [first_walls(around(30), generator.uniform(0.2, 0.8, 30), WIDTH) for _ in range(50)]
    assert sum(any(wall.likelihood >= 0.9 for wall in walls) for walls in found) <= 5


def test_missing_and_false_ranges_do_no_harm():
    places = around(60)
    ranges = heard(places)
    ranges[::8] = np.nan
    ranges[3] *= 1.5  # its first echo was missed
    ranges[11] *= 0.4  # a false one
    walls = [wall for wall in first_walls(places, ranges, WIDTH) if wall.likelihood >= 0.9]
    assert len(walls) >= len(ROOM) - 1  # the disc that is too large counts against one
    assert max(map(off, walls)) < 3.0


def test_a_range_that_is_off_by_most_of_a_pulse_speaks_for_no_wall():
    places = around(60)
    ranges = heard(places)
    whole = sum(wall.pings for wall in first_walls(places, ranges, WIDTH))
    ranges[7] -= 0.8 * WIDTH
    walls = [wall for wall in first_walls(places, ranges, WIDTH) if wall.likelihood >= 0.9]
    assert sum(wall.pings for wall in walls) == whole - 1
    assert len(walls) == len(ROOM)


@pytest.mark.parametrize('count', [0, 1, 2])
def test_too_few_pings_prove_nothing(count):
    assert first_walls(around(count), np.full(count, 0.3), WIDTH) == ()
