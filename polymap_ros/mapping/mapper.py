"""From echoes and odometry to the polygon: the one way through."""

import dataclasses
from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import Polygon, contains_xy

from polymap_ros.acoustics.pulse import RecordedPulse
from polymap_ros.cautions import Caution, with_those_of_samples
from polymap_ros.errors import UsageError
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.poses import in_frame, onward
from polymap_ros.hearing.listening import Later, at_once
from polymap_ros.mapping.outline import known_outline
from polymap_ros.mapping.path_log import Path
from polymap_ros.mapping.reception import Reception
from polymap_ros.mapping.state import damage_told, packed, unpacked
from polymap_ros.mapping.surroundings import Surroundings, redrawn
from polymap_ros.maps.thinning import KEPT_PINGS
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.checkpoint import Checkpoint, unwatched
from polymap_ros.solvers.estimate import Estimate, Trajectory
from polymap_ros.solvers.evidence.localising import LocalisingSolver
from polymap_ros.solvers.evidence.solver import EvidenceSolver
from polymap_ros.solvers.registry import make_solver
from polymap_ros.solvers.solver import Evidence, Expected, Outline

FOLLOWED = 12
"""Pings from one solve of a replay to the next where poses are estimated: what a window holds, of which each is looked
for where the odometry leads from the one before."""


class PolygonMapper(Reception):
    """Takes poses and pings as they come and answers with the polygon around the sensor.

    Lines, map and free area are kept in the start frame: its origin is the sensor's position at the first used ping,
    its x axis the robot's heading there. Estimates are in the map frame, which is the odometry's at the first used ping
    or begins there (`origin`), or where the mapping plane is not its xy plane, in the coordinates of `plane`.

    Parameters
    ----------
    parameters : Parameters
        Everything but the group `topics`, `map` and `output`.
    recorded_pulse : RecordedPulse or array_like, shape (n,), optional
        That of ``pulse.kind: file``, which it implies; samples are at the pings' sample period.
    later : callable, optional
        Does what the first ping of a length takes longer for; default: at once. Pings wait until it is done, and for
        `go_on`.
    at_most : int, optional
        Pings used in one go; more wait for `go_on`, and so does what comes meanwhile. Default: no limit.
    outline : array_like, shape (n, 2), optional
        With ``slam.mode: localization`` the convex outline in which the robot is, vertices in the map frame [m].

    Raises
    ------
    UsageError
        For an outline that is none, and for ``slam.mode: localization`` without one.

    Attributes
    ----------
    intake : Intake
        Where poses and pings wait for each other.
    places : Places
        Where all pings were used.
    path_log : PathLog
        Where the odometry reported all of them.
    origin : Pose or None
        The map frame in that of the odometry at the first used ping (`slam.map_origin`); None until there was one.
    start_pose : Pose or None
        The start frame in the map frame; None until a ping was used.
    estimate : Estimate or None
        The last finished solve.
    tap : callable
        Is told of every ping that is used, and of the reported pose of the base at its emission.
    placed : callable
        Is told the stamp [ns] of every ping that now has its place in the map.
    """

    def __init__(
        self, parameters: Parameters, recorded_pulse: RecordedPulse | ArrayLike | None = None,
        later: Later = at_once, at_most: int | None = None, outline: ArrayLike | None = None,
    ) -> None:
        self._outline = known_outline(outline) if parameters.localises else None
        super().__init__(parameters, recorded_pulse, later, at_most)

    def __repr__(self) -> str:
        return f'PolygonMapper({self.counts.received} pings, {self.counts.used} used, estimate={self.estimate!r})'

    def reset(self) -> None:
        """Forget everything; the mapper is as new."""
        super().reset()
        self._corrected: Surroundings | None = None  # at estimated places
        self._solved_at = 0  # pings at the last solve
        self.estimate: Estimate | None = None
        self._solver = make_solver(self.parameters)  # a twin may be in the middle of a solve

    def twin(self) -> Self:
        """Return a copy to be solved, saved or drawn in another thread while this one takes what comes.

        It solves with the same solver, so that the next solve starts from its answer; `reset` and `configure` of
        either leave the other alone.
        """
        return super().twin()

    def configure(self, parameters: Parameters) -> None:
        """Take over changed `solver` parameters for solves that begin from now on; others are for a new mapper."""
        self.parameters = parameters
        self._solver = make_solver(parameters)

    @property
    def map_frame(self) -> str:
        """The frame of estimates: `slam.map_frame`, or where that is empty the odometry's as of the first used ping."""
        return self.parameters.slam.map_frame or self.frame_id

    @property
    def map_to_odom(self) -> Pose:
        """The pose of the odometry's frame in the map frame, by the last estimate."""
        path = self.estimate.trajectory if self.estimate else None
        correction = path.map_to_odom if path else Pose(0.0, 0.0)
        return correction.compose((self.origin or Pose(0.0, 0.0)).inverse())

    @property
    def evidence(self) -> Evidence:
        """What a solver may look at."""
        outline = None
        if self._outline is not None:
            start = self.start_pose or Pose(0.0, 0.0)
            outline = Outline(start.inverse().apply(self._outline), start)
        return Evidence(self._kept.all, self.beam_map, self.free_area, self._listener.shape, self.places, outline,
                        self._of_samples)

    @property
    def _of_samples(self) -> tuple[Caution, ...]:
        """What the samples tell by themselves."""
        return (*self._offsets.cautions, *self._lines.cautions,
                *self._band.cautions(self._listener.pulse, self.parameters.pulse.frequency_hz))

    def expect(self, base: Pose, place_m: float, heading_rad: float) -> None:
        """Look for the robot where somebody says that its base is now, give or take so much, in the map frame.

        Raises
        ------
        UsageError
            Where no map is given, outside of it, and before the first ping.
        """
        if self._outline is None or not isinstance(self._solver, LocalisingSolver):
            raise UsageError('a pose is taken in slam.mode: localization only')
        if self.start_pose is None or not len(self.path_log.poses):
            raise UsageError('no ping has come yet, beside which a pose could be said')
        if not contains_xy(Polygon(self._outline), base.x, base.y):
            raise UsageError(f'({base.x:.3f}, {base.y:.3f}) m is outside of the map')
        reported = Pose(*self.path_log.poses[-1].tolist())
        correction = self.start_pose.inverse().compose(base).compose(reported.inverse())
        self._solver.expect(Expected(correction, place_m, heading_rad))

    def solve(self, checkpoint: Checkpoint = unwatched) -> Estimate:
        """Solve from what has been heard so far and return the answer, in the map frame.

        The checkpoint is called between the steps of the work; what comes meanwhile is for the next solve. Where it
        raises `Stopped`, that comes out of here, and `estimate` stays as it is.
        """
        start = self.start_pose or Pose(0.0, 0.0)
        found = self._solver.solve(self.evidence, checkpoint).moved(start)
        self._solved_at, self._corrected = self.counts.used, None
        if (path := found.trajectory) is not None:
            self._corrected = self._redrawn(path.moved(start.inverse()))
            if found.polygon is not None:
                inside = start.inverse().apply(found.polygon.vertices)
                found = dataclasses.replace(found, iou_free_area=self._corrected.free_area.region.iou(inside))
        self._go_by(found)
        cautions = with_those_of_samples(found.status == 'closed', found.cautions, self._of_samples)
        self.estimate = dataclasses.replace(found, cautions=(*cautions, *self._common.cautions))
        return self.estimate

    def adopt(self, twin: 'PolygonMapper') -> None:
        """Take over what a twin has found."""
        self.estimate, self._corrected, self._solved_at = twin.estimate, twin._corrected, twin._solved_at
        if self.estimate is not None:
            self._go_by(self.estimate)

    def _go_by(self, answer: Estimate) -> None:
        """Go on from estimated poses, or from the reported ones where these explain the echoes."""
        path = answer.trajectory
        if path is None:
            if answer.status == 'closed':
                self._kept.as_reported()
            return
        inside = path.moved((self.start_pose or Pose(0.0, 0.0)).inverse())
        self._kept.follow(inside)
        self.path_log.hang(inside, self._delay_ns, (each.stamp_ns for each in self.soundings))

    @property
    def _delay_ns(self) -> int:
        """From an emission to the stamp of its ping [ns]."""
        return round(1e9 * self.parameters.echo.t0_s)

    @property
    def solve_due(self) -> bool:
        """Whether a replay has to solve now, so that it meets drift while it can still follow the poses.

        That is before echoes are left away, and as often as the pings double; where poses are estimated, every few
        pings, so that the next ones are looked for where they are.
        """
        solver, used = self.parameters.solver, self.counts.used
        if self.parameters.localises:
            return used >= self._solved_at + FOLLOWED
        if solver.method != 'evidence' or self.parameters.slam.mode == 'off' or used < KEPT_PINGS:
            return False
        if self._kept.correction is not None:
            return used >= self._solved_at + FOLLOWED
        return used >= max(2 * self._solved_at, KEPT_PINGS)

    @property
    def surroundings(self) -> Surroundings:
        """Map, free area and path of all pings; of those whose echoes are kept where their poses were estimated."""
        return self._corrected or Surroundings(self.beam_map, self.free_area, self.places.positions)

    def driven_since_m(self, stamp_ns: int) -> float:
        """Return the way by the odometry from the ping of a stamp to the newest one [m]."""
        last = int(np.searchsorted(self.path_log.stamps_ns, stamp_ns - self._delay_ns))
        return float(np.sum(np.hypot(*np.diff(self.path_log.poses[last:, :2], axis=0).T)))

    def newest(self) -> tuple[int, Pose] | None:
        """Return the emission [ns] of the newest ping that has a place, and the base's pose then, in the map frame.

        From the last estimate on it follows the odometry; in a map that is given there is none before the first.
        """
        if not len(self.path_log.stamps_ns) or self.start_pose is None:
            return None
        if self._outline is not None and self._kept.correction is None:
            return None
        correction = self._kept.correction or Pose(0.0, 0.0)
        base = correction.compose(Pose(*self.path_log.poses[-1].tolist()))
        return int(self.path_log.stamps_ns[-1]), self.start_pose.compose(base)

    def path(self) -> Path:
        """Return where the robot's base was at the pings by the last estimate, in its frame."""
        trajectory, start = self.estimate.trajectory if self.estimate else None, self.start_pose or Pose(0.0, 0.0)
        inside = trajectory and trajectory.moved(start.inverse())
        poses, lost = self.path_log.estimated(inside, self._delay_ns)
        return Path(self.path_log.stamps_ns.copy(), in_frame(poses, start), lost)

    def _redrawn(self, path: Trajectory) -> Surroundings:
        """Return what the kept pings tell from their estimated places, all in the start frame."""
        poses, lost = self.path_log.estimated(path, self._delay_ns)
        mount = np.tile((self._mount.x, self._mount.y, self._mount.yaw), (int(np.sum(~lost)), 1))
        return redrawn(path, self._kept.all, onward(poses[~lost], mount)[:, :2], self.parameters)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return all that is needed to go on as if nothing had happened, as arrays of numbers and strings."""
        drift = {'drift': self._solver.state()} if isinstance(self._solver, EvidenceSolver) else {}
        return packed(self.parameters, {**self.reception_parts(), **drift})

    @classmethod
    def from_state(
        cls, parameters: Parameters, state: Mapping[str, NDArray[np.generic]],
        recorded_pulse: RecordedPulse | ArrayLike | None = None, later: Later = at_once,
        at_most: int | None = None,
    ) -> 'PolygonMapper':
        """Continue from what `state` gave.

        Raises
        ------
        StateError
            For a state that is damaged, of another version, or taken with other parameters that matter.
        """
        mapper = cls(parameters, recorded_pulse, later, at_most)
        with damage_told():
            parts = unpacked(mapper.parameters, state)
            if 'drift' in parts and isinstance(mapper._solver, EvidenceSolver):
                mapper._solver.restore(parts['drift'])
            mapper.restore_reception(parts)
        return mapper
