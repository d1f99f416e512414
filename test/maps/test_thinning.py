"""The choice of pings whose echoes are kept: against its rule played by hand, bounded, spread, and kept by a state."""

import dataclasses
import io

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps.thinning import KEPT_PINGS, Thinning
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import Recipe, random_scene

ECHO, ENVELOPE = np.ones(4, np.complex64), np.ones(2, np.float32)
QUICK = Parameters().replaced({'grid.range_step_m': 0.02, 'grid.angle_step_deg': 10.0, 'grid.range_max_m': 1.0})


def thinned(places):
    """Indices of the echoes kept after each of the places was added in turn."""
    thinning, soundings = Thinning(), []
    for index, (x, y) in enumerate(places):
        thinning.add(soundings, Sounding(index, x, y, ECHO, ENVELOPE, 1.0))
    return [sounding.stamp_ns for sounding in soundings]


def by_hand(places):
    """The rule in words: of the two kept that are closest the newest goes, or the one with a third closer by."""
    kept = []

    def distances(index):
        return sorted((np.hypot(*(places[index] - places[other])), other) for other in kept if other != index)

    for newest in range(len(places)):
        kept.append(newest)
        if len(kept) > KEPT_PINGS:
            first = min(kept, key=lambda index: (distances(index)[0], index))
            pair = first, distances(first)[0][1]
            kept.remove(newest if newest in pair else min(pair, key=lambda index: (distances(index)[1][0], -index)))
    return kept


def random_walk(count, seed=0):
    steps = np.random.default_rng(seed).normal(scale=0.05, size=(count, 2))
    return np.cumsum(steps, axis=0)


@pytest.mark.parametrize('places', [
    random_walk(125), np.random.default_rng(1).uniform(size=(125, 2)), np.repeat(random_walk(65), 2, axis=0),
    np.zeros((110, 2))], ids=['walk', 'uniform', 'twice', 'standing'])
def test_one_of_the_closest_two_gives_way(places):
    assert thinned(places) == by_hand(places)


def spiral():
    angle = np.linspace(0.0, 6.0 * np.pi, 1000)  # three turns, ever slower
    return np.column_stack((np.cos(angle), np.sin(angle))) * np.linspace(1.0, 0.2, 1000)[:, None]


def steady():
    return np.column_stack((np.linspace(0.0, 10.0, 1000), np.zeros(1000)))


@pytest.mark.parametrize('places', [
    spiral(), spiral()[::-1], np.vstack((spiral()[:500], spiral()[:500] + 1e-6)), steady(),
    steady() + np.random.default_rng(0).normal(scale=1e-3, size=(1000, 2)),
    random_scene(5, 6, Recipe(pings=1000)).positions], ids=['slower', 'faster', 'again', 'steady', 'shaken', 'legs'])
def test_a_thousand_pings_keep_as_many_as_fit_and_these_are_spread(places):
    kept = thinned(places)
    assert len(kept) == KEPT_PINGS == 96
    gaps = np.hypot(*(places[:, None] - places[kept]).T)  # from the kept ones to all
    among = gaps[:, kept] + np.where(np.eye(KEPT_PINGS), np.inf, 0.0)
    assert gaps.min(axis=0).max() < 1.5 * among.min()  # every place has one near, and these are not near each other


def test_standing_still_does_not_forget_where_the_robot_was():
    way = random_walk(60, seed=3)
    kept = thinned(np.vstack((way, np.tile(way[-1] + 1e-4, (500, 1)))))
    assert set(range(60)) <= set(kept)
    assert len(kept) == KEPT_PINGS


def test_few_pings_are_all_kept():
    assert thinned(random_walk(KEPT_PINGS)) == list(range(KEPT_PINGS))


def circling(mapper, first, last):
    noise = np.random.default_rng(0).normal(size=(last, 256)).astype(np.float32)
    for i in range(first, last):
        angle = 0.05 * i
        mapper.add_pose(10**8 * i, Pose(0.2 * np.cos(angle), 0.2 * np.sin(angle)))
        mapper.add_ping(Ping(10**8 * i, noise[i], 1e-6))


def echoes(mapper):
    return [(sounding.stamp_ns, sounding.echo.tobytes(), sounding.envelope.tobytes(), sounding.noise)
            for sounding in mapper.soundings]


def test_a_saved_map_keeps_and_goes_on_to_keep_the_same_echoes():
    whole, first = PolygonMapper(QUICK), PolygonMapper(QUICK)
    circling(whole, 0, 150)
    circling(first, 0, 120)
    assert (len(first.soundings), first.places.count) == (KEPT_PINGS, 120)
    file = io.BytesIO()
    np.savez(file, **first.state())
    file.seek(0)
    with np.load(file, allow_pickle=False) as saved:
        assert saved['soundings.echoes'].shape[0] == KEPT_PINGS
        second = PolygonMapper.from_state(QUICK, dict(saved))
    assert echoes(second) == echoes(first)
    circling(second, 120, 150)
    assert echoes(second) == echoes(whole)
    assert dataclasses.astuple(second.counts) == dataclasses.astuple(whole.counts)
