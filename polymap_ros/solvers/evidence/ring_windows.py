"""The first walls of an outline that is not convex under odometry that drifts: from a short window of pings.

As in `windows` power tells walls and poses first, blurred, then as it is: a ring from closed walks, changed from where
the poses are by now as long as that explains more. What it leads to by power is right to a few millimetres or explains
little; each ping is then locked in phase by itself (`phase_lock`).
"""

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.phase_lock import locked
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.ring_search import improved_ring, ring_starts
from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.evidence.square_walls import free
from polymap_ros.solvers.evidence.tracking import Chain, Track, refined
from polymap_ros.solvers.evidence.tuning import BY_POWER, DIFFERENT, SEARCH_ORDER
from polymap_ros.solvers.evidence.windows import BLUR, FOOT_LIMITS, NOT_IN_PHASE, SETTLED, STEPS, if_settled

_RING_SIZES = 16, 12
"""Pings of a window; the second where power explains one of the first. Of three L at the level `typical` (even seeds)
power explains 9 of 18 windows of 16 pings, of which 5 are then in phase, and 8 of 27 of 12, of which 3 are."""

_BEGUN, _RING_ROUNDS, _CHANGES_OF_ONE = 2, 4, 2
"""Rings that a window is begun with, rounds of changes and of moving its poses, and changes of a round."""

_RING_HOPELESS = 0.45
"""Share that is explained by blurred power below which a ring is given up."""


def ring_windows(search: Search, chain: Chain) -> Iterator[Track]:
    """Give what windows of the pings lead to, in phase, in the order in which they are tried."""
    count, out_of_phase, explained = len(chain.poses), 0, False
    for size in _RING_SIZES:
        for first in range(0, count - size + 1, size // 2):
            rough = _by_power(search, chain, np.arange(first, first + size))
            if rough is None:
                continue
            explained, track = True, if_settled(locked(search, chain, rough, SETTLED))
            if track is not None:
                yield track
                continue
            out_of_phase += 1
            if out_of_phase == NOT_IN_PHASE:
                return
        if not explained:
            return


def _by_power(search: Search, chain: Chain, pings: NDArray[np.int64]) -> Track | None:
    """Return the ring that explains the echoes of a window by power, and its poses; None where none does."""
    middle = np.append(chain.poses[pings, :2].mean(axis=0), 0.0)
    sharp = search.over(dataclasses.replace(search.data, foot_limits=FOOT_LIMITS))
    poses, blurred = chain.poses[pings] - middle, sharp.over(sharp.data.blurred(BLUR * sharp.width_m))
    starts, pool = ring_starts(sharp.over(sharp.data.chosen(pings).at(poses)))
    for start in starts[:_BEGUN]:
        track: Track | None = None
        for over, least in ((blurred, _RING_HOPELESS), (sharp, BY_POWER)):
            track = _changed(over, chain, pings, pool, start, poses, track)
            if track is None or track.found.explained < least:
                track = None
                break
        if track is not None:
            return refined(search, chain, track.found, pings, track.poses, STEPS)
    return None


def _changed(
    over: Search, chain: Chain, pings: NDArray[np.int64], pool: NDArray[np.float64], start: Power,
    poses: NDArray[np.float64], last: Track | None,
) -> Track | None:
    """Return ring and poses after rounds of changes of both, from a start or from the last ones."""
    odometry, best, value = chain.between(pings), last, -np.inf
    for _ in range(_RING_ROUNDS):
        over.checkpoint()
        power, here = (start, poses) if best is None else (best.found.power, best.poses)
        ground = over.over(over.data.chosen(pings).at(here))
        like = ground.power.fitted(power.walls, ground.nothing.with_strength(power.strength), SEARCH_ORDER)
        if like is None:
            break
        ring = improved_ring(ground, like, pool, _CHANGES_OF_ONE)
        found = ground.judged(ring.with_walls(free(ring.walls)), None)
        track = None if found is None else refined(over, chain, found, pings, here, STEPS, SEARCH_ORDER)
        worth = track.found.value + odometry.log_prior(track.poses) if track else -np.inf
        if track is None or worth < value + DIFFERENT:
            break
        best, value = track, worth
    return best
