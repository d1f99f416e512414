"""``solver.method: evidence``: the polygon whose predicted echoes explain what was heard."""

import dataclasses
from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import Caution
from polymap_ros.geometry.lines import feet_on_edges, mirrored_lines, wrapped
from polymap_ros.geometry.outline import corners_of, half_plane_polygon
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.checkpoint import Checkpoint, Stopped, unwatched
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate
from polymap_ros.solvers.evidence import wording
from polymap_ros.solvers.evidence.certainty import Certainty, certainty_of
from polymap_ros.solvers.evidence.cut_off import is_cut_off, unheard_corners
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.dead_reckoning import as_dead_reckoned
from polymap_ros.solvers.evidence.drift import Follower, begun
from polymap_ros.solvers.evidence.edge_phase import laws
from polymap_ros.solvers.evidence.first_walls import first_walls
from polymap_ros.solvers.evidence.mirror import AS_LIKELY, mirror_image
from polymap_ros.solvers.evidence.moves.exchange import improved
from polymap_ros.solvers.evidence.moves.start import chosen, start_at
from polymap_ros.solvers.evidence.odometry import OdometryNoise
from polymap_ros.solvers.evidence.path import known, path_cautions, trajectory_of
from polymap_ros.solvers.evidence.proposals import Candidates
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.spacing import apart_m, reach_m
from polymap_ros.solvers.evidence.tracking import Chain, Track
from polymap_ros.solvers.evidence.tuning import EXPLAINED
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.map_verdict import MIN_PINGS, straight_path, too_few_pings
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.solver import Evidence
from polymap_ros.solvers.straightness import path_axis, path_half_width

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

_MENDED = 3
"""Edges that may be exchanged or added by trying all lines."""

_ALONE, _SPARSE = 2.0, 0.5
"""Times the range that is listened to which lie between a ping and the nearest other one: no place is heard by two; no
wall is told from an echo of another one."""

_LOCATED = 0.1
"""Share of that range which the deviation of a wall may have that counts as certain."""

CERTAIN = 0.9
"""Likelihood from which an edge counts as certain."""

_REHEARSED = 40
"""Checkpoints after which the kernels of a solve have all been used."""


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
        self._untracked = False  # poses were tried, and none found
        self._other: Found | None = None

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return what cannot be found again from the evidence: the poses, as arrays."""
        return self._drift.state()

    def restore(self, state: Mapping[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        self._drift = Follower.restored(state)

    def solve(self, evidence: Evidence, checkpoint: Checkpoint = unwatched) -> Estimate:
        """Return the polygon that explains the echoes that are kept, or what is certain where none does."""
        snapshot = Snapshot.of(evidence)
        kept = sum(1 for sounding in evidence.soundings if sounding.echo.size)
        if kept < MIN_PINGS:
            return Estimate('open', 'evidence', snapshot.stamp_ns, cautions=(too_few_pings(kept),))
        reported, heard = search_of(evidence, self._parameters, checkpoint), evidence.all_places.count
        chain = self._chain(evidence, reported)
        straight = _straight(snapshot)
        checkpoint()
        search, found, track = self._found(reported, chain, heard, evidence)
        self._last = found
        doubt = 0.0 if _misheard(evidence) else search.uncertainty
        if found is None or found.value <= 0.0 or found.explained < TOO_LITTLE - doubt:
            return self._open(snapshot, evidence, search, chain, straight)
        found, other = self._doubted(search, found, heard)
        joint = known(track.with_found(found), chain) if track else None
        certainty = certainty_of(search, found, joint.walls if joint else None)
        if straight and (min(certainty.likelihood) < CERTAIN or self._gap(search, certainty, found)):
            return self._open(snapshot, evidence, search, chain, straight)
        answer = self._conclude(snapshot, evidence, search, found, certainty, straight)
        if track and joint:
            path = trajectory_of(track, chain, joint)
            answer = dataclasses.replace(
                answer, trajectory=path, cautions=(*answer.cautions, *path_cautions(path, chain)))
        if answer.polygon is None or other is None:
            return answer
        second = polygon_of(other, certainty_of(search, other), search.data.positions)
        return _ambiguous(answer, answer.polygon, second)

    def _chain(self, evidence: Evidence, reported: Search) -> Chain:
        """What the odometry says of the pings whose echoes are kept."""
        return Chain.of([sounding for sounding in evidence.soundings if sounding.echo.size], reported.data,
                        OdometryNoise.assumed(self._parameters.slam))

    def _found(
        self, reported: Search, chain: Chain, heard: int, evidence: Evidence
    ) -> tuple[Search, Found | None, Track | None]:
        """The last answer refined while it explains the echoes, or until there is more to go by; else a new search.

        With it the search over the pings where they were found to be, and their track where they were not where the
        odometry says. Pings that are too far apart are not worth more than one start, nor are poses looked for then, or
        where ranges may be off by a factor.
        """
        apart = _apart(evidence)
        in_vain = apart or _misheard(evidence)
        enough = EXPLAINED + _CLEARLY - reported.uncertainty / 3.0
        track = None
        if self._drift.on:
            self._last = self._last or self._drift.found(reported, chain)
            track = self._drift.again(reported, chain, self._last)
        search, best = reported, self._last
        if track is not None:
            search, best = track.search, track.found
        elif best is not None:
            best = reported.again(best)
        if heard < _SEARCH_AGAIN * self._searched or _explains(reported, best, enough):
            return search, best, track
        self._searched = heard
        # Where poses are estimated, nothing is looked for from the reported ones.
        founds = iter((None,)) if self._drift.on else reported.polygons()
        for number, found in enumerate(founds, 1):
            if found is not None and (best is None or found.value > best.value):
                search, best = reported, found
            if number == _TRACKED_AFTER and not in_vain and not _explains(reported, best, enough):
                tracked = self._tracked(reported, chain, best, enough)
                if tracked is not None:
                    search, best, track = tracked
            if apart or _explains(reported, best, enough):
                return search, best, track
        if best is not None and heard >= _SCAN_AGAIN * self._scanned:
            self._scanned = heard
            for _ in range(_MENDED):
                mended = search.mended(best)
                if mended is None:
                    break
                best = mended
        return search, best, track and best and track.with_found(best)

    def _tracked(
        self, reported: Search, chain: Chain, found: Found | None, enough: float
    ) -> tuple[Search, Found, Track | None] | None:
        """An answer with the poses estimated, too, where that explains more and is needed; None where not."""
        too_few = len(chain.poses) < _TRACKED_FROM or reported.uncertainty > _DROWNED
        if self._parameters.slam.mode == 'off' or too_few or reported.dispersed:
            return None
        track = begun(reported, chain, found)
        self._untracked = track is None
        if track is None or (found is not None and track.found.explained < found.explained + _MORE):
            return None
        unmoved = reported.again(track.found)
        by_chance = _BY_CHANCE * len(chain.poses)
        if unmoved is not None and _explains(reported, unmoved, enough) and (
                unmoved.value > track.found.value - by_chance):
            return reported, unmoved, None  # only the walls were off
        self._drift.keep(track, chain)
        return track.search, track.found, track

    def _doubted(self, search: Search, found: Found, heard: int) -> tuple[Found, Found | None]:
        """The better of the answer and its mirror image, and the other if it is as likely.

        Looks for a missing wall, too, and for both after a search, or when there is more to go by.
        """
        if self._searched > self._doubted_at or heard >= _SEARCH_AGAIN * self._doubted_at:
            self._doubted_at = heard
            self._other = mirror_image(search, found, _leaves_much(search, found))
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

    def _open(
        self, snapshot: Snapshot, evidence: Evidence, search: Search, chain: Chain, straight: list[Caution]
    ) -> Estimate:
        walls = () if _misheard(evidence) else _proven_by_first_echoes(snapshot, evidence, straight)
        heard = [sounding for sounding in evidence.soundings if sounding.echo.size]
        if self._untracked:  # each wall is where the robot thought that it was
            walls = tuple(as_dead_reckoned(wall, heard, chain, search.data.pulse.width_m) for wall in walls)
        pings_apart_m, range_m = apart_m(evidence.all_places), reach_m(heard, search.data.pulse)
        walls = tuple(wall for wall in walls if (wall.r_std or 0.0) < _LOCATED * range_m)
        if pings_apart_m > _SPARSE * range_m:
            caution = wording.far_apart(pings_apart_m, range_m)
        else:
            enclosing = len(half_plane_polygon([(wall.r, wall.theta) for wall in walls])[1]) > 0
            caution = wording.nothing_closes(
                len(walls), enclosing, search.max_edges, heard, search.data.pulse, bool(straight), self._untracked)
        return Estimate('open', 'evidence', snapshot.stamp_ns, walls=walls,
                        cautions=(*straight, caution, *_dispersion(search)))

    def _conclude(
        self, snapshot: Snapshot, evidence: Evidence, search: Search, found: Found, certainty: Certainty,
        straight: list[Caution],
    ) -> Estimate:
        candidate = polygon_of(found, certainty, search.data.positions)
        cautions = straight + self._cautions(search, found, candidate)
        if straight:
            return Estimate('ambiguous', 'evidence', snapshot.stamp_ns, cost=-found.value, cautions=tuple(cautions),
                            alternatives=(candidate, candidate.mirrored(*path_axis(snapshot.positions))))
        if gap := self._gap(search, certainty, found):
            cautions.insert(0, gap)
            walls = tuple(edge for edge, silent in zip(candidate.edges, certainty.silent, strict=True)
                          if edge.likelihood >= CERTAIN and not silent)
            if _leaves_much(search, found):  # and then a wall that is not there may be part of it
                walls = _proven_by_first_echoes(snapshot, evidence, straight)
            return Estimate('open', 'evidence', snapshot.stamp_ns, cost=-found.value, walls=walls,
                            cautions=tuple(cautions))
        return Estimate('closed', 'evidence', snapshot.stamp_ns, candidate, cost=-found.value,
                        iou_free_area=snapshot.region.iou(candidate.vertices), cautions=tuple(cautions))

    def _cautions(self, search: Search, found: Found, candidate: Candidate) -> list[Caution]:
        cautions = []
        weak = [k for k, edge in enumerate(candidate.edges) if edge.likelihood < CERTAIN]
        if weak:
            cautions.append(wording.weak_edges(weak))
        if self._unheard:
            cautions.append(wording.unheard_corners(self._unheard))
        if _leaves_much(search, found):
            cautions.append(wording.unexplained(found.explained, len(found.lines), search.max_edges))
        cautions += _dispersion(search)
        if found.wave is None and search.coherent:
            cautions.append(wording.incoherent())
        return cautions

    def _gap(self, search: Search, certainty: Certainty, found: Found) -> Caution | None:
        """Why the polygon is not closed by what was heard; None if it is."""
        if certainty.unsupported:
            return wording.edges_unheard(certainty.unsupported, len(found.lines))
        if self._cut_off:
            return wording.corner_cut_off()
        _, corners = corners_of(found.lines)
        away = np.linalg.norm(corners[:, None] - search.data.positions[None], axis=2).min(axis=1)
        return wording.corner_too_far(float(np.max(away))) if np.max(away) > search.data.range_max_m else None


def _misheard(evidence: Evidence) -> bool:
    """Whether the samples have their energy elsewhere than the pulse: ranges may be off by a factor."""
    return any(each.code == 'echo_band' for each in evidence.cautions)


def _apart(evidence: Evidence) -> bool:
    """Whether most pings are so far from all others that they hear no place that another one hears."""
    assert evidence.pulse is not None, 'the mapper knows its pulse'
    heard = [sounding for sounding in evidence.soundings if sounding.echo.size]
    return apart_m(evidence.all_places) > _ALONE * reach_m(heard, evidence.pulse)


def _explains(search: Search, found: Found | None, enough: float) -> bool:
    """Whether an answer explains so much of the echoes, in phase where they have one."""
    return found is not None and found.explained > enough and (found.wave is not None or not search.coherent)


def _leaves_much(search: Search, found: Found) -> bool:
    """Whether strong echoes are left unexplained."""
    return found.explained < EXPLAINED - search.uncertainty


def search_of(evidence: Evidence, parameters: Parameters, checkpoint: Checkpoint = unwatched) -> Search:
    """A search over the pings whose echoes are kept."""
    assert evidence.pulse is not None, 'the mapper knows its pulse'
    heard = [sounding for sounding in evidence.soundings if sounding.echo.size]
    sensor = parameters.sensor
    data = EchoData.of(heard, evidence.pulse, parameters.medium.spreading, parameters.echo.blanking_m,
                       (sensor.baseline_x_m, sensor.baseline_y_m, sensor.baseline_z_m))
    generator = np.random.default_rng(parameters.solver.seed)
    coherent = parameters.echo.kind == 'rf'
    dispersed = not coherent and parameters.medium.model == 'lamb_a0'
    edges = laws(parameters.medium)
    return Search(data, parameters.solver.max_edges, generator, coherent, dispersed, checkpoint, edges)


def rehearse(evidence: Evidence, parameters: Parameters) -> None:
    """Improve and settle a square about the pings, whatever they heard: every compiled kernel is used."""
    steps = iter(range(_REHEARSED))

    def enough() -> None:
        if next(steps, None) is None:
            raise Stopped

    search = search_of(evidence, parameters, enough)
    start_at(search, 1.0)
    middle, half = search.data.positions.mean(axis=0), search.data.extent_m
    walls = Walls.of_polygon(middle + half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]))
    square = search.nothing.with_strength(1.0).with_walls(walls)
    chosen(search, Candidates(walls.lines, np.ones(len(walls))), 1.0, iterations=4)
    with suppress(Stopped):
        improved(search, square, 1, np.empty((0, 2)), residual=True)
        search.settle(square)
    search.judge(square)
    first_walls(search.data.positions, np.full(len(search.data.positions), half), search.data.pulse.width_m)
    Snapshot.of(evidence).region.iou(corners_of(walls.lines)[1])


def _dispersion(search: Search) -> list[Caution]:
    return [wording.dispersion()] if search.dispersed else []


def _proven_by_first_echoes(snapshot: Snapshot, evidence: Evidence, straight: list[Caution]) -> tuple[Edge, ...]:
    """The walls that first echoes prove, whatever polygon the others may be of."""
    heard = [sounding for sounding in evidence.soundings if sounding.echo.size]
    assert evidence.pulse is not None, 'the mapper knows its pulse'
    walls = first_walls(np.array([(sounding.x, sounding.y) for sounding in heard]),
                        np.array([sounding.rho for sounding in heard]), evidence.pulse.width_m)
    middle, along = path_axis(snapshot.positions)
    return tuple(wall for wall in walls
                 if wall.likelihood >= CERTAIN and not (straight and _has_two_sides(wall, middle, along)))


def _has_two_sides(wall: Edge, middle: NDArray[np.float64], along: NDArray[np.float64]) -> bool:
    """Whether a wall's mirror image about a path is another wall, by more than two standard deviations."""
    (_, theta), = mirrored_lines([(wall.r, wall.theta)], middle, along)
    return float(abs(wrapped(theta - wall.theta))) > 2.0 * (wall.theta_std or 0.0)


def _straight(snapshot: Snapshot) -> list[Caution]:
    width = path_half_width(snapshot)
    return [] if width is None else [straight_path(snapshot, width)]


def _ambiguous(answer: Estimate, one: Candidate, other: Candidate) -> Estimate:
    return dataclasses.replace(answer, status='ambiguous', polygon=None, iou_free_area=None, alternatives=(one, other),
                               cautions=(wording.mirror_image(), *answer.cautions))


def polygon_of(found: Found, certainty: Certainty, positions: NDArray[np.float64]) -> Candidate:
    """The polygon found, with what is known of every edge."""
    lines = found.lines
    _, corners = corners_of(lines)
    pings = feet_on_edges(corners, positions)
    deviations = np.sqrt(np.diag(certainty.covariance)).reshape(-1, 2)
    edges = tuple(
        Edge(float(r), float(theta), float(certainty.likelihood[k]), float(deviations[k, 0]), float(deviations[k, 1]),
             int(pings[k]), float(certainty.covariance[2 * k, 2 * k + 1]))
        for k, (r, theta) in enumerate(lines))
    return Candidate(corners, edges, certainty.covariance)

