"""``solver.method: evidence``: the polygon whose predicted echoes explain what was heard."""

import dataclasses
import itertools
from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.conclusion import MIN_PINGS, straight_path
from polymap_ros.mapping.estimate import Candidate, Caution, Edge, Estimate
from polymap_ros.mapping.evidence.certainty import Certainty, certainty_of
from polymap_ros.mapping.evidence.cut_off import is_cut_off, unheard_corners
from polymap_ros.mapping.evidence.data import EchoData
from polymap_ros.mapping.evidence.first_walls import first_walls
from polymap_ros.mapping.evidence.mirror import AS_LIKELY, mirror_image
from polymap_ros.mapping.evidence.moved_pings import MovedPings
from polymap_ros.mapping.evidence.paths import corners_of
from polymap_ros.mapping.evidence.proposals import Candidates
from polymap_ros.mapping.evidence.search import Found, Search
from polymap_ros.mapping.lines import feet_on_edges, half_plane_polygon, mirrored_lines, polygon_lines
from polymap_ros.mapping.snapshot import Snapshot
from polymap_ros.mapping.solver import Evidence
from polymap_ros.mapping.straightness import path_axis, path_half_width
from polymap_ros.parameters import Parameters

EXPLAINED = 0.95
"""Share of the echoes' power that a polygon has to explain, less three standard deviations of what is measured: the
right polygons of random plates explain 0.97 or more; with S0 10 dB below A0 it is 0.91, and most wrong ones less."""

_MARGIN = 0.02
"""So much more has to be explained, less one standard deviation, before the search ends without another start."""

TOO_LITTLE = 0.5
"""A polygon that explains less than this, less the same, is no answer."""

_SEARCH_AGAIN, _SCAN_AGAIN = 1.1, 1.5
"""So many times the pings let a search begin anew that has failed to explain the echoes, and let it try all lines,
which takes seconds: where no convex polygon explains them, the work stays bounded."""

_MOVES_AFTER = 2, 4
"""Starts after which pings are moved: a polygon that two of them find is hardly what is wrong."""

_MENDED = 3
"""Edges that may be exchanged or added by trying all lines."""

CERTAIN = 0.9
"""Likelihood from which an edge counts as certain."""


class EvidenceSolver:
    """Search by annealing and single changes, judged by the likelihoods of `power` and `waveform`.

    The last answer is where the next solve starts: as long as it explains the echoes, it is only refined.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.reset()

    def reset(self) -> None:
        """Forget the last answer."""
        self._last: Found | None = None
        self._searched = self._scanned = 0  # pings at the last search, and when it tried all lines
        self._doubted_at = 0  # pings when a missing wall and a mirror image that is as likely were looked for
        self._cut_off = False
        self._unheard: dict[int, float] = {}  # corners that no echo has been near, and how much may be missing [m]
        self._pings = MovedPings()
        self._other: Found | None = None
        self._work: Generator[None, None, Estimate] | None = None
        self._answer: Estimate | None = None

    def begin(self, evidence: Evidence) -> None:
        """Take the echoes that are kept."""
        self._answer = None
        self._work = self._solve(Snapshot.of(evidence), evidence)

    def advance(self, iterations: int) -> bool:
        """Go on by so many changes of the search."""
        for _ in range(iterations):
            if self._work is None:
                break
            try:
                next(self._work)
            except StopIteration as done:
                self._answer, self._work = done.value, None
        return self._work is None

    def estimate(self) -> Estimate:
        """The answer; ``open`` with the caution `unfinished` while a solve is under way."""
        return self._answer or Estimate('open', 'evidence', cautions=(
            Caution('unfinished', 'the solve is still under way'),))

    def _solve(self, snapshot: Snapshot, evidence: Evidence) -> Generator[None, None, Estimate]:
        kept = sum(1 for sounding in evidence.soundings if sounding.echo.size)
        if kept < MIN_PINGS:
            return Estimate('open', 'evidence', snapshot.stamp_ns, cautions=(Caution(
                'too_few_pings', f'pings that could be used: {kept}; a polygon takes at least {MIN_PINGS}'),))
        reported, heard = search_of(evidence, self._parameters), evidence.all_places.count
        stamps = [sounding.stamp_ns for sounding in evidence.soundings if sounding.echo.size]
        straight = _straight(snapshot)
        yield
        search, found = yield from self._found(reported, stamps, heard)
        self._last = found
        if found is None or found.value <= 0.0 or found.explained < TOO_LITTLE - search.uncertainty:
            return _open(snapshot, evidence, search, straight)
        found, other = yield from self._doubted(search, found, heard)
        certainty = yield from certainty_of(search, found)
        if straight and (min(certainty.likelihood) < CERTAIN or self._gap(search, certainty, found)):
            return _open(snapshot, evidence, search, straight)
        answer = self._conclude(snapshot, evidence, search, found, certainty, straight)
        if answer.polygon is None or other is None:
            return answer
        second = polygon_of(other, (yield from certainty_of(search, other)), search.data.positions)
        return _ambiguous(answer, answer.polygon, second)

    def _found(
        self, reported: Search, stamps: list[int], heard: int
    ) -> Generator[None, None, tuple[Search, Found | None]]:
        """The last answer refined while it explains the echoes, or until there is more to go by; else a new search.

        With it the search over the pings where they were found to be.
        """
        enough = EXPLAINED + _MARGIN - reported.uncertainty / 3.0
        search, best = yield from self._pings.again(reported, stamps, self._last)
        if heard < _SEARCH_AGAIN * self._searched or _explains(reported, best, enough):
            return search, best
        self._searched = heard
        tried = None  # with its pings moved
        for number, start in enumerate(reported.starts(), 1):
            yield
            found = None if start is None else (yield from reported.polygon(start))
            if found is not None and (best is None or found.value > best.value):
                search, best = reported, found
            due = number in _MOVES_AFTER and best is not tried
            if best is not None and due and not _explains(reported, best, enough):
                search, best = yield from self._pings.moved(reported, stamps, search, best, enough)
                tried = best
            if _explains(reported, best, enough):
                return search, best
        if best is not None and heard >= _SCAN_AGAIN * self._scanned:
            self._scanned = heard
            for _ in range(_MENDED):
                mended = yield from search.mended(best)
                if mended is None:
                    break
                best = mended._replace(misplaced_m=best.misplaced_m)
        return search, best

    def _doubted(self, search: Search, found: Found, heard: int) -> Generator[None, None, tuple[Found, Found | None]]:
        """The better of the answer and its mirror image, and the other if it is as likely.

        Looks for a missing wall, too, and for both after a search, or when there is more to go by.
        """
        if self._searched > self._doubted_at or heard >= _SEARCH_AGAIN * self._doubted_at:
            self._doubted_at = heard
            self._other = yield from mirror_image(search, found, _leaves_much(search, found))
            if self._other is not None and self._other.value > found.value:
                self._other = self._other._replace(misplaced_m=found.misplaced_m)
                found, self._other = self._other, found
                self._last = found
            self._cut_off = yield from is_cut_off(search, found)
            self._unheard = yield from unheard_corners(search, found)
        elif self._other is not None:
            self._other = yield from search.again(self._other)
        if self._other is not None and self._other.value < found.value - AS_LIKELY:
            self._other = None
        return found, self._other

    def _conclude(
        self, snapshot: Snapshot, evidence: Evidence, search: Search, found: Found, certainty: Certainty,
        straight: list[Caution],
    ) -> Estimate:
        candidate = polygon_of(found, certainty, search.data.positions)
        cautions = straight + self._cautions(search, found, candidate)
        if straight:
            return Estimate('ambiguous', 'evidence', snapshot.stamp_ns, cost=-found.value, cautions=tuple(cautions),
                            alternatives=(candidate, candidate.mirrored(*path_axis(snapshot.positions))))
        if reason := self._gap(search, certainty, found):
            cautions.insert(0, Caution('not_closed', reason))
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
            cautions.append(Caution('weak_edge', f'the evidence for edge {", ".join(map(str, weak))} is weak'))
        if self._unheard:
            where = ', '.join(f'{corner} (up to {1e3 * depth:.0f} mm of it)'
                              for corner, depth in sorted(self._unheard.items()))
            cautions.append(Caution('unheard_corner', 'no echo has been near corner '
                                    f'{where}: a wall that cuts it off would not have been heard'))
        if _leaves_much(search, found):
            most = self._parameters.solver.max_edges
            cause = ('the outline may not be convex, or something else reflects' if len(found.lines) < most else
                     f'it has all the edges that solver.max_edges allows ({most})')
            cautions.append(Caution('unexplained', f'the polygon explains {max(found.explained, 0.0):.0%} of the '
                                    f"echoes' power; {cause}"))
        cautions += _dispersion(search)
        if found.misplaced_m:
            code, cause = ('misplaced', 'the odometry is noisy')
            if self._pings.drift(search):
                code, cause = ('drift', 'the odometry drifts, or the medium is a little off')
            cautions.append(Caution(code, 'the echoes agree only where the pings are moved by '
                                    f'{1e3 * found.misplaced_m:.1f} mm (standard deviation); {cause}'))
        if found.wave is None and search.coherent:
            cautions.append(Caution('incoherent', 'the echoes do not agree in phase over the path; positions, medium '
                                    'or time zero may be off, and the polygon comes from their power alone'))
        return cautions

    def _gap(self, search: Search, certainty: Certainty, found: Found) -> str:
        """Why the polygon is not closed by what was heard; empty if it is."""
        if certainty.unsupported:
            return f'{certainty.unsupported} of {len(found.lines)} edges that would close the polygon were not heard'
        if self._cut_off:
            return 'echoes are missing that a corner of the polygon would give: a wall that is not heard cuts it off'
        _, corners = corners_of(found.lines)
        away = np.linalg.norm(corners[:, None] - search.data.positions[None], axis=2).min(axis=1)
        if np.max(away) > search.data.range_max_m:
            return f'a corner is {np.max(away):.3g} m away from every ping, beyond what can be heard'
        return ''


def _explains(search: Search, found: Found | None, enough: float) -> bool:
    """Whether an answer explains so much of the echoes, in phase where they have one."""
    return found is not None and found.explained > enough and (found.wave is not None or not search.coherent)


def _leaves_much(search: Search, found: Found) -> bool:
    """Whether strong echoes are left unexplained."""
    return found.explained < EXPLAINED - search.uncertainty


def search_of(evidence: Evidence, parameters: Parameters) -> Search:
    """A search over the pings whose echoes are kept."""
    assert evidence.pulse is not None, 'the mapper knows its pulse'
    heard = [sounding for sounding in evidence.soundings if sounding.echo.size]
    sensor = parameters.sensor
    data = EchoData.of(heard, evidence.pulse, parameters.medium.spreading, parameters.echo.blanking_m,
                       (sensor.baseline_x_m, sensor.baseline_y_m, sensor.baseline_z_m))
    generator = np.random.default_rng(parameters.solver.seed)
    coherent = parameters.echo.kind == 'rf'
    dispersed = not coherent and parameters.medium.model == 'lamb_a0'
    return Search(data, parameters.solver.max_edges, generator, coherent, dispersed)


def rehearse(evidence: Evidence, parameters: Parameters) -> None:
    """Improve and settle a square about the pings, whatever they heard: every compiled kernel is used."""
    search = search_of(evidence, parameters)
    search.start(1.0)
    middle, half = search.data.positions.mean(axis=0), search.data.extent_m
    lines = polygon_lines(middle + half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]))
    square = search.power.initial(1.0).with_lines(lines)
    search.choose(Candidates(lines, np.ones(len(lines))), 1.0, iterations=4)
    steps = itertools.chain(search.improve(square, 1, residual=True), search.settle(square))
    for _ in itertools.islice(steps, 40):
        pass
    search.judge(square)
    first_walls(search.data.positions, np.full(len(search.data.positions), half), search.data.pulse.width_m)
    Snapshot.of(evidence).region.iou(corners_of(square.lines)[1])


def _dispersion(search: Search) -> list[Caution]:
    return [Caution('dispersion', 'magnitudes cannot be freed of the dispersion of a plate: walls may be off by some '
                    'millimetres, more than their deviations say, or be wrong')] if search.dispersed else []


def _open(snapshot: Snapshot, evidence: Evidence, search: Search, straight: list[Caution]) -> Estimate:
    walls, most = _proven_by_first_echoes(snapshot, evidence, straight), search.max_edges
    reason = 'they bound no area'
    if len(walls) > most:
        reason = f'solver.max_edges allows {most}'
    elif len(half_plane_polygon([(wall.r, wall.theta) for wall in walls])[1]):
        reason = 'they bound an area, but no polygon that was found explains the echoes'
    caution = Caution('not_closed', f'walls that are certain: {len(walls)}; {reason}')
    return Estimate('open', 'evidence', snapshot.stamp_ns, walls=walls,
                    cautions=(*straight, caution, *_dispersion(search)))


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
    return float(abs(np.angle(np.exp(1j * (theta - wall.theta))))) > 2.0 * (wall.theta_std or 0.0)


def _straight(snapshot: Snapshot) -> list[Caution]:
    width = path_half_width(snapshot)
    return [] if width is None else [straight_path(width)]


def _ambiguous(answer: Estimate, one: Candidate, other: Candidate) -> Estimate:
    caution = Caution('mirror_image', 'the mirror image about the path explains the echoes as well; drive a turn')
    return dataclasses.replace(answer, status='ambiguous', polygon=None, iou_free_area=None, alternatives=(one, other),
                               cautions=(caution, *answer.cautions))


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

