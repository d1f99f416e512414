"""From what the search has found to the answer: a polygon and what is certain of it, or the walls that are proven."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import Caution
from polymap_ros.geometry.lines import feet_on_edges, mirrored_lines, wrapped
from polymap_ros.geometry.outline import corners_of, half_plane_polygon, ring_corners
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall
from polymap_ros.solvers.evidence import wording
from polymap_ros.solvers.evidence.certainty import Certainty, certainty_of
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.dead_reckoning import as_dead_reckoned
from polymap_ros.solvers.evidence.first_walls import first_walls
from polymap_ros.solvers.evidence.round_echoes import RoundHoles
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.spacing import apart_m, reach_m
from polymap_ros.solvers.evidence.tracking import Chain
from polymap_ros.solvers.evidence.tuning import EXPLAINED
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.solver import Evidence
from polymap_ros.solvers.straightness import path_axis

CERTAIN = 0.9
"""Likelihood from which an edge counts as certain."""

_SPARSE = 0.5
"""Times the range that is listened to which lie between a ping and the nearest other one: no wall is told from an echo
of another one."""

_SUGGESTIVE = 0.6
"""Share of the echoes that an outline which is not convex has to explain to be told of where nothing closes."""

_ROUND_EDGES = 16
"""Edges of the polygon in the place of a round hole: it is within 1.3 % of the radius."""

_SLIGHT_RAD = float(np.deg2rad(6.0))
"""Corners that turn by less, two or more in a row, are told: chords of a wall with a radius of 20 m turned by 2 to 4
degrees each (one plate), and such corners are seldom cut on purpose."""

_LOCATED = 0.1
"""Share of that range which the deviation of a wall may have that counts as certain."""


@dataclass(frozen=True, eq=False)
class Findings:
    """What an answer is made of.

    Parameters
    ----------
    evidence, snapshot
        What was heard, and where.
    search : Search
        Over the echoes that are kept, at the places where the pings are taken to be.
    straight : tuple of Caution
        That the path is too straight to tell walls from their mirror images; empty where it is not.
    untracked : Chain, optional
        What the odometry says, where no poses explain the echoes.
    unsure_ring : Found, optional
        The best outline that is not convex, where it explains more than a convex one and leaves much, too.
    cut_off : bool
        Whether a wall may be missing that cuts off a corner.
    unheard : mapping of int to float
        Corners that no echo has been near, and how much may be missing there [m].
    """

    evidence: Evidence
    snapshot: Snapshot
    search: Search
    straight: tuple[Caution, ...]
    untracked: Chain | None
    unsure_ring: Found | None = None
    cut_off: bool = False
    unheard: Mapping[int, float] = dataclasses.field(default_factory=dict)

    def open(self) -> Estimate:
        """Return the walls that first echoes prove, where no polygon explains enough."""
        search, heard = self.search, self.evidence.heard
        walls = () if misheard(self.evidence) else self._proven_by_first_echoes()
        if self.untracked is not None:  # each wall is where the robot thought that it was
            walls = tuple(as_dead_reckoned(wall, heard, self.untracked, search.data.pulse.width_m) for wall in walls)
        pings_apart_m, range_m = apart_m(self.evidence.all_places), reach_m(heard, search.data.pulse)
        walls = tuple(wall for wall in walls if (wall.r_std or 0.0) < _LOCATED * range_m)
        if pings_apart_m > _SPARSE * range_m:
            caution = wording.far_apart(pings_apart_m, range_m)
        else:
            enclosing = len(half_plane_polygon([(wall.r, wall.theta) for wall in walls])[1]) > 0
            caution = wording.nothing_closes(len(walls), enclosing, search.max_edges, heard, search.data.pulse,
                                             bool(self.straight), self.untracked is not None)
        return Estimate('open', 'evidence', self.snapshot.stamp_ns, walls=walls,
                        cautions=(*self.straight, caution, *self._of_ring(), *_dispersion(search)))

    def concluded(self, found: Found, other: Found | None, with_poses: NDArray[np.float64] | None) -> Estimate:
        """Return the polygon found, with its deviations; what is proven where it is not closed by what was heard.

        Parameters
        ----------
        found, other : Found
            The polygon, and its mirror image where that is as likely.
        with_poses : ndarray, shape (2 n, 2 n), optional
            The covariance of the lines of `found` where the poses are estimated, too.
        """
        certainty = certainty_of(self.search, found, with_poses)
        if _has_hole_of_one_wall(found.walls, certainty):
            return self.open()
        gap = self._gap(certainty, found)
        if self.straight and (gap or min(certainty.likelihood) < CERTAIN):
            return self.open()
        candidate = _curved(_ring(found.lines, 0, certainty, self.search.data.positions), found.walls, certainty)
        cautions = (*self.straight, *self._cautions(found, certainty))
        radius_m, radius_std_m = certainty.corner_radius
        answer = Estimate('open', 'evidence', self.snapshot.stamp_ns, cost=-found.value, cautions=cautions,
                          storey=found.storey, corner_radius=radius_m, corner_radius_std=radius_std_m)
        if self.straight:
            mirrored = candidate.mirrored(*path_axis(self.snapshot.positions))
            return dataclasses.replace(answer, status='ambiguous', alternatives=(candidate, mirrored))
        if gap:
            return dataclasses.replace(answer, cautions=(gap, *cautions),
                                       walls=self._proven(found, candidate, certainty))
        if other is not None:
            second = _ring(other.lines, 0, certainty_of(self.search, other), self.search.data.positions)
            return dataclasses.replace(answer, status='ambiguous', alternatives=(candidate, second),
                                       cautions=(wording.as_likely_mirrored(), *cautions))
        holes = (*_holes(found, certainty, self.search.data.positions),
                 *_round_holes(self.search.round_holes, self.search.data.positions))
        overlap = self.snapshot.region.iou(candidate.vertices, [hole.vertices for hole in holes])
        return dataclasses.replace(answer, status='closed', polygon=candidate, iou_free_area=overlap, holes=holes,
                                   inner_walls=_inner_walls(found, certainty, self.search.data))

    def _cautions(self, found: Found, certainty: Certainty) -> list[Caution]:
        cautions = []
        weak = [name for name, likelihood in zip(_names(found.walls), certainty.likelihood, strict=True)
                if likelihood < CERTAIN]
        if weak:
            cautions.append(wording.weak_edges(weak))
        if self.unheard:
            cautions.append(wording.corners_unheard(self.unheard))
        if leaves_much(self.search, found):
            cautions.append(wording.unexplained(found.explained, len(found.lines), self.search.max_edges))
        if len(certainty.curvature_std):
            _, corners = corners_of(found.lines)
            cautions.append(wording.curved_edges(found.walls.curvature, certainty.curvature_std, corners))
        if run := found.walls.slight_run(_SLIGHT_RAD):
            cautions.append(wording.as_a_curve(run))
        if certainty.corner_radius[0]:
            cautions.append(wording.rounded_corners(*certainty.corner_radius))
        cautions += _dispersion(self.search)
        if found.wave is None and self.search.coherent:
            cautions.append(wording.incoherent())
        return cautions

    def _of_ring(self) -> list[Caution]:
        ring = self.unsure_ring
        if ring is None or ring.explained < _SUGGESTIVE:
            return []
        return [wording.not_convex(ring.explained, len(ring.lines), len(ring.walls.interior.holes))]

    def _gap(self, certainty: Certainty, found: Found) -> Caution | None:
        """Why the polygon is not closed by what was heard; None if it is."""
        if certainty.unsupported:
            return wording.edges_unheard(certainty.unsupported, len(found.lines))
        unlikely = int(np.sum(certainty.likelihood[:len(found.lines)] < 1.0 - CERTAIN))
        if unlikely and leaves_much(self.search, found):
            return wording.edges_unlikely(unlikely, len(found.lines))
        if self.cut_off:
            return wording.corner_cut_off()
        _, corners = corners_of(found.lines)
        away = np.linalg.norm(corners[:, None] - self.search.data.positions[None], axis=2).min(axis=1)
        return wording.corner_too_far(float(np.max(away))) if np.max(away) > self.search.data.range_max_m else None

    def _proven(self, found: Found, candidate: Candidate, certainty: Certainty) -> tuple[Edge, ...]:
        """The walls that are certain of a polygon that is not closed."""
        if leaves_much(self.search, found):  # a wall that is not there may be part of it
            return self._proven_by_first_echoes()
        return tuple(edge for edge, silent in zip(candidate.edges, certainty.silent[:len(candidate.edges)], strict=True)
                     if edge.likelihood >= CERTAIN and not silent)

    def _proven_by_first_echoes(self) -> tuple[Edge, ...]:
        """The walls that first echoes prove, whatever polygon the others may be of."""
        heard, pulse = self.evidence.heard, self.search.data.pulse
        walls = first_walls(np.array([(sounding.x, sounding.y) for sounding in heard]),
                            np.array([sounding.rho for sounding in heard]), pulse.width_m)
        middle, along = path_axis(self.snapshot.positions)
        return tuple(wall for wall in walls
                     if wall.likelihood >= CERTAIN and not (self.straight and _has_two_sides(wall, middle, along)))


def _names(walls: Walls) -> list[str]:
    """What walls are called in pictures and reports: by number, those of hole 0 H0.0 and so on, inner walls W0."""
    holes, spans = walls.interior
    return [*(str(edge) for edge in range(walls.ring)),
            *(f'H{hole}.{edge}' for hole, count in enumerate(holes.tolist()) for edge in range(count)),
            *(f'W{wall}' for wall in range(len(spans)))]


def _has_hole_of_one_wall(walls: Walls, certainty: Certainty) -> bool:
    """Whether one wall of a hole is certain at most: it may be a wall of the outline, whose corner is not there."""
    ends = walls.ring + np.cumsum(walls.interior.holes)
    likelihoods = np.split(np.asarray(certainty.likelihood), np.append(walls.ring, ends))[1:-1]
    return any(np.sum(likelihood >= CERTAIN) < 2 for likelihood in likelihoods)


def misheard(evidence: Evidence) -> bool:
    """Whether the samples have their energy elsewhere than the pulse: ranges may be off by a factor."""
    return any(each.code == 'echo_band' for each in evidence.cautions)


def leaves_much(search: Search, found: Found) -> bool:
    """Whether strong echoes are left unexplained."""
    return found.explained < EXPLAINED - search.uncertainty


def _dispersion(search: Search) -> list[Caution]:
    return [wording.dispersion()] if search.dispersed else []


def _has_two_sides(wall: Edge, middle: NDArray[np.float64], along: NDArray[np.float64]) -> bool:
    """Whether a wall's mirror image about a path is another wall, by more than two standard deviations."""
    (_, theta), = mirrored_lines([(wall.r, wall.theta)], middle, along)
    return float(abs(wrapped(theta - wall.theta))) > 2.0 * (wall.theta_std or 0.0)


def _ring(
    lines: NDArray[np.float64], first: int, certainty: Certainty, positions: NDArray[np.float64], around: float = 1.0
) -> Candidate:
    """The outline or a hole, whose walls are those from the first on, with what is known of every edge."""
    _, corners = ring_corners(lines, 0.0, around)
    own = slice(2 * first, 2 * (first + len(lines)))
    pings, covariance = feet_on_edges(corners, positions, in_front=True), certainty.covariance[own, own]
    edges = tuple(_edge(line, first + k, certainty, int(pings[k])) for k, line in enumerate(lines))
    return Candidate(corners, edges, covariance)


def _curved(straight: Candidate, walls: Walls, certainty: Certainty) -> Candidate:
    """Return a polygon with the curvatures of its edges, where they have any."""
    edges = list(straight.edges)
    for k in np.flatnonzero(walls.curvature[:len(edges)]):
        edges[k] = dataclasses.replace(edges[k], curvature=float(walls.curvature[k]),
                                       curvature_std=float(certainty.curvature_std[k]))
    return dataclasses.replace(straight, edges=tuple(edges))


def _edge(line: NDArray[np.float64], wall: int, certainty: Certainty, pings: int) -> Edge:
    both = certainty.covariance[2 * wall:2 * wall + 2, 2 * wall:2 * wall + 2]
    r_std, theta_std = np.sqrt(np.diag(both)).tolist()
    r, theta = line.tolist()
    return Edge(r, theta, float(certainty.likelihood[wall]), r_std, theta_std, pings, float(both[0, 1]))


def _holes(found: Found, certainty: Certainty, positions: NDArray[np.float64]) -> tuple[Candidate, ...]:
    first, holes = found.walls.ring, []
    for count in found.walls.interior.holes.tolist():
        holes.append(_ring(found.walls.lines[first:first + count], first, certainty, positions, -1.0))
        first += count
    return tuple(holes)


def _round_holes(found: RoundHoles | None, positions: NDArray[np.float64]) -> tuple[Candidate, ...]:
    """Each as a regular polygon of the circle's area, whose edges stand and fall with it."""
    if found is None:
        return ()
    holes, turns = [], 2.0 * np.pi * np.arange(_ROUND_EDGES) / _ROUND_EDGES
    apothem = np.sqrt(np.pi / (_ROUND_EDGES * np.tan(np.pi / _ROUND_EDGES)))  # in radii
    normals = np.column_stack((np.cos(turns), np.sin(turns)))
    for number, (x, y, radius, _) in enumerate(found.circles):
        lines = np.column_stack((normals @ (x, y) - apothem * radius, turns))[::-1]
        _, corners = ring_corners(lines, 0.0, -1.0)
        change = np.zeros((2 * _ROUND_EDGES, 3))
        change[::2] = np.column_stack((normals, np.full(_ROUND_EDGES, -apothem)))[::-1]
        own = slice(4 * number, 4 * number + 3)
        covariance = change @ found.covariance[own, own] @ change.T
        certainty = Certainty(np.ones(_ROUND_EDGES), covariance, np.zeros(_ROUND_EDGES, np.bool_), 0)
        pings = feet_on_edges(corners, positions, in_front=True)
        holes.append(Candidate(corners, tuple(_edge(line, k, certainty, int(pings[k]))
                                              for k, line in enumerate(lines)), covariance))
    return tuple(holes)


def _inner_walls(found: Found, certainty: Certainty, data: EchoData) -> tuple[InnerWall, ...]:
    """Each where its sides are, up to where they meet the outline or a hole."""
    count = len(found.walls.interior.spans)
    _, sides = found.walls.sides(0.0, data.shortest_m)
    told = []
    for k in range(count):
        wall = len(found.walls) - count + k
        row = sides.rows[wall + k]
        along = data.positions @ np.array((-row[1], row[0]))
        told.append(InnerWall(
            row[5:7].copy(), row[7:9].copy(),
            _edge(found.walls.lines[wall], wall, certainty, int(np.sum((along >= row[3]) & (along <= row[4])))),
            float(found.walls.reflection[wall]), float(found.walls.interior.spans[k, 2])))
    return tuple(told)
