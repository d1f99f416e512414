"""Odometry that drifts: walls and poses from nothing but the echoes and what wheels tell of the way."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain as chained
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import FARTHEST_M
from polymap_ros.solvers.evidence.imaged import imaged_track
from polymap_ros.solvers.evidence.odometry import NOISIER, SLIP
from polymap_ros.solvers.evidence.rejoining import behind, rejoined
from polymap_ros.solvers.evidence.ring_windows import ring_windows
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tracking import (
    CONSISTENT,
    SURE,
    Chain,
    Track,
    anchored,
    followed,
    judged_track,
    mended,
    refined,
    sifted,
)
from polymap_ros.solvers.evidence.tuning import EXPLAINED
from polymap_ros.solvers.evidence.whereabouts import FEWEST
from polymap_ros.solvers.evidence.windows import by_all_orders, in_phase, windows

_LOOKED_FOR, _PLACED = 6, 3
"""A window's walls have to place so many of the first pings beside it, or it is another window's turn."""

_SLIPS_AT_MOST, _SLIPS_SO_FAR = 0.03, 0.1
"""Shares of the steps that may be slips, beside one: a mirror image of the walls takes every turn for one. A ping that
was taken for elsewhere makes two, until it is looked for again."""

_LEAST = 3
"""Pings with a pose from which others are placed."""

_AGAIN = 3
"""Steps by which an answer is refined with the pings that came since."""

_NOISY_M = 0.012
"""How far positions are looked for that are off from ping to ping, as those of an optical system may be [m]."""

_ROUGHLY = 0.6
"""Share of the echoes' power that walls have to explain from the reported poses to be right but for these: where
positions are off by 5 mm it is 0.88 to 0.91, at the level `typical` 0.07 to 0.33 in plates of four edges and more (even
seeds)."""

_MOST = 0.8
"""Share of the pings that are placed, at least."""

_ENOUGH_TRACKS = 3
"""Tracks of most of the pings after which no other window is asked: what all of them leave is something else."""

_IN_PHASE_ALL_ALONG = 0.8
"""Share explained from which an answer that is in phase over all pings says that they are within a fraction of a cycle
of where they were reported: what it leaves is told by no other window."""


class Follower:
    """The poses of pings whose odometry drifts, kept from solve to solve, so that later ones join them."""

    def __init__(self, poses: Mapping[int, NDArray[np.float64]] = MappingProxyType({})) -> None:
        self._poses = dict(poses)  # by stamp
        self._looked_ns = 0  # stamp of the newest ping when lost ones were looked for elsewhere

    @property
    def on(self) -> bool:
        """Whether poses are estimated; once they are, they stay so."""
        return bool(self._poses)

    def again(self, search: Search, chain: Chain, last: Found | None) -> Track | None:
        """Return the last walls, refined with the pings of today, of which the new ones are placed between them."""
        known = self._known(chain)
        if last is None or len(known) < _LEAST:
            return None
        # The cells may be others today.
        like = search.between(last.storey, last.power.strength).nothing.with_walls(last.walls)
        poses = self._poses_of(known, chain)
        track = refined(search, chain.as_found(known, poses), last._replace(power=like), known, poses, _AGAIN)
        if track is None:
            return None
        *_, whole = (track, *followed(search, chain, track))
        whole = anchored(self._rejoined(search, chain, whole), chain)
        self.keep(whole, chain)
        return whole

    def _rejoined(self, search: Search, chain: Chain, track: Track) -> Track:
        """Look for the newest pings elsewhere, where they are lost; again with as many more as that takes at least."""
        fresh = int(np.sum(np.array(chain.stamps_ns) > self._looked_ns))
        if min(fresh, len(behind(track, chain))) < FEWEST:
            return track
        self._looked_ns = chain.stamps_ns[-1]
        return rejoined(search, chain, track)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return the poses, as arrays."""
        poses = np.array([*self._poses.values()], float).reshape(-1, 3)
        return {'stamps_ns': np.array([*self._poses], np.int64), 'poses': poses}

    @classmethod
    def restored(cls, state: Mapping[str, NDArray[np.generic]]) -> 'Follower':
        """Return what `state` gave."""
        stamps, poses = np.asarray(state['stamps_ns'], np.int64), np.asarray(state['poses'], float)
        if stamps.ndim != 1 or poses.shape != (len(stamps), 3) or not np.all(np.abs(poses) <= 2.0 * FARTHEST_M):
            raise StateError('the estimated poses are not those of a robot')
        return cls(dict(zip(stamps.tolist(), poses, strict=True)))

    def found(self, search: Search, chain: Chain) -> Found | None:
        """Return the walls heard from the poses that are known, where the walls are not."""
        known = self._known(chain)
        if len(known) < _LEAST:
            return None
        over = search.over(search.data.chosen(known).at(self._poses_of(known, chain)))
        found = (each for each in over.polygons() if each is not None)
        return next((each for each in found if each.explained > EXPLAINED - search.uncertainty), None)

    def _known(self, chain: Chain) -> NDArray[np.int64]:
        return np.array([number for number, stamp in enumerate(chain.stamps_ns) if stamp in self._poses], np.int64)

    def _poses_of(self, known: NDArray[np.int64], chain: Chain) -> NDArray[np.float64]:
        return np.array([self._poses[chain.stamps_ns[number]] for number in known])

    def keep(self, track: Track, chain: Chain) -> None:
        """Keep the poses of a track for the next solve."""
        stamps = [chain.stamps_ns[number] for number in track.pings]
        self._poses = dict(zip(stamps, track.poses, strict=True))


def begun(
    search: Search, chain: Chain, found: Found | None, rings: bool = False, first: Sequence[Track] = ()
) -> Track | None:
    """Return walls and poses, given what was found from the reported ones; None where no window of the pings closes.

    `rings` says whether outlines that need not be convex are looked for, where no convex one closes; `first` holds
    windows that are known.
    """
    if found is not None and found.wave is not None and found.explained > _IN_PHASE_ALL_ALONG:
        track = refined(search, chain, found, np.arange(len(chain.poses)), chain.poses)
        track = None if track is None else mended(search, chain, track, (), 0.0)
    else:
        track = _from_all(search, chain, found) or tracked(
            search, chain, chained(first, _all_windows(search, chain, rings)))
    if track is None:
        return None
    track = rejoined(search, chain, sifted(search, chain, track))
    as_found = chain.as_found(track.pings, track.poses)
    if as_found.noise != chain.noise:
        track = refined(search, as_found, track.found, track.pings, track.poses) or track
    return anchored(track, chain)


def _all_windows(search: Search, chain: Chain, rings: bool) -> Iterator[Track]:
    """Give what windows lead to, and where it may be so, those between outlines that need not be convex."""
    if (yield from windows(search, chain)) and rings:
        yield from ring_windows(search, chain)


def _from_all(search: Search, chain: Chain, found: Found | None) -> Track | None:
    """Return the track from walls that are right by power as reported, where poses are off by millimetres each."""
    if found is None or not search.coherent or found.explained < _ROUGHLY - search.uncertainty:
        return None
    track = in_phase(search, chain, judged_track(search, found, np.arange(len(chain.poses)), chain.poses), _NOISY_M)
    if track is None:
        return None
    track = mended(search, chain, track)  # one ping that is left elsewhere may take a twentieth of all echoes
    explains = track.found.explained > EXPLAINED - search.uncertainty
    return track if explains and track.consistency.min() > CONSISTENT else None


def _worth(track: Track) -> float:
    """Pings that are placed, as far as they are explained."""
    return len(track.pings) * min(track.found.explained, 1.0)


def tracked(search: Search, chain: Chain, begun_in: Iterable[Track]) -> Track | None:
    """Return the walls of windows that place the most pings, with these; None where no window of them closes."""
    best: Track | None = None
    whole = 0
    for window in begun_in:
        track = _extended(search, chain, window)
        whole += track is not None and len(track.pings) >= _MOST * len(chain.poses)
        if track is not None and (best is None or _worth(track) > _worth(best)):
            best = track
        if best and len(best.pings) >= _MOST * len(chain.poses) and (
                whole >= _ENOUGH_TRACKS or best.found.explained > EXPLAINED - search.uncertainty):
            break
    return best


def _extended(search: Search, chain: Chain, window: Track) -> Track | None:
    """Return the track that a window leads to; None where its walls place few other pings, or only by slips.

    Where it goes well for long and then only by slips, the robot was carried away there, and the track ends.
    """
    track, count, until = window, len(chain.poses), len(chain.poses)
    for tried, track in enumerate(followed(search, chain, window), 1):
        if tried >= _LOOKED_FOR and len(track.pings) < len(window.pings) + _PLACED:
            return None
        if _slips(track, chain) > 1 + _SLIPS_SO_FAR * tried:
            track = _without_slips(track, chain)
            until = int(track.pings[-1]) + 1
            *_, track = (track, *followed(search, chain, track, until))
            break
    if len(track.pings) < min(SURE, count // 2):
        return None
    first = 0 if until == count else track.pings[0]
    track = mended(search, chain, track, np.setdiff1d(np.arange(first, until), track.pings))
    if _slips(track, chain) > 1 + _SLIPS_AT_MOST * count:
        return None
    if not search.coherent:  # what a window has of edges too many stays otherwise: on the way phase alone changes edges
        track = by_all_orders(search, chain, track)
    return imaged_track(search, chain, track, EXPLAINED - search.uncertainty)


def _without_slips(track: Track, chain: Chain) -> Track:
    """Return the longest part of a track without a slip."""
    ends = np.concatenate(([0], np.flatnonzero(_is_slip(track, chain)) + 1, [len(track.pings)]))
    longest = int(np.argmax(np.diff(ends)))
    inside = np.arange(len(track.pings))
    return track.of((inside >= ends[longest]) & (inside < ends[longest + 1]))


def _slips(track: Track, chain: Chain) -> int:
    return int(np.sum(_is_slip(track, chain)))


def _is_slip(track: Track, chain: Chain) -> NDArray[np.bool_]:
    odometry = chain.between(track.pings).loosened(track.poses, NOISIER)
    return np.asarray(odometry.squares(track.poses) > SLIP)
