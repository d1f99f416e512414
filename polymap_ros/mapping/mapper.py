"""From echoes and odometry to the polygon: the one way through."""

import copy
import dataclasses
from collections.abc import Callable, Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import Polygon, contains_xy

from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import RecordedPulse
from polymap_ros.errors import BadPing, UsageError
from polymap_ros.geometry.plane import Plane, SpatialPose
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.poses import in_frame, onward
from polymap_ros.hearing.common_removal import CommonRemoval
from polymap_ros.hearing.echo_band import EchoBand
from polymap_ros.hearing.intake import Intake
from polymap_ros.hearing.listening import Later, Listener, at_once
from polymap_ros.hearing.odometer import Odometer
from polymap_ros.hearing.offsets import Offsets
from polymap_ros.hearing.packed_soundings import packed_soundings, unpacked_soundings
from polymap_ros.hearing.ping_queue import PingCounts
from polymap_ros.hearing.signals import Signals
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.mapping.kept_pings import KeptPings, NewestPings
from polymap_ros.mapping.outline import known_outline
from polymap_ros.mapping.path_log import Path, PathLog
from polymap_ros.mapping.state import damage_told, packed, packed_frame, unpacked, unpacked_frame
from polymap_ros.mapping.surroundings import Surroundings, redrawn
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.maps.free_area import FreeArea
from polymap_ros.maps.thinning import KEPT_PINGS
from polymap_ros.maps.visited import Places
from polymap_ros.packing import whole_number
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


class PolygonMapper:
    """Takes poses and pings as they come and answers with the polygon around the sensor.

    Lines, map and free area are kept in the start frame: its origin is the sensor's position at the first used ping,
    its x axis the robot's heading there. Estimates are in the odometry's frame, or where the mapping plane is not its
    xy plane, in the coordinates of `plane`.

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
    start_pose : Pose or None
        The start frame in the mapping plane; None until a ping was used.
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
        if recorded_pulse is not None:
            parameters = parameters.replaced({'pulse.kind': 'file'})
        self.parameters = parameters
        self._outline = known_outline(outline) if parameters.localises else None
        self.tap: Callable[[Ping, Pose], None] = _nobody
        self.placed: Callable[[int], None] = _nobody
        self.intake = Intake(parameters, at_most)
        self._listener = Listener(parameters, BeamformingMap(parameters.grid).r_m, recorded_pulse, later)
        self.reset()

    def __repr__(self) -> str:
        return f'PolygonMapper({self.counts.received} pings, {self.counts.used} used, estimate={self.estimate!r})'

    def reset(self) -> None:
        """Forget everything; the mapper is as new."""
        self.intake.reset()
        self._listen(self._listener)
        self._offsets = Offsets()
        self._band = EchoBand()
        self._odometer, self._mount = Odometer(), Pose(0.0, 0.0)
        self._as_reported = Surroundings.empty(self.parameters)
        self._corrected: Surroundings | None = None  # at estimated places
        self._kept = KeptPings() if self._outline is None else NewestPings()
        self.places, self.path_log = Places(), PathLog()
        self._solved_at = 0  # pings at the last solve
        self._restored = False  # and no odometry has come since
        self.start_pose: Pose | None = None
        self.estimate: Estimate | None = None
        self._solver = make_solver(self.parameters)  # a twin may be in the middle of a solve

    def twin(self) -> 'PolygonMapper':
        """Return a copy to be solved, saved or drawn in another thread while this one takes what comes.

        It solves with the same solver, so that the next solve starts from its answer; `reset` and `configure` of
        either leave the other alone.
        """
        twin = copy.copy(self)
        twin.tap = twin.placed = _nobody
        twin.intake, twin._common = self.intake.copy(), self._common.copy()
        twin._as_reported, twin._kept = self._as_reported.copy(), self._kept.copy()
        twin.places, twin.path_log = self.places.copy(), self.path_log.copy()
        return twin

    def configure(self, parameters: Parameters) -> None:
        """Take over changed `solver` parameters for solves that begin from now on; others are for a new mapper."""
        self.parameters = parameters
        self._solver = make_solver(parameters)

    @property
    def plane(self) -> Plane | None:
        """The mapping plane, in which all of this is; None until there was a pose."""
        return self.intake.plane

    @property
    def frame_id(self) -> str:
        """The odometry's frame; empty until there was a pose."""
        return self.intake.frame_id

    @property
    def beam_map(self) -> BeamformingMap:
        """L_T of eq. (4), of all pings at their reported places."""
        return self._as_reported.beam_map

    @property
    def free_area(self) -> FreeArea:
        """A_T, of the same."""
        return self._as_reported.free_area

    @property
    def map_frame(self) -> str:
        """The frame of estimates: `slam.map_frame`, or where that is empty the odometry's as of the first used ping."""
        return self.parameters.slam.map_frame or self.frame_id

    @property
    def counts(self) -> PingCounts:
        """What became of the pings."""
        return self.intake.counts

    def add_pose(
        self, stamp_ns: int, pose: Pose | SpatialPose | tuple[float, float, float], frame_id: str = 'odom'
    ) -> bool:
        """Add the pose of the robot's base [ns], in the mapping plane (x, y, yaw will do) or in space; use what waited.

        False, and not taken, if the stamp is not after the newest one, or the frame is not that of the first pose.
        Where poses begin more than `odometry.max_gap_s` before those of a restored state, that was saved under another
        clock: its map stays, its poses and waiting pings are forgotten.
        """
        pose = pose if isinstance(pose, Pose | SpatialPose) else Pose.of(pose)
        newest_ns = self.intake.newest_ns
        taken = self.intake.add_pose(stamp_ns, pose, frame_id)
        if taken and self._restored:
            self._restored = False
            if newest_ns is not None and abs(stamp_ns - newest_ns) > 1e9 * self.parameters.odometry.max_gap_s:
                self._kept.resume()
        if taken and self.intake.due:
            self._come_up()
        return taken

    def add_ping(self, ping: Ping) -> None:
        """Add a ping; it is used once the odometry brackets its emission, or dropped and counted, never fatal."""
        if not isinstance(ping, Ping):
            raise UsageError(f'ping: found {type(ping).__name__}; allowed: a Ping, of the stamp, samples and period_s')
        try:
            listener = self._listener.at(ping.period_s)
            listener.check(ping)
        except BadPing as bad:
            self.intake.refuse(bad.reason, str(bad))
            return
        if listener is not self._listener:
            self._listen(listener)
        if self.intake.add_ping(ping):
            self._come_up()

    def drop(self, reason: str, text: str = '') -> None:
        """Count a ping that was received and refused before it became one."""
        self.intake.refuse(reason, text)

    def finish(self) -> None:
        """No more odometry will come: pings still waiting are dropped as ``no_pose``."""
        self.intake.end()
        self.go_on()
        self.intake.drop_waiting()
        self._hear(self._common.finish())

    def go_on(self) -> None:
        """Use the pings that have waited long enough: for odometry, the sensor's place, what was to be done `later`."""
        for ping, base, sensor in self.intake.placed(self._listener.ready):
            self.tap(ping, base)
            self.start_pose, self._mount = self.start_pose or sensor, base.inverse().compose(sensor)
            self._hear(self._common.take(ping, self.start_pose.inverse().compose(sensor)))

    def _come_up(self) -> None:
        """Go on with what came; a backlog only grows by it, as messages come faster than a backlog is used."""
        self.intake.place()
        if not self.intake.behind:
            self.go_on()

    def _hear(self, placed: Iterable[tuple[Ping, Pose]]) -> None:
        """Add pings, with the sensor's place in the start frame, to the maps."""
        for ping, place in placed:
            self._band = self._band.taken(ping, self.parameters)
            self._offsets = self._offsets.taken(ping.samples, self.parameters)
            base = place.compose(self._mount.inverse())
            self._odometer = self._odometer.to(base)
            self.path_log.add(ping.emission_ns, base)
            kept = self._kept.wants(place)
            echo, envelope, rho, noise, confidence = self._listener.hear(ping, finely=kept)  # eq. (3)
            if kept:
                self._kept.take(Sounding(
                    ping.stamp_ns, place.x, place.y, echo, envelope, rho, noise, confidence, place.yaw, self._mount,
                    self._odometer.driven_m, self._odometer.turned_rad2))
            self.places.add(ping.stamp_ns, place.x, place.y)
            self._as_reported.hear(place, envelope, rho, confidence, self.parameters.sensor.baseline_m)
            self.placed(ping.stamp_ns)

    def _listen(self, listener: Listener) -> None:
        self._listener = listener
        self._common = CommonRemoval(self.parameters.front_end.common_pings, listener.pulse_s, listener.pulse_m)

    def signals(self, ping: Ping) -> Signals:
        """Return what would be made of a ping now, step by step, to be looked at; `BadPing` if it cannot be used."""
        listener = self._listener.at(ping.period_s)
        listener.check(ping)
        return listener.signals(ping, self._common.cleaned(ping))

    @property
    def soundings(self) -> list[Sounding]:
        """The pings whose echoes are kept, in order of emission as far as they came in time."""
        return self._kept.soundings

    @property
    def evidence(self) -> Evidence:
        """What a solver may look at."""
        outline = None
        if self._outline is not None:
            start = self.start_pose or Pose(0.0, 0.0)
            outline = Outline(start.inverse().apply(self._outline), start)
        return Evidence(self._kept.all, self.beam_map, self.free_area, self._listener.shape, self.places, outline)

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
        """Solve from what has been heard so far and return the answer, in the odometry's frame.

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
        self.estimate = dataclasses.replace(found, cautions=(
            *found.cautions, *self._common.cautions, *self._offsets.cautions,
            *self._band.cautions(self._listener.pulse, self.parameters.pulse.frequency_hz)))
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
        return packed(self.parameters, {
            'frame': packed_frame(self.frame_id, self.start_pose, self.plane),
            'soundings': packed_soundings(self._kept.all), 'waiting': {'count': np.array(len(self._kept.waiting))},
            'offsets': self._offsets.state(), 'band': self._band.state(), 'odometer': self._odometer.state(),
            'path': self.path_log.state(),
            'pulse': {'period_s': np.array(self._listener.recorded_period_s)}, **self.intake.parts(),
            **({'drift': self._solver.state()} if isinstance(self._solver, EvidenceSolver) else {}),
            **{name: part.state() for name, part in self._parts.items()}})

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
            if 'band' in parts:
                mapper._band = EchoBand.restored(parts['band'])
            if 'odometer' in parts:
                mapper._odometer = Odometer.restored(parts['odometer'])
            if 'drift' in parts and isinstance(mapper._solver, EvidenceSolver):
                mapper._solver.restore(parts['drift'])
            if 'path' in parts:
                mapper.path_log.restore(parts['path'])
            if 'pulse' in parts:
                mapper._listen(mapper._listener.at(float(parts['pulse']['period_s'])))
            if 'offsets' in parts:
                mapper._offsets = Offsets.restored(parts['offsets'])
            frame_id, mapper.start_pose, plane = unpacked_frame(parts['frame'])
            soundings = unpacked_soundings(parts['soundings'], mapper._listener.n_fine, mapper._listener.fold)
            waiting = whole_number(parts['waiting']['count']) if 'waiting' in parts else 0
            chosen = max(len(soundings) - waiting, 0)
            mapper._kept = KeptPings(soundings[:chosen], soundings[chosen:])
            mapper.intake.restore(parts, frame_id, plane)
            for name, part in mapper._parts.items():
                part.restore(parts[name])
            for ping in (*mapper.intake.waiting, *mapper._common.pings):
                mapper._listener.check(ping)
        mapper.intake.resuming = parameters.odometry.on_jump_back == 'reset'
        mapper._restored = True
        return mapper

    @property
    def _parts(self) -> dict[str, Places | CommonRemoval | BeamformingMap | FreeArea]:
        """What takes over what it saved."""
        return {'places': self.places, 'common': self._common, 'beam_map': self.beam_map, 'free_area': self.free_area}


def _nobody(*_: object) -> None:
    """Is told, and does nothing."""
