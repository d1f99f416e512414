"""Everything that came in, at its place: echoes that are kept, maps, and where the odometry says that the robot was."""

import copy
from collections.abc import Callable, Iterable, Mapping
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import RecordedPulse
from polymap_ros.errors import BadPing, UsageError
from polymap_ros.geometry.plane import Plane, SpatialPose
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.common_removal import CommonRemoval
from polymap_ros.hearing.echo_band import EchoBand
from polymap_ros.hearing.intake import Intake
from polymap_ros.hearing.listening import Later, Listener, at_once
from polymap_ros.hearing.noise_lines import NoiseLines
from polymap_ros.hearing.odometer import Odometer
from polymap_ros.hearing.offsets import Offsets
from polymap_ros.hearing.packed_soundings import packed_soundings, unpacked_soundings
from polymap_ros.hearing.ping_queue import PingCounts
from polymap_ros.hearing.signals import Signals
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.mapping.kept_pings import KeptPings, NewestPings
from polymap_ros.mapping.path_log import PathLog
from polymap_ros.mapping.state import Part, packed_frame, unpacked_frame
from polymap_ros.mapping.surroundings import Surroundings
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.maps.free_area import FreeArea
from polymap_ros.maps.visited import Places
from polymap_ros.packing import whole_number
from polymap_ros.parameters import Parameters


class Reception:
    """Takes poses and pings as they come, and keeps what they tell in the start frame.

    Its origin is the sensor's position at the first used ping, its x axis the robot's heading there.

    Parameters
    ----------
    parameters : Parameters
        The groups `solver` and `slam` act elsewhere, but for `slam.map_origin` and the mode.
    recorded_pulse, later, at_most
        As `PolygonMapper` takes them.

    Attributes
    ----------
    parameters, intake, places, path_log, origin, start_pose, tap, placed
        As of `PolygonMapper`.
    """

    def __init__(
        self, parameters: Parameters, recorded_pulse: RecordedPulse | ArrayLike | None = None,
        later: Later = at_once, at_most: int | None = None,
    ) -> None:
        if recorded_pulse is not None:
            parameters = parameters.replaced({'pulse.kind': 'file'})
        self.parameters = parameters
        self.tap: Callable[[Ping, Pose], None] = _nobody
        self.placed: Callable[[int], None] = _nobody
        self.intake = Intake(parameters, at_most)
        self._listener = Listener(parameters, BeamformingMap(parameters.grid).r_m, recorded_pulse, later)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.intake.reset()
        self._listen(self._listener)
        self._offsets = Offsets()
        self._band = EchoBand()
        self._lines = NoiseLines()
        self._odometer, self._mount = Odometer(), Pose(0.0, 0.0)
        self._as_reported = Surroundings.empty(self.parameters)
        self._kept = NewestPings() if self.parameters.localises else KeptPings()
        self.places, self.path_log = Places(), PathLog()
        self._restored = False  # and no odometry has come since
        self.origin: Pose | None = None
        self.start_pose: Pose | None = None

    def twin(self) -> Self:
        """Return a copy to be looked at in another thread while this one takes what comes."""
        twin = copy.copy(self)
        twin.tap = twin.placed = _nobody
        twin.intake, twin._common = self.intake.copy(), self._common.copy()
        twin._as_reported, twin._kept = self._as_reported.copy(), self._kept.copy()
        twin.places, twin.path_log = self.places.copy(), self.path_log.copy()
        return twin

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
            listener.admission.check(ping)
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
        for ping, reported, base, mount in self.intake.placed(self._listener.ready):
            self.tap(ping, reported)
            if self.origin is None:
                self.origin = base if self.parameters.slam.map_origin == 'first_ping' else Pose(0.0, 0.0)
            self._mount = mount
            sensor = self.origin.inverse().compose(base).compose(mount)
            self.start_pose = self.start_pose or sensor
            self._hear(self._common.take(ping, self.start_pose.inverse().compose(sensor)))

    def _come_up(self) -> None:
        """Go on with what came; a backlog only grows by it, as messages come faster than a backlog is used."""
        self.intake.place()
        if not self.intake.behind:
            self.go_on()

    def _hear(self, placed: Iterable[tuple[Ping, Pose]]) -> None:
        """Add pings, with the sensor's place in the start frame, to the maps."""
        for ping, place in placed:
            received, (ping, freed) = ping, self._listener.freed(ping, self._lines.known_hz)
            self._lines = self._lines.taken(freed.lines_hz, freed.struck)
            self._band = self._band.taken(ping, self.parameters)
            self._offsets = self._offsets.taken(received.samples, self.parameters)
            base = place.compose(self._mount.inverse())
            self._odometer = self._odometer.to(base)
            self.path_log.add(ping.emission_ns, base)
            kept = self._kept.wants(place)
            heard = self._listener.hear(ping, finely=kept)  # eq. (3)
            if kept:
                self._kept.take(Sounding(
                    ping.stamp_ns, place.x, place.y, *heard, place.yaw, self._mount, self._odometer.sums))
            self.places.add(ping.stamp_ns, place.x, place.y)
            baseline_m = self.parameters.sensor.baseline_m
            self._as_reported.hear(place, heard.envelope, heard.rho, heard.confidence, baseline_m)
            self.placed(ping.stamp_ns)

    def _listen(self, listener: Listener) -> None:
        self._listener = listener
        self._common = CommonRemoval(self.parameters.front_end.common_pings, listener.pulse_s, listener.pulse_m)

    def signals(self, ping: Ping) -> Signals:
        """Return what would be made of a ping now, step by step, to be looked at; `BadPing` if it cannot be used."""
        listener = self._listener.at(ping.period_s)
        listener.admission.check(ping)
        return listener.signals(ping, self._common.cleaned(ping), self._lines.known_hz)

    @property
    def soundings(self) -> list[Sounding]:
        """The pings whose echoes are kept, in order of emission as far as they came in time."""
        return self._kept.soundings

    def reception_parts(self) -> dict[str, Part]:
        """Return all that is needed to go on, as arrays."""
        return {
            'frame': packed_frame(self.frame_id, self.start_pose, self.plane, self.origin),
            'soundings': packed_soundings(self._kept.all), 'waiting': {'count': np.array(len(self._kept.waiting))},
            'offsets': self._offsets.state(), 'band': self._band.state(), 'lines': self._lines.state(),
            'odometer': self._odometer.state(),
            'path': self.path_log.state(),
            'pulse': {'period_s': np.array(self._listener.recorded_period_s)}, **self.intake.parts(),
            **{name: part.state() for name, part in self._parts.items()}}

    def restore_reception(self, parts: Mapping[str, Part]) -> None:
        """Take over what `reception_parts` gave; what an earlier version did not know begins anew."""
        if 'band' in parts:
            self._band = EchoBand.restored(parts['band'])
        if 'lines' in parts:
            self._lines = NoiseLines.restored(parts['lines'])
        if 'odometer' in parts:
            self._odometer = Odometer.restored(parts['odometer'])
        if 'path' in parts:
            self.path_log.restore(parts['path'])
        if 'pulse' in parts:
            self._listen(self._listener.at(float(parts['pulse']['period_s'])))
        if 'offsets' in parts:
            self._offsets = Offsets.restored(parts['offsets'])
        frame_id, self.start_pose, plane, self.origin = unpacked_frame(parts['frame'])
        soundings = unpacked_soundings(parts['soundings'], self._listener.n_fine, self._listener.fold)
        waiting = whole_number(parts['waiting']['count']) if 'waiting' in parts else 0
        chosen = max(len(soundings) - waiting, 0)
        self._kept = KeptPings(soundings[:chosen], soundings[chosen:])
        self.intake.restore(parts, frame_id, plane)
        for name, part in self._parts.items():
            part.restore(parts[name])
        for ping in (*self.intake.waiting, *self._common.pings):
            self._listener.admission.check(ping)
        self.intake.resuming = self.parameters.odometry.on_jump_back == 'reset'
        self._restored = True

    @property
    def _parts(self) -> dict[str, Places | CommonRemoval | BeamformingMap | FreeArea]:
        """What takes over what it saved."""
        return {'places': self.places, 'common': self._common, 'beam_map': self.beam_map, 'free_area': self.free_area}


def _nobody(*_: object) -> None:
    """Is told, and does nothing."""
