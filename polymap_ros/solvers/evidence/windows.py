"""The first walls under odometry that drifts: from a short window of pings, in which it errs by little."""

import dataclasses
from collections.abc import Generator, Iterator
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.imaged import imaged_track
from polymap_ros.solvers.evidence.moves.exchange import improved
from polymap_ros.solvers.evidence.moves.start import starts
from polymap_ros.solvers.evidence.phase_lock import locked
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.proposals import first_strength, strongest_lines
from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.evidence.tracking import Chain, Track, mended, refined
from polymap_ros.solvers.evidence.tuning import BY_POWER, DIFFERENT, FULL_ORDER, POOL, SEARCH_ORDER, WEAK_ECHOES

_SIZES = 12, 8, 24
"""Pings of a window. At the level `bad`, of eight plates with five to eight edges (even seeds), three windows of ten
are solved of 12 and 24 pings, and two of ten of 8."""

_STARTS_OF_ONE, _STARTS_OF_WEAK_ECHOES, _ROUNDS = 2, 4, 6
"""Starts of a window, those where echoes are weak, and rounds of search by power and of moving its poses with them:
walls that are right move the poses, from which others are heard. Of 18 plates at the level `typical` and -10 dB (even
seeds) windows of 15 are solved by four starts, of 13 by two."""

STEPS = 12
"""Steps of a climb by power, whose damping takes some to find its size."""

BLUR = 0.75
"""How far power is blurred first, in widths of the pulse: walls and poses are found from farther away. Of 90 windows at
the level `bad` (even seeds) 22 are solved, and 11 without."""

FOOT_LIMITS = -2.0, 8.0
"""Nats that one ping of a few may bring for or against a wall. Without, one strong echo holds all tangents of its
circle above the walls that several pings hear, and where the odometry is off a wall is missed by some."""

NOT_IN_PHASE = 4
"""Windows that are explained by power and not in phase after which no other is asked: it is not the odometry then. Of
54 plates at the level `bad` (even seeds) none has more than one. The same number counts for `_BLUNT`."""

_BLUNT = 0.7
"""Share that blurred power explains in a window whose walls power itself does not: of 15 plates at the level `bad`
(even seeds) one has four such windows, by the 26th; where the thickness is 20 % off, nearly all are such."""

_MOST_ARE = 3
"""Windows tried, over `NOT_IN_PHASE`, up to which as many that are not in phase say that the walls are convex: where
the thickness is 20 % off they are the first four or five, in an L (even seed) four of 27."""

HOPELESS, SETTLED = 0.35, 0.9
"""Shares of the echoes' power that the walls of a window explain: by power, blurred at first, and in phase."""


def windows(search: Search, chain: Chain) -> Generator[Track, None, bool]:
    """Give what windows of the pings lead to, in phase, in the order in which they are tried.

    Returns whether it may be odometry that drifts between other walls: none has closed, nor do convex walls explain
    many by power.
    """
    closed = False
    out_of_phase = blunt = 0
    for tried, (best, share) in enumerate(windows_by_power(search, chain), 1):
        found = in_phase(search, chain, best) if best and search.coherent else best
        if found is not None:
            closed = True
            yield found
        blunt += best is None and share > _BLUNT
        out_of_phase += best is not None and found is None
        if NOT_IN_PHASE in (out_of_phase, blunt):
            return not closed and tried > _MOST_ARE * NOT_IN_PHASE
    return not closed


def windows_by_power(search: Search, chain: Chain) -> Iterator[tuple[Track | None, float]]:
    """Give walls and poses that explain windows of the pings by power, None where none do, in the order in which they
    are tried, and the share that blurred power explains there.
    """
    count = len(chain.poses)
    for size in _SIZES:
        roughly = []
        for first in range(0, max(count - size, 0) + 1, size // 2):
            best, share = _explained(search, chain, np.arange(first, min(first + size, count)))
            roughly.append(share)
            yield best, share
        if size >= count or max(roughly) < HOPELESS - search.uncertainty:
            break


def _explained(search: Search, chain: Chain, pings: NDArray[np.int64]) -> tuple[Track | None, float]:
    """Return the walls that explain the echoes of a window by power, and its poses; None where none do.

    Beside them stands the share that blurred power explains. The frame is the window's own: walls are told by their
    distance from its middle, of which its pings know.
    """
    share, heard = 0.0, search.data.chosen(pings)
    if _narrow(heard):
        return None, share
    uncertainty = search.over(heard).uncertainty  # of a few pings
    sharp = search.over(dataclasses.replace(search.data, foot_limits=FOOT_LIMITS))
    middle = np.append(chain.poses[pings, :2].mean(axis=0), 0.0)
    best: Track | None = None
    for over in (sharp.over(sharp.data.blurred(BLUR * sharp.width_m)), sharp):
        best = _by_power(over, sharp, chain, pings, chain.poses[pings] - middle, best)
        share = share or (best.found.explained if best else 0.0)
        if best is None or best.found.explained < HOPELESS - uncertainty:
            return None, share
    if best is None or best.found.explained < BY_POWER - uncertainty:
        return None, share
    return mended(search, chain, best), share


def _by_power(
    over: Search, sharp: Search, chain: Chain, pings: NDArray[np.int64], poses: NDArray[np.float64], last: Track | None
) -> Track | None:
    """Return walls and poses by power, from starts of their own or from the last ones; None where nothing closes."""
    odometry, best, value = chain.between(pings), None, -np.inf
    anew = _STARTS_OF_WEAK_ECHOES if sharp.uncertainty > WEAK_ECHOES else _STARTS_OF_ONE
    starts = anew if last is None else 1
    for number in range(starts + _ROUNDS):
        over.checkpoint()
        here = poses if best is None else best.poses
        if number >= starts:
            power = best and _changed(sharp, best)
        elif last is None:
            here, power = poses, _started(over, sharp, pings, poses, number)
        else:
            here, power = last.poses, last.found.power
        track = None if power is None else _refined(over, chain, pings, here, power)
        worth = track.found.value + odometry.log_prior(track.poses) if track else -np.inf
        if worth > value + DIFFERENT:
            best, value = track, worth
        elif number >= starts:
            break
    return best


def _started(
    over: Search, sharp: Search, pings: NDArray[np.int64], poses: NDArray[np.float64], number: int
) -> Power | None:
    """Return walls from a start, proposed by echoes as they are."""
    start = next(islice(starts(sharp.over(sharp.data.chosen(pings).at(poses))), number, None), None)
    if start is None:
        return None
    here = over.over(over.data.chosen(pings).at(poses))
    power = here.nothing.with_strength(start.power.strength).with_walls(start.power.walls)
    return here.by_power(start._replace(power=power))


def _changed(sharp: Search, best: Track) -> Power:
    """Return walls changed where that explains more from the poses of today, by lines from echoes as they are."""
    data = sharp.data.chosen(best.pings).at(best.poses)
    nothing = sharp.over(data).nothing
    pool = strongest_lines(data, nothing.expected, first_strength(data, nothing.expected), POOL).lines
    return improved(best.search, best.found.power, SEARCH_ORDER, pool, residual=True)


def _refined(
    search: Search, chain: Chain, pings: NDArray[np.int64], poses: NDArray[np.float64], power: Power
) -> Track | None:
    """Return walls and poses at the nearest maximum by power."""
    found = search.over(search.data.chosen(pings).at(poses)).judged(power, None)
    return None if found is None else refined(search, chain, found, pings, poses, STEPS, SEARCH_ORDER)


def _narrow(data: EchoData) -> bool:
    """Whether the way is so straight that walls and their mirror images about it give the same echoes."""
    across = max(float(np.linalg.eigvalsh(np.cov(data.positions.T))[0]), 0.0)
    return across < (0.5 * data.pulse.width_m) ** 2


def in_phase(search: Search, chain: Chain, track: Track, widest_m: float = 0.0) -> Track | None:
    """Return the walls and poses settled by the waveform; None where the echoes do not agree.

    First the walls from where the poses are by power, then walls and poses; where that is not enough, each ping is
    locked in phase by itself. Pings are looked for so much farther away than the odometry expects, where they are not
    found.
    """
    track = by_all_orders(search, chain, track)
    settled = track.search.settle(track.found.power)
    if settled is None:
        return None
    found = settled if settled.wave is not None else track.search.judge(settled.power)
    better = None if found is None else refined(search, chain, found, track.pings, track.poses)
    if better is not None and better.found.explained < SETTLED:  # power may leave a pose a cycle off
        better = imaged_track(search, chain, mended(search, chain, better, track.pings, widest_m), SETTLED)
    return if_settled(better) or if_settled(locked(search, chain, track, SETTLED))


def if_settled(track: Track | None) -> Track | None:
    """Return a track whose walls explain its echoes in phase; None where they do not."""
    if track is None or track.found.wave is None or track.found.explained < SETTLED - track.search.uncertainty:
        return None
    return track


def by_all_orders(search: Search, chain: Chain, track: Track) -> Track:
    """Return walls and poses refined by power of all orders: by three, poses are left half a cycle off."""
    track = refined(search, chain, track.found, track.pings, track.poses, STEPS) or track
    changed = improved(track.search, track.found.power, FULL_ORDER, np.empty((0, 2)), residual=True)
    better = track.search.judged(changed, None)
    if better is None or better.value < track.found.value + DIFFERENT:
        return track
    return refined(search, chain, better, track.pings, track.poses, STEPS) or track
