"""Where the pings were used: exact as long as there is room, bounded and near after that, and kept by a state."""

import numpy as np
import pytest

from polymap_ros.errors import StateError
from polymap_ros.maps.visited import MOST, Places


def walk(count):
    return np.cumsum(np.random.default_rng(3).normal(scale=0.01, size=(count, 2)), axis=0)


def rounds(count):
    turn = np.linspace(0.0, 40.0 * np.pi, count)
    shaken = np.random.default_rng(4).normal(scale=1e-3, size=(count, 2))
    return np.column_stack((np.cos(turn), 0.6 * np.sin(turn))) + shaken


def standing(count):
    return np.full((count, 2), 0.3)


def filled(way, places=None, first=0):
    places = places or Places()
    for k, (x, y) in enumerate(way.tolist(), first):
        places.add(100 + k, x, y)
    return places


def same(one, other):
    first, second = one.state(), other.state()
    return all(np.array_equal(first[name], second[name]) for name in first) and one.count == other.count


def test_as_long_as_there_is_room_all_places_are_kept():
    way = walk(MOST)
    places = filled(way)
    assert np.array_equal(places.positions, way)
    assert np.all(places.pings == 1)
    assert (places.count, places.last_ns) == (MOST, 100 + MOST - 1)


@pytest.mark.parametrize('way', [walk, rounds, standing])
def test_a_long_drive_is_bounded_and_no_ping_is_far_from_the_place_that_stands_for_it(way):
    way = way(5 * MOST)
    places = filled(way)
    positions = places.positions
    assert len(positions) == len(places.pings) <= MOST
    assert places.pings.sum() == places.count == len(way)
    away = [np.hypot(*(positions - at).T).min() for at in way[::97]]
    assert max(away) < 0.05 * max(np.ptp(way, axis=0).max(), 1e-6)
    at = [np.flatnonzero(np.all(way == position, axis=1))[0] for position in positions]
    assert at == sorted(at), 'the first ones of their cells, in the order of time'


def test_a_copy_and_a_state_go_on_apart():
    way = rounds(2 * MOST + 500)
    whole, first = filled(way), filled(way[:MOST + 300])
    twin, again = first.copy(), Places()
    again.restore(first.state())
    assert same(again, first)
    filled(way[MOST + 300:], first, MOST + 300)
    assert same(again, twin)
    filled(way[MOST + 300:], again, MOST + 300)
    assert same(again, whole)
    assert same(first, whole)


@pytest.mark.parametrize('rows', [np.ones((3, 2)), np.ones((MOST + 1, 3)), [[0.0, np.nan, 1.0]], [[0.0, 0.0, 0.0]]])
def test_a_damaged_state_is_refused(rows):
    with pytest.raises(StateError, match='places'):
        Places().restore({**Places().state(), 'rows': np.asarray(rows)})
