"""From echoes and odometry to the polygon: the one way through."""

import copy
import dataclasses
from collections.abc import Callable, Iterable, Mapping
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import BadPing, StateError
from polymap_ros.mapping.beamforming import BeamformingMap
from polymap_ros.mapping.common_removal import CommonRemoval
from polymap_ros.mapping.estimate import Estimate
from polymap_ros.mapping.free_grid import make_free_area
from polymap_ros.mapping.listening import Later, Listener, at_once
from polymap_ros.mapping.odometry_error import OdometryCorrection, OdometryError
from polymap_ros.mapping.ping_queue import PingCounts, PingQueue
from polymap_ros.mapping.places import Places
from polymap_ros.mapping.plane import XY, Plane, SpatialPose
from polymap_ros.mapping.pose import Pose
from polymap_ros.mapping.pose_track import PoseTrack
from polymap_ros.mapping.signals import Signals
from polymap_ros.mapping.solver import Evidence
from polymap_ros.mapping.solvers import make_solver
from polymap_ros.mapping.sounding import Sounding
from polymap_ros.mapping.soundings import packed_soundings, unpacked_soundings
from polymap_ros.mapping.state import packed, packed_frame, unpacked, unpacked_frame
from polymap_ros.mapping.thinning import Thinning
from polymap_ros.parameters import Parameters

_SLICE = 100
"""Iterations between two looks whether a solve is done."""


class PolygonMapper:
    """Takes poses and pings as they come and answers with the polygon around the sensor.

    Lines, map and free area are kept in the start frame: its origin is the sensor's position at the first used ping,
    its x axis the robot's heading there. Estimates are in the odometry's frame, or where the mapping plane is not its
    xy plane, in the coordinates of `plane`.

    Parameters
    ----------
    parameters : Parameters
        Everything but the group `topics`, `map` and `output`.
    recorded_pulse : ndarray, shape (n,), optional
        Samples of ``pulse.kind: file``.
    later : callable, optional
        Does what the first ping of a length takes longer for; default: at once. Pings wait until it is done, and for
        `go_on`.
    at_most : int, optional
        Pings used in one go; more wait for the next pose or ping, or for `go_on`. Default: no limit.

    Attributes
    ----------
    beam_map : BeamformingMap
        L_T of eq. (4).
    free_area : FreeArea
        A_T.
    soundings : list of Sounding
        The pings whose echoes are kept, in order of emission as far as they came in time.
    places : Places
        Where all pings were used.
    plane : Plane or None
        The mapping plane, in which all of this is; None until there was a pose.
    start_pose : Pose or None
        The start frame in the mapping plane; None until a ping was used.
    frame_id : str
        The odometry's frame; empty until there was a pose.
    estimate : Estimate or None
        The last finished solve.
    locate : callable
        Gives the sensor's place in the robot's base frame by the name of the sensor's frame, such as from TF, in place
        of `sensor.x_m` and `sensor.y_m`; None as long as it is not known, for which pings wait. It raises `BadPing` at
        the first question for a frame that it will never know.
    tap : callable
        Is told of every ping that is used, and of the reported pose of the base at its emission.
    placed : callable
        Is told the stamp [ns] of every ping that now has its place in the map.
    behind : bool
        `go_on` has left something for the next time.
    missing_frame : str
        The frame that the first waiting ping waits for `locate` to know; empty where it does not.
    resuming : bool
        A saved state was restored and no pose has come since. It may have been saved under another clock, so pings wait
        for that pose. Not with ``odometry.on_jump_back: ignore``, which takes the clock for the same.
    """

    def __init__(
        self, parameters: Parameters, recorded_pulse: NDArray[np.float64] | None = None, later: Later = at_once,
        at_most: int | None = None,
    ) -> None:
        self._at_most = at_most
        self.behind = False
        self.parameters = parameters
        self.locate: Callable[[str], Pose | None] = lambda _: Pose(parameters.sensor.x_m, parameters.sensor.y_m)
        self.tap: Callable[[Ping, Pose], None] = _nobody
        self.placed: Callable[[int], None] = _nobody
        self._quarter_m2 = (0.5 * parameters.sensor.baseline_m) ** 2
        self._listener = Listener(parameters, BeamformingMap(parameters.grid).r_m, recorded_pulse, later)
        self.reset()

    def reset(self) -> None:
        """Forget everything; the mapper is as new."""
        self._track = PoseTrack(self.parameters.odometry)
        self._queue = PingQueue(self._track, self.parameters.odometry.queue_size)
        odometry = self.parameters.odometry
        self._correction = OdometryCorrection(OdometryError(odometry.scale, odometry.yaw_drift_deg_m))
        self._common = CommonRemoval(
            self.parameters.front_end.common_pings, self._listener.pulse_s, self._listener.pulse_m)
        self.beam_map = BeamformingMap(self.parameters.grid)
        area, step_m = self.parameters.free_area, self.parameters.grid.range_step_m
        self.free_area = make_free_area(area.model, area.cell_m or 2.0 * step_m, area.missed)
        self.soundings: list[Sounding] = []
        self.places = Places()
        self._thinning = Thinning()
        self.plane: Plane | None = None
        self.start_pose: Pose | None = None
        self.frame_id = self.missing_frame = ''
        self.estimate: Estimate | None = None
        self._solver = make_solver(self.parameters)  # a twin may be in the middle of a solve
        self._solving = self.resuming = False

    def twin(self) -> 'PolygonMapper':
        """A copy to be solved, saved or drawn in another thread while this one takes what comes.

        It solves with the same solver, so that the next solve starts from its answer; `reset` and `configure` of
        either leave the other alone.
        """
        twin = copy.copy(self)
        twin.tap = twin.placed = _nobody
        twin._track = self._track.copy()
        twin._queue, twin._common = self._queue.copy(twin._track), self._common.copy()
        twin._correction = copy.copy(self._correction)
        twin.beam_map, twin.free_area = self.beam_map.copy(), self.free_area.copy()
        twin.soundings, twin._thinning, twin.places = list(self.soundings), self._thinning.copy(), self.places.copy()
        return twin

    def configure(self, parameters: Parameters) -> None:
        """Take over changed `solver` parameters; a solve under way is dropped. The others are for a new mapper."""
        self.parameters = parameters
        self._solver = make_solver(parameters)
        self._solving = False

    @property
    def counts(self) -> PingCounts:
        """What became of the pings."""
        return self._queue.counts

    @property
    def last_drop_texts(self) -> Mapping[str, str]:
        """Last sentence of each drop reason."""
        return self._queue.last_texts

    @property
    def newest_pose_ns(self) -> int | None:
        """Stamp of the newest pose [ns] that is believed; None while there is none."""
        return self._track.newest_ns

    @property
    def outliers(self) -> int:
        """Poses that were taken, and turned out to be stamped far ahead of their time."""
        return self._track.outliers

    def add_pose(self, stamp_ns: int, pose: Pose | SpatialPose, frame_id: str = 'odom') -> bool:
        """Add the pose of the robot's base [ns], in the mapping plane or in space; pings that waited for it are used.

        False, and not taken, if the stamp is not after the newest one, or the frame is not that of the first pose.
        Where poses begin more than `odometry.max_gap_s` before those of a restored state, that was saved under another
        clock: its map stays, its poses and waiting pings are forgotten.
        """
        if self.frame_id not in ('', frame_id):
            return False
        newest_ns = self._track.newest_ns
        if self.resuming and newest_ns is not None and newest_ns - stamp_ns > 1e9 * self.parameters.odometry.max_gap_s:
            self._track = self._track.emptied()
            self._queue.restart(self._track)
        if not self._track.add(stamp_ns, pose):
            return False
        if self.plane is None:
            kind = self.parameters.odometry.plane
            self.plane = self._track.plane = Plane.of(kind, pose) if isinstance(pose, SpatialPose) else XY
        self.frame_id = frame_id
        self.resuming = self.resuming and self._track.newest_ns == newest_ns
        if self._queue.due:
            self.go_on()
        return True

    def add_ping(self, ping: Ping) -> None:
        """Add a ping; it is used once the odometry brackets its emission, or dropped and counted, never fatal."""
        try:
            self._listener.check(ping)
            self.locate(ping.frame_id)
        except BadPing as bad:
            self._queue.refuse(bad.reason, str(bad))
        else:
            self._queue.put(ping)
            self.go_on()

    def drop(self, reason: str, text: str = '') -> None:
        """Count a ping that was received and refused before it became one."""
        self._queue.refuse(reason, text)

    def finish(self) -> None:
        """No more odometry will come: pings still waiting are dropped as ``no_pose``."""
        self._track.finish()
        self._at_most, self.resuming = None, False
        self.go_on()
        self._queue.finish()
        self._use(self._common.finish())

    def go_on(self) -> None:
        """Use the pings that have waited long enough: for odometry, the sensor's place, what was to be done `later`."""
        self.behind = False
        if self.resuming:
            return
        for number, (ping, base) in enumerate(self._queue.placed(self._ready), 1):
            self.tap(ping, base)
            sensor = self._correction(base).compose(self.locate(ping.frame_id) or Pose(0.0, 0.0))
            self.start_pose = self.start_pose or sensor
            self._use(self._common.take(ping, self.start_pose.inverse().compose(sensor)))
            if number == self._at_most:
                self.behind = True
                return

    def _use(self, placed: Iterable[tuple[Ping, Pose]]) -> None:
        """Pings with the sensor's place in the start frame."""
        for ping, place in placed:
            kept = self._thinning.wants(place.x, place.y)
            echo, envelope, rho, noise, confidence = self._listener.hear(ping, finely=kept)  # eq. (3)
            if kept:
                self._thinning.add(self.soundings, Sounding(
                    ping.stamp_ns, place.x, place.y, echo, envelope, rho, noise, confidence, place.yaw))
            self.places.add(ping.stamp_ns, place.x, place.y)
            self.beam_map.add(place.x, place.y, envelope)  # eq. (4)
            # A_T; no wall cuts the ellipse about emitter and receiver, whose smaller half axis this is.
            clear_m = sqrt(max(rho**2 - self._quarter_m2, 0.0))
            self.free_area.add(place.x, place.y, clear_m, confidence)
            self.placed(ping.stamp_ns)

    def _ready(self, ping: Ping) -> bool:
        located = self.locate(ping.frame_id) is not None
        self.missing_frame = '' if located else ping.frame_id
        return located and self._listener.ready(ping)

    def signals(self, ping: Ping) -> Signals:
        """What would be made of a ping now, step by step, to be looked at; `BadPing` if it cannot be used."""
        self._listener.check(ping)
        return self._listener.signals(ping, self._common.cleaned(ping))

    def solve(self) -> Estimate:
        """Solve from what has been heard so far; the answer is in the odometry's frame."""
        self.begin_solve()
        while not self.advance(_SLICE):
            pass
        assert self.estimate is not None
        return self.estimate

    @property
    def evidence(self) -> Evidence:
        """What a solver may look at."""
        return Evidence(tuple(self.soundings), self.beam_map, self.free_area, self._listener.shape, self.places)

    def begin_solve(self) -> None:
        """Begin a solve on what has been heard so far."""
        self._solver.begin(self.evidence)
        self._solving = True

    def advance(self, iterations: int) -> bool:
        """Run up to so many iterations; True when the solve is done, or none is under way."""
        if self._solving and self._solver.advance(iterations):
            self.estimate = self.preview()
            self._solving = False
        return not self._solving

    def preview(self) -> Estimate:
        """What the solve that was begun last would answer if it ended now, in the odometry's frame."""
        estimate = self._solver.estimate().moved(self.start_pose or Pose(0.0, 0.0))
        return dataclasses.replace(estimate, cautions=(*estimate.cautions, *self._common.cautions))

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on as if nothing had happened, as arrays of numbers and strings."""
        return packed(self.parameters, {
            'frame': packed_frame(self.frame_id, self.start_pose, self.plane),
            'soundings': packed_soundings(self.soundings), 'places': self.places.state(),
            'track': self._track.state(), 'queue': self._queue.state(), 'common': self._common.state(),
            'odometry': self._correction.state(),
            'beam_map': self.beam_map.state(), 'free_area': self.free_area.state(),
        })

    @classmethod
    def from_state(
        cls, parameters: Parameters, state: Mapping[str, NDArray[np.generic]],
        recorded_pulse: NDArray[np.float64] | None = None, later: Later = at_once, at_most: int | None = None,
    ) -> 'PolygonMapper':
        """Continue from what `state` gave.

        Raises
        ------
        StateError
            For a state that is damaged, of another version, or taken with other parameters that matter.
        """
        mapper = cls(parameters, recorded_pulse, later, at_most)
        try:
            parts = unpacked(parameters, state)
            mapper.frame_id, mapper.start_pose, mapper.plane = unpacked_frame(parts['frame'])
            mapper.soundings = unpacked_soundings(parts['soundings'], mapper._listener.n_fine, mapper._listener.fold)
            mapper._thinning = Thinning(mapper.soundings)
            mapper._track.plane = mapper.plane or XY
            for name, part in (
                ('places', mapper.places), ('track', mapper._track), ('queue', mapper._queue),
                ('common', mapper._common), ('odometry', mapper._correction), ('beam_map', mapper.beam_map),
                ('free_area', mapper.free_area),
            ):
                part.restore(parts[name])
            for ping in (*mapper._queue.pings, *mapper._common.pings):
                mapper._listener.check(ping)
        except KeyError as error:
            raise StateError(f'the state holds no {error.args[0]}') from error
        except (BadPing, ValueError, TypeError, IndexError, OverflowError) as error:
            raise StateError(f'the state is damaged: {" ".join(str(error).split())}') from error
        mapper.resuming = parameters.odometry.on_jump_back == 'reset'
        return mapper


def _nobody(*_: object) -> None:
    """Is told, and does nothing."""
