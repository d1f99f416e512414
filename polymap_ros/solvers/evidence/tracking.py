"""Walls and poses together: from a few pings that walls explain to all of them, and back over the odometry's drift.

A short window of pings is solved first, in which odometry errs by little (`windows`). Its walls place the next ping,
forwards and backwards; now and then walls and poses are refined together and the edges looked at anew.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.poses import between, in_frame, onward
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.solvers.evidence.climb import climb
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.likelihood import S
from polymap_ros.solvers.evidence.localisation import Fix, Localiser, Prior
from polymap_ros.solvers.evidence.odometry import SLIP, Increments, OdometryNoise
from polymap_ros.solvers.evidence.odometry_found import odometry_found
from polymap_ros.solvers.evidence.power import PowerLikelihood
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.trajectory import Joint, JointLikelihood, World
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, FULL_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import WaveformLikelihood

CONSISTENT, FOUND = 0.85, 0.6
"""Shares of what a ping should be worth: below the first it is looked for again, below the second it is lost."""

_KNOWN_M = 1e-3
"""Deviation of a position of a track, for what is expected of its neighbour [m]: a tenth of it is noise, and the rest
is that of walls that are still to be refined."""

SURE, _NEAR_M = 16, 0.04
"""Pings of a track from which a ping is looked for all over the place, and how far before [m]: walls that are wrong
place no ping, which takes long to find out."""

_ASTRAY = 4
"""Pings lost in a row from which dead reckoning is not followed further."""

_SOBER = 3
"""Steps of a climb without slips: headings, which odometry alone tells, are linear in it."""

_ANOTHER_CYCLE = 0.25
"""Cycles of range by which a wall is moved that was in another cycle: by half a one, or more."""

_REFINED_EVERY = 12
"""Pings placed from one refinement of walls and poses to the next."""


class Chain(NamedTuple):
    """What the odometry says of the pings of a search.

    Poses (N, 3) in the search's frame, and as reported, in the start frame, with the way driven up to each there
    (N, SUMS; `Odometer.sums`); what errors are assumed, and the pings' stamps.
    """

    poses: NDArray[np.float64]
    reported: NDArray[np.float64]
    way: NDArray[np.float64]
    noise: OdometryNoise
    stamps_ns: tuple[int, ...]

    @classmethod
    def of(cls, soundings: Sequence[Sounding], data: EchoData, noise: OdometryNoise) -> 'Chain':
        """Return what the odometry says of soundings, which `data` holds."""
        bases = (sounding.base for sounding in soundings)
        return cls(data.poses, np.array([(base.x, base.y, base.yaw) for base in bases]),
                   np.array([sounding.way for sounding in soundings]), noise,
                   tuple(sounding.stamp_ns for sounding in soundings))

    def part(self, pings: NDArray[np.int64]) -> 'Chain':
        """Return what it says of some of the pings."""
        return self._replace(poses=self.poses[pings], reported=self.reported[pings], way=self.way[pings],
                             stamps_ns=tuple(self.stamps_ns[ping] for ping in pings))

    def between(self, pings: NDArray[np.int64]) -> Increments:
        """Return the odometry between some of the pings."""
        return Increments.of(self.reported[pings], self.way[pings], self.noise)

    def as_found(self, pings: NDArray[np.int64], poses: NDArray[np.float64]) -> 'Chain':
        """Return the same with the errors that the odometry makes by the poses of some of the pings."""
        return self._replace(noise=odometry_found(self.reported[pings], self.way[pings], self.noise, poses))


class Track(NamedTuple):
    """Walls found by the pings with these numbers, at these poses (n, 3) in the order of time."""

    search: Search
    found: Found
    pings: NDArray[np.int64]
    poses: NDArray[np.float64]
    worths: NDArray[np.float64]

    def with_found(self, found: Found) -> 'Track':
        """Return the same with other walls."""
        return self._replace(found=found)

    def without(self, ping: int) -> 'Track':
        """Return the same without a ping, if it is there."""
        return self.of(self.pings != ping)

    def of(self, some: NDArray[np.bool_]) -> 'Track':
        """Return the same with some of the pings (n,)."""
        return self._replace(pings=self.pings[some], poses=self.poses[some], worths=self.worths[some])

    def with_ping(self, ping: int, fix: Fix) -> 'Track':
        """Return the same with one more ping in its place."""
        at = int(np.searchsorted(self.pings, ping))
        return self._replace(
            pings=np.insert(self.pings, at, ping), poses=np.insert(self.poses, at, fix.pose, axis=0),
            worths=np.insert(self.worths, at, fix.worth))

    @property
    def level(self) -> float:
        """What a ping is worth at its right pose, over its gain [nats]."""
        return float(np.median(self.worths))

    @property
    def consistency(self) -> NDArray[np.float64]:
        """Each ping's worth over the median (n,)."""
        return np.asarray(self.worths / max(self.level, 1e-300))


def judged_track(search: Search, found: Found, pings: NDArray[np.int64], poses: NDArray[np.float64]) -> Track:
    """Return a track of a search over all pings, with what each ping of it is worth."""
    over = search.over(search.data.chosen(pings).at(poses))
    if found.wave is None:
        fitted = over.power.fitted(found.walls, found.power, FULL_ORDER)
        shares = over.power.shares(fitted or found.power)
    else:
        shares = over.wave.shares(found.wave, FULL_ORDER)
    return Track(over, found, pings, poses, shares / over.data.gain)


def refined(
    search: Search, chain: Chain, found: Found, pings: NDArray[np.int64], poses: NDArray[np.float64],
    iterations: int = 6, order: int = FULL_ORDER,
) -> Track | None:
    """Return walls and poses at the nearest maximum of their joint likelihood; the frame stays (`World.frame`).

    That is a pose in the middle: were it the first, whose heading one step alone tells, a wrong one could be put right
    only by a turn of all the others.
    """
    data, odometry = search.data.chosen(pings), chain.between(pings)
    world, power, wave = World(found.walls, poses, odometry, len(poses) // 2), found.power, found.wave
    if wave is not None:
        by_phase = _top(JointLikelihood(WaveformLikelihood, data), Joint(world, wave, -np.inf), order, iterations)
        if by_phase is None:
            return None
        world, wave = by_phase.unknowns, by_phase.heard
    else:
        fitted = search.over(data.at(poses)).power.fitted(found.walls, power, order)
        by_power = None if fitted is None else _top(
            JointLikelihood(PowerLikelihood, data), Joint(world, fitted, -np.inf), order, iterations)
        if by_power is None:
            return None
        world, power = by_power.unknowns, by_power.heard
    better = search.over(data.at(world.poses)).judged(power, wave)
    return None if better is None else judged_track(search, better, pings, world.poses)


def _top(likelihood: JointLikelihood[S], here: Joint[S], order: int, iterations: int) -> Joint[S] | None:
    """Return the nearest maximum of a likelihood over walls and poses.

    A heading that fits neither neighbour would stay so, each taken for a slip: there the climb begins without slips.
    """
    world = here.unknowns
    if np.max(world.odometry.squares(world.poses), initial=0.0) > SLIP:
        sober = replace(here, unknowns=replace(world, odometry=world.odometry.trusted()))
        top = climb(likelihood, sober, order, _SOBER)
        if top is not None:
            here = Joint(replace(top.unknowns, odometry=world.odometry), top.heard, -np.inf)
    return climb(likelihood, here, order, iterations)


def followed(search: Search, chain: Chain, window: Track, until: int | None = None) -> Iterator[Track]:
    """Give the track as it grows from a window to all pings, forwards, then backwards, after each ping.

    Forwards it ends before the ping `until`.
    """
    track, fresh = window, 0
    for backwards in (False, True):
        until = len(chain.poses) if until is None else until
        end = track.pings[0] if backwards else track.pings[-1]
        ahead = np.arange(end - 1, -1, -1) if backwards else np.arange(end + 1, until)
        prior, localiser, astray = None, localiser_of(search, track), 0
        for ping in ahead:
            search.checkpoint()
            placed, prior = _placed_next(track, chain, localiser, int(ping), prior, backwards)
            astray = 0 if placed else astray + 1
            if astray > _ASTRAY:
                break
            if placed is None:
                yield track
                continue
            track = track.with_ping(int(ping), placed)
            fresh += 1
            if fresh >= _REFINED_EVERY:
                track, fresh, prior = improved_track(search, chain, track), 0, None
                localiser = localiser_of(search, track)
            yield track
    if fresh:
        yield improved_track(search, chain, track)


def improved_track(search: Search, chain: Chain, track: Track) -> Track:
    """Return a track with walls and poses refined, and edges changed where the waveform asks for it.

    Walls that are known stay.
    """
    better = refined(search, chain, track.found, track.pings, track.poses)
    if better is None:
        return track
    if better.found.wave is not None and not np.any(better.found.walls.known):
        changed = better.search.changed(better.found.power, better.found.wave)
        if changed is not None and _are_others(changed.walls, better.found.walls, search.cycle_m):
            again = refined(search, chain, changed, better.pings, better.poses)
            better = again or better
    return better


def _are_others(walls: Walls, before: Walls, cycle_m: float) -> bool:
    """Whether walls are not just those before, refined: another number, or one that was in another cycle."""
    if len(walls) != len(before) or walls.ring != before.ring:
        return True
    return bool(np.max(np.abs(walls.lines[:, 0] - before.lines[:, 0])) > _ANOTHER_CYCLE * cycle_m)


def with_inner_walls(search: Search, chain: Chain, track: Track) -> Track:
    """Return a track with walls that stand inside, walls and poses refined with them, where that explains more."""
    found = None if track.found.explained > ALL_EXPLAINED else track.search.with_inner_walls(track.found)
    better = None if found is None else refined(search, chain, found, track.pings, track.poses)
    if better is None or not better.found.walls.let_through or better.found.value < track.found.value:
        return track
    return better


def mended(
    search: Search, chain: Chain, track: Track, lost: Sequence[int] | NDArray[np.int64] = (),
    widest_m: float = np.inf,
) -> Track:
    """Return a track with pings that are not consistent with the others, and some that are lost, looked for anew."""
    bad = track.pings[track.consistency < CONSISTENT]
    changed, localiser = False, localiser_of(search, track)
    away = np.abs(np.subtract.outer(again := np.union1d(bad, lost).astype(np.int64), track.pings)).min(axis=1)
    for ping in again[np.argsort(away, kind='stable')]:  # from the track outwards
        search.checkpoint()
        better = _placed_between(chain, track, localiser, int(ping), widest_m)
        changed, track = changed or better is not track, better
    return improved_track(search, chain, track) if changed else track


def sifted(search: Search, chain: Chain, track: Track) -> Track:
    """Return a track without the pings that fit nowhere, which a window may hold: they are lost."""
    fits = track.consistency >= FOUND
    return track if np.all(fits) else improved_track(search, chain, track.of(fits))


def localiser_of(search: Search, track: Track) -> Localiser:
    """Return what places pings of a search between the walls of a track."""
    found = track.found
    power = track.search.power.fitted(found.walls, found.power, FULL_ORDER)
    return Localiser(search.data, found._replace(power=power or found.power), track.level)


def _placed_next(
    track: Track, chain: Chain, localiser: Localiser, ping: int, last: Prior | None, backwards: bool
) -> tuple[Fix | None, Prior | None]:
    """Place a ping beside the end of a track, whose pose is known as `last` says; with what is known of it then."""
    at = 0 if backwards else len(track.pings) - 1
    prior = _expected(chain, track, at, ping, backwards, last)
    placed = localiser.place(ping, prior, np.inf if len(track.pings) >= SURE else _NEAR_M)
    if placed.worth < FOUND * track.level:
        return None, last
    return placed, Prior(placed.pose, placed.covariance)


def _placed_between(chain: Chain, track: Track, localiser: Localiser, ping: int, widest_m: float) -> Track:
    """Return a track with a ping placed by what each of its neighbours in the track expects, where that is better."""
    rest = track.without(ping)
    after = int(np.searchsorted(rest.pings, ping))
    least = max(float(np.max(track.worths[track.pings == ping], initial=0.0)), FOUND * track.level)
    best = None
    beside = [(number, backwards) for number, backwards in ((after - 1, False), (after, True))
              if 0 <= number < len(rest.pings)]
    beside.sort(key=lambda each: abs(int(rest.pings[each[0]]) - ping))
    for (number, backwards), reach_m in zip(beside, (widest_m, 0.0), strict=False):
        placed = localiser.place(ping, _expected(chain, rest, number, ping, backwards), reach_m)
        if placed.worth > least:
            best, least = placed, placed.worth
    return track if best is None else rest.with_ping(ping, best)


def _expected(chain: Chain, track: Track, number: int, ping: int, backwards: bool, prior: Prior | None = None) -> Prior:
    """Return where a ping is expected by the track's pose of a number, or by `prior` there."""
    neighbour = int(track.pings[number])
    step = chain.between(np.array([ping, neighbour] if backwards else [neighbour, ping]))
    if prior is None:
        turn = float(step.covariance[0, 2, 2])
        prior = Prior(track.poses[number], np.diag((_KNOWN_M**2, _KNOWN_M**2, turn)))
    # Backwards: the place from which it was set out, as seen from where that led.
    increments = between(step.increments, np.zeros((1, 3))) if backwards else step.increments
    return prior.next(onward(prior.pose[None], increments)[0], step.covariance[0], backwards)


def anchored(track: Track, chain: Chain) -> Track:
    """Return a track moved so that its first pose is as the odometry reports it, or leads back to it."""
    there, here = (Pose(*pose.tolist()) for pose in (chain.poses[track.pings[0]], track.poses[0]))
    motion = there.compose(here.inverse())
    poses = in_frame(track.poses, motion)
    return track._replace(
        found=track.found.moved(motion), poses=poses,
        search=track.search.over(track.search.data.at(poses)))
