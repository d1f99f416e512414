"""``slam.mode: localization``: where the robot is in an outline that is known, by the newest pings."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import feet_on_edges, wrapped
from polymap_ros.geometry.outline import corners_of
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.checkpoint import Checkpoint, unwatched
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate
from polymap_ros.solvers.evidence import wording
from polymap_ros.solvers.evidence.odometry import OdometryNoise
from polymap_ros.solvers.evidence.path import known, steps_and_losses, trajectory_of
from polymap_ros.solvers.evidence.rejoining import behind, joined, onward_from
from polymap_ros.solvers.evidence.search import Found, Search, search_of
from polymap_ros.solvers.evidence.tracking import Chain, Track, refined
from polymap_ros.solvers.evidence.walls import KnownWalls
from polymap_ros.solvers.evidence.whereabouts import FEWEST, LOOKED_AT, whereabouts
from polymap_ros.solvers.solver import Evidence, Expected

_WINDOWS = 3
"""Runs of pings by which a place is looked for, one after the other."""

_SAME, _SAME_RAD = 3.0, 0.1
"""Widths of the pulse, and the turn [rad], by which a path may be off from the reported one to count as that: 4 cm of a
plate of a metre, and a thirtieth of all directions, so that by chance it is so for one start in some thousands."""

_AGAIN = 3
"""Steps by which poses are refined with the pings that came since."""


class LocalisingSolver:
    """Finds the first pings between the known walls, then follows; finds the robot anew where it was carried away.

    Poses are kept from solve to solve, by stamp, in a frame in the middle of the outline.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._poses: Mapping[int, NDArray[np.float64]] = {}
        self._last: Found | None = None
        self._expected: Expected | None = None
        self._places: list[Pose] = []  # of the newest ping, where several are as likely
        self._middle = Pose(0.0, 0.0)  # of the outline, in the start frame
        self._looked_ns = 0  # stamp of the newest ping when a place was looked for

    def expect(self, expected: Expected) -> None:
        """Forget where the robot was taken to be; look for it where somebody says it is."""
        self._expected, self._poses, self._looked_ns = expected, {}, 0

    def solve(self, evidence: Evidence, checkpoint: Checkpoint = unwatched) -> Estimate:
        """Return the outline with the path in it; without where the pings fit no place, or several."""
        assert evidence.outline is not None, 'the mapper knows its outline'
        stamp_ns = evidence.all_places.last_ns
        heard = evidence.heard
        if len(heard) < FEWEST:
            return self._nowhere(stamp_ns, evidence, len(heard))
        middle = evidence.outline.vertices.mean(axis=0)
        self._middle = Pose(float(middle[0]), float(middle[1]))
        walls = KnownWalls.of_polygon(evidence.outline.vertices - middle)
        whole = search_of(evidence, self._parameters, checkpoint)
        frame = np.append(middle, 0.0)
        search = whole.over(whole.data.at(whole.data.poses - frame))
        chain = Chain.of(heard, search.data, OdometryNoise.assumed(self._parameters.slam))
        track = self._followed(search, chain) or self._begun(search, chain, walls)
        track = track and self._carried_away(search, chain, walls, track)
        chain = chain.as_found(track.pings, track.poses) if track else chain
        joint = track and known(track, chain)
        if track is None or joint is None:
            return self._nowhere(stamp_ns, evidence, len(heard))
        self._last, self._expected = track.found, None
        self._poses = dict(zip((chain.stamps_ns[ping] for ping in track.pings), track.poses, strict=True))
        path = trajectory_of(track, chain, joint)
        answer = Estimate('closed', 'evidence', stamp_ns, _given(track), cost=-track.found.value,
                          cautions=tuple(steps_and_losses(path, chain)), trajectory=path)
        return answer.moved(self._middle)

    def _followed(self, search: Search, chain: Chain) -> Track | None:
        """Return the last path with what came since; None where there is none, or none of it is kept."""
        pings = np.array([n for n, stamp in enumerate(chain.stamps_ns) if stamp in self._poses], np.int64)
        if self._last is None or not len(pings):
            return None
        poses = np.array([self._poses[chain.stamps_ns[ping]] for ping in pings])
        like = search.nothing.with_strength(self._last.power.strength).with_walls(self._last.walls)
        track = refined(search, chain, self._last._replace(power=like), pings, poses, _AGAIN)
        return track and onward_from(search, chain, track)

    def _begun(self, search: Search, chain: Chain, walls: KnownWalls) -> Track | None:
        """Return a path from where the newest pings that fit are explained; None where none are, or elsewhere, too.

        What failed is tried again with so many more pings as are needed at least.
        """
        if not self._enough_new(chain):
            return None
        for end in range(len(chain.poses), max(len(chain.poses) - _WINDOWS * LOOKED_AT, FEWEST - 1), -LOOKED_AT):
            tracks = self._looked_for(search, chain, walls, np.arange(max(end - LOOKED_AT, 0), end))
            if tracks:
                return onward_from(search, chain, tracks[0]) if len(tracks) == 1 else None
        return None

    def _enough_new(self, chain: Chain) -> bool:
        """Whether so many pings have come since a place was looked for; from now on that is now."""
        if np.sum(np.array(chain.stamps_ns) > self._looked_ns) < FEWEST:
            return False
        self._looked_ns = chain.stamps_ns[-1]
        return True

    def _looked_for(
        self, search: Search, chain: Chain, walls: KnownWalls, pings: NDArray[np.int64]
    ) -> list[Track]:
        expected = self._expected
        if expected is not None:  # as seen from the middle of the outline
            seen = self._middle.inverse().compose(expected.correction).compose(self._middle)
            expected = expected._replace(correction=seen)
        tracks = whereabouts(search, chain, walls, pings, expected)
        as_reported = [track for track in tracks if _is_near(track.poses, chain.poses[track.pings], search.width_m)]
        if len(as_reported) == 1:  # the odometry began where it began for the map
            tracks = as_reported
        self._places = [Pose(*track.poses[-1].tolist()) for track in tracks]
        return tracks

    def _carried_away(self, search: Search, chain: Chain, walls: KnownWalls, track: Track) -> Track:
        """Return a path with the newest pings found elsewhere, where they are lost and fit one place."""
        lost = behind(track, chain)
        if len(lost) < FEWEST or not self._enough_new(chain):
            return track
        tracks = self._looked_for(search, chain, walls, lost[-LOOKED_AT:])
        return onward_from(search, chain, joined(search, track, tracks[0])) if len(tracks) == 1 else track

    def _nowhere(self, stamp_ns: int, evidence: Evidence, pings: int) -> Estimate:
        assert evidence.outline is not None, 'the mapper knows its outline'
        start = evidence.outline.start.compose(self._middle)
        caution = wording.not_localised(pings, FEWEST, [start.compose(place) for place in self._places])
        return Estimate('open', 'evidence', stamp_ns, cautions=(caution,))


def _is_near(poses: NDArray[np.float64], reported: NDArray[np.float64], width_m: float) -> bool:
    away = poses - reported
    return bool(np.max(np.hypot(away[:, 0], away[:, 1])) < _SAME * width_m
                and np.max(np.abs(wrapped(away[:, 2]))) < _SAME_RAD)


def _given(track: Track) -> Candidate:
    """The outline as it was given, with the pings that face each edge."""
    lines = track.found.lines
    _, corners = corners_of(lines)
    feet = feet_on_edges(corners, track.search.data.positions)
    edges = tuple(Edge(float(r), float(theta), 1.0, 0.0, 0.0, int(count))
                  for (r, theta), count in zip(lines, feet, strict=True))
    return Candidate(corners, edges, np.zeros((2 * len(edges), 2 * len(edges))))
