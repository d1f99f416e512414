"""``solver.method: evidence``: the polygon whose predicted echoes explain what was heard."""

import dataclasses
from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import Caution
from polymap_ros.geometry.storey import Storey
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.checkpoint import Checkpoint, unwatched
from polymap_ros.solvers.estimate import Estimate
from polymap_ros.solvers.evidence import wording
from polymap_ros.solvers.evidence.answer import Findings, leaves_much, misheard
from polymap_ros.solvers.evidence.cut_off import is_cut_off, unheard_corners
from polymap_ros.solvers.evidence.drift import Follower, begun
from polymap_ros.solvers.evidence.echo_spectrum import is_of_another_pulse
from polymap_ros.solvers.evidence.heard_pulse import HeardPulse
from polymap_ros.solvers.evidence.horizon import up_to_sides
from polymap_ros.solvers.evidence.imaged import imaged, imaged_track
from polymap_ros.solvers.evidence.medium_search import FoundMedium, found_medium
from polymap_ros.solvers.evidence.mirror import AS_LIKELY, mirror_image
from polymap_ros.solvers.evidence.odometry import OdometryNoise
from polymap_ros.solvers.evidence.path import known, path_cautions, trajectory_of
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.pulse_windows import own_pulse
from polymap_ros.solvers.evidence.ring_search import may_tell_rings
from polymap_ros.solvers.evidence.round_echoes import RoundHoles
from polymap_ros.solvers.evidence.search import Found, Search, search_of
from polymap_ros.solvers.evidence.spacing import too_far_apart
from polymap_ros.solvers.evidence.standing_inside import as_round_as_before, explains, pierced, with_inside
from polymap_ros.solvers.evidence.storey_heard import storey_heard
from polymap_ros.solvers.evidence.tracking import Chain, Track, with_inner_walls
from polymap_ros.solvers.evidence.tuning import ANOTHER_POLYGON, EXPLAINED
from polymap_ros.solvers.evidence.uneven_medium import UnevenMedium
from polymap_ros.solvers.map_verdict import MIN_PINGS, straight_path, too_few_pings
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.solver import Evidence
from polymap_ros.solvers.straightness import path_half_width

_CLEARLY = 0.02
"""So much more has to be explained, less one standard deviation, before the search ends without another start."""

TOO_LITTLE = 0.5
"""A polygon that explains less than this, less the same, is no answer."""

_SEARCH_AGAIN, _SCAN_AGAIN = 1.1, 1.5
"""So many times the pings let a search begin anew that has failed to explain the echoes, and let it try all lines,
which takes seconds: where no convex polygon explains them, the work stays bounded."""

_TRACKED_AFTER = 1
"""Starts after which poses are estimated, too: an odometry that drifts is the likeliest cause of what the first does
not explain."""

_TRACKED_FROM = 8
"""Pings from which that is tried, a window of them."""

_DROWNED = 0.3
"""Uncertainty of the share explained from which echoes are too weak for a window of them to tell anything."""

_MORE = 0.03
"""Share of the echoes' power that estimated poses have to explain beyond the reported ones: with each pose free, echoes
of a second mode or of a seam are fitted by up to 0.02 more."""

_BY_CHANCE = 2.0
"""Nats per ping that moving it may bring although it is where it was reported: twice the mean of two coordinates'."""

_BETTER = 0.15
"""Share of the echoes' power that an outline which is not convex has to explain beyond a convex one, where neither
explains enough, to end the search: of five outlines that were left open (even seeds) it was 0.16 to 0.25 in four."""

_MENDED = 3
"""Edges that may be exchanged or added by trying all lines."""


class EvidenceSolver:
    """Search by annealing and single changes, judged by the likelihoods of `power` and `waveform`.

    The last answer is where the next solve starts: as long as it explains the echoes, it is only refined.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._last: Found | None = None
        self._searched = self._scanned = 0  # pings at the last search, and when it tried all lines
        self._doubted_at = 0  # pings when a missing wall and a mirror image that is as likely were looked for
        self._cut_off = False
        self._unheard: dict[int, float] = {}  # corners that no echo has been near, and how much may be missing [m]
        self._drift = Follower()
        self._pulse: HeardPulse | None = None  # the one that the echoes have, where that is not the one that was given
        self._medium: UnevenMedium | None = None  # the one that waves have, where that is not the one that was given
        self._waves: FoundMedium | None = None  # what the last search has found so
        self._untracked = False  # poses were tried, and none found
        self._unsure_ring: Found | None = None  # the best outline that is not convex, where it leaves much unexplained
        self._other: Found | None = None
        self._round_holes: RoundHoles | None = None  # of the last answer

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return what cannot be found again from the evidence, the poses and the pulse, as arrays."""
        return self._drift.state() | (self._pulse.state() if self._pulse else {}) | (
            self._medium.state() if self._medium else {})

    def restore(self, state: Mapping[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        self._drift = Follower.restored(state)
        self._pulse = HeardPulse.restored(state) if self._may_adapt else None
        self._medium = UnevenMedium.restored(state)

    def solve(self, evidence: Evidence, checkpoint: Checkpoint = unwatched) -> Estimate:
        """Return the polygon that explains the echoes that are kept, or what is certain where none does."""
        snapshot = Snapshot.of(evidence)
        kept = len(evidence.heard)
        if kept < MIN_PINGS:
            return Estimate('open', 'evidence', snapshot.stamp_ns, cautions=(too_few_pings(kept),))
        nominal = search_of(evidence, self._parameters, checkpoint)
        even = self._pulse.over(nominal) if self._pulse else nominal
        reported = self._medium.over(even, _stamps_ns(evidence)) if self._medium else even
        chain = Chain.of(evidence.heard, reported.data, OdometryNoise.assumed(self._parameters.slam))
        straight = _straight(snapshot)
        checkpoint()
        search, self._last, track = self._found(reported, nominal, chain, evidence)
        self._round_holes = search.round_holes
        chain = chain.as_found(track.pings, track.poses) if track else chain
        findings = Findings(evidence, snapshot, search, straight, chain if self._untracked else None,
                            self._unsure_ring)
        doubt = 0.0 if misheard(evidence) else search.uncertainty
        if self._last is None or self._last.value <= 0.0 or self._last.explained < TOO_LITTLE - doubt:
            return findings.open()
        found, other = self._doubted(search, self._last, evidence.all_places.count)
        findings = dataclasses.replace(findings, cut_off=self._cut_off, unheard=self._unheard)
        joint = known(track.with_found(found), chain) if track else None
        answer = findings.concluded(found, other, joint.walls if joint else None)
        if self._pulse is not None:
            answer = dataclasses.replace(answer, cautions=(*answer.cautions, wording.pulse_adapted(found.explained)))
        by_first_echoes = leaves_much(search, found) or bool(straight and answer.status == 'open')
        if self._medium is not None and not by_first_echoes:
            answer = self._medium.seen(answer, snapshot)
        if track is None or joint is None or (straight and answer.status == 'open'):
            return answer
        path = trajectory_of(track, chain, joint)
        return dataclasses.replace(answer, trajectory=path, cautions=(*answer.cautions, *path_cautions(path, chain)))

    def _found(
        self, reported: Search, nominal: Search, chain: Chain, evidence: Evidence
    ) -> tuple[Search, Found | None, Track | None]:
        """The last answer refined while it explains the echoes, or until there is more to go by; else a new search.

        With it the search over the pings where they were found to be, and their track where they were not where the
        odometry says. Pings that are too far apart are not worth more than one start, nor are poses looked for then, or
        where ranges may be off by a factor.
        """
        heard, apart = evidence.all_places.count, too_far_apart(evidence)
        in_vain = apart or misheard(evidence)
        enough = EXPLAINED + _CLEARLY - reported.uncertainty / 3.0
        search, best, track, plain = self._again(reported, chain, enough)
        if heard < _SEARCH_AGAIN * self._searched or explains(reported, best, enough):
            return search, best, track
        self._searched = heard
        if not in_vain and not self._drift.on and (by_own := self._by_own_pulse(nominal, chain, enough)) is not None:
            self._medium = None  # another cause has been found
            return by_own
        self._waves = None
        reported.other_cause = None if in_vain or self._drift.on else partial(self._is_uneven, nominal, evidence)
        # Where poses are estimated, nothing is looked for from the reported ones.
        founds = iter((None,)) if self._drift.on else reported.polygons(*self._storey(reported))
        tried = -np.inf  # what the outline was worth in which inner walls were looked for
        for number, found in enumerate(founds, 1):
            if self._waves is not None:
                return self._waves.search, self._waves.found, None
            better = found is not None and (plain is None or found.value > plain.value)
            if found is not None and better:
                plain = found
                search, best = imaged(reported, found, enough)
                if found.value > tried + ANOTHER_POLYGON:
                    tried = found.value
                    if self._beyond_convex(reported):
                        search, best = with_inside(reported, found, search, best, enough)
            if number == _TRACKED_AFTER and not in_vain and not explains(reported, best, enough):
                if best is not None and reported.has_other_cause(best.power) and self._waves:
                    return self._waves.search, self._waves.found, None
                ringed, ring = self._ring(reported, plain, enough, evidence.free_area.area)
                if explains(reported, ring, EXPLAINED - reported.uncertainty):
                    return ringed, ring, None
                self._unsure_ring = ring
                tracked = self._tracked(reported, chain, plain, enough)
                if tracked is not None:
                    search, best, track = tracked
                    plain = best
                elif _tells_more(ring, best):  # no convex one will do
                    return search, best, None
            elif better and best is not None and number > _TRACKED_AFTER and self._beyond_convex(reported):
                search, best = pierced(reported, plain or best, search, best, enough)
            if apart or explains(reported, best, enough):
                return search, best, track
        best = best and self._mended(search, best, heard)
        return search, best, track and best and track.with_found(best)

    def _again(
        self, reported: Search, chain: Chain, enough: float
    ) -> tuple[Search, Found | None, Track | None, Found | None]:
        """The last answer refined, with its search and track as in `_found`, and its outline by all that was heard."""
        if self._drift.on:
            self._last = self._last or self._drift.found(reported, chain)
            if (track := self._drift.again(reported, chain, self._last)) is not None:
                track = imaged_track(reported, chain, track, enough)
                return track.search, track.found, track, None
        plain = self._last and reported.again(self._last)
        if plain is None:
            return reported, None, None, None
        search, best = as_round_as_before(
            reported, plain, *imaged(reported, plain, enough), self._round_holes, enough)
        return search, best, None, plain

    def _mended(self, search: Search, found: Found, heard: int) -> Found:
        """The answer with edges exchanged or added by trying all lines, where there is more to go by than last time."""
        if heard < _SCAN_AGAIN * self._scanned:
            return found
        self._scanned = heard
        for _ in range(_MENDED):
            mended = search.mended(found)
            if mended is None:
                break
            found = mended
        return found

    def _beyond_convex(self, search: Search) -> bool:
        """Whether outlines that are not convex, or have something inside, are asked for and can be found."""
        return may_tell_rings(search, self._parameters.solver.outline)

    def _by_own_pulse(
        self, nominal: Search, chain: Chain, enough: float
    ) -> tuple[Search, Found, Track | None] | None:
        """What is found by another pulse, where the echoes' spectrum is not that of the one that was given.

        One that was found before is replaced: it may be told by more pings now.
        """
        if not (self._may_adapt and nominal.coherent and is_of_another_pulse(nominal)):
            return None
        own = own_pulse(nominal, chain, self._beyond_convex(nominal), self._may_track(nominal))
        if own is None:
            return None
        self._pulse = own.pulse
        if own.track is None:
            return own.search, own.found, None
        return self._kept(own.pulse.over(nominal), chain, own.track, enough)

    def _is_uneven(self, nominal: Search, evidence: Evidence, begun: Power) -> bool:
        """Whether walls in a medium that is not even explain the echoes."""
        even = self._pulse.over(nominal) if self._pulse else nominal
        self._waves = found_medium(even, begun, _stamps_ns(evidence))
        self._medium = self._waves.medium if self._waves else self._medium
        return self._waves is not None

    @property
    def _may_adapt(self) -> bool:
        """Whether nobody says that the pulse is right."""
        return self._parameters.pulse.adapt == 'auto' and self._parameters.pulse.kind != 'file'

    def _storey(self, reported: Search) -> tuple[Storey, float]:
        """Floor and ceiling that all pings hear, of a room, and the strength of their echoes; a plate has none."""
        in_room = self._parameters.medium.model == 'constant' and reported.coherent
        return storey_heard(reported.data) if in_room else (Storey(), 0.0)

    def _ring(
        self, reported: Search, convex: Found | None, enough: float, area_m2: float
    ) -> tuple[Search, Found | None]:
        """The best outline that need not be convex, from the reported poses, None where there is none, with the search
        over what images can explain.
        """
        search, best, worth = reported, None, -np.inf
        if not self._beyond_convex(reported):
            return search, best
        heard, data = reported, up_to_sides(reported.data, area_m2)
        if data is not reported.data:
            heard = reported.over(data)
            convex = convex and heard.again(convex)
        for ring in heard.not_convex(convex):
            if ring.value > worth:
                worth = ring.value
                search, best = imaged(heard, ring, enough)
            if explains(reported, best, enough):
                break
        return search, best

    def _may_track(self, search: Search) -> bool:
        """Whether poses may be estimated, and echoes are enough to tell them."""
        enough = len(search.data.positions) >= _TRACKED_FROM and search.uncertainty <= _DROWNED
        return self._parameters.slam.mode != 'off' and enough and not search.dispersed

    def _tracked(
        self, reported: Search, chain: Chain, found: Found | None, enough: float
    ) -> tuple[Search, Found, Track | None] | None:
        """An answer with the poses estimated, too, where that explains more and is needed; None where not."""
        if not self._may_track(reported):
            return None
        if found is None or len(found.storey):
            reported = reported.between(*self._storey(reported))
        track = begun(reported, chain, found, self._beyond_convex(reported))
        if track is not None and self._beyond_convex(reported):
            track = with_inner_walls(reported, chain, imaged_track(reported, chain, track, enough))
        self._untracked = track is None
        if track is None or (found is not None and track.found.explained < found.explained + _MORE):
            return None
        return self._kept(reported, chain, track, enough)

    def _kept(self, reported: Search, chain: Chain, track: Track, enough: float) -> tuple[Search, Found, Track | None]:
        """An answer with the poses of a track, kept for the next solve, or without them, if only the walls were off."""
        unmoved, by_chance = reported.again(track.found), _BY_CHANCE * len(chain.poses)
        if unmoved and explains(reported, unmoved, enough) and unmoved.value > track.found.value - by_chance:
            return reported, unmoved, None
        self._drift.keep(track, chain)
        return track.search, track.found, track

    def _doubted(self, search: Search, found: Found, heard: int) -> tuple[Found, Found | None]:
        """The better of the answer and its mirror image, and the other if it is as likely.

        Looks for a missing wall, too, and for both after a search, or when there is more to go by.
        """
        if self._searched > self._doubted_at or heard >= _SEARCH_AGAIN * self._doubted_at:
            self._doubted_at = heard
            self._other = mirror_image(search, found, leaves_much(search, found))
            if self._other is not None and self._other.value > found.value:
                found, self._other = self._other, found
                self._last = found
            self._cut_off = is_cut_off(search, found)
            self._unheard = unheard_corners(search, found)
        elif self._other is not None:
            self._other = search.again(self._other)
        if self._other is not None and self._other.value < found.value - AS_LIKELY:
            self._other = None
        return found, self._other


def _tells_more(ring: Found | None, convex: Found | None) -> bool:
    """Whether an outline that is not convex explains so much more than a convex one that this is not to be mended."""
    return ring is not None and ring.explained > (0.0 if convex is None else convex.explained) + _BETTER


def _stamps_ns(evidence: Evidence) -> NDArray[np.int64]:
    return np.array([sounding.stamp_ns for sounding in evidence.heard])


def _straight(snapshot: Snapshot) -> tuple[Caution, ...]:
    width = path_half_width(snapshot)
    return () if width is None else (straight_path(snapshot, width),)
