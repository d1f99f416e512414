"""What comes in: poses and pings in any order, out of which come pings with the sensor's pose at their emission."""

import copy
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import BadPing
from polymap_ros.geometry.plane import XY, Plane, SpatialPose
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.odometry_error import OdometryCorrection, OdometryError
from polymap_ros.hearing.ping_queue import PingCounts, PingQueue
from polymap_ros.hearing.pose_track import PoseTrack
from polymap_ros.parameters import Parameters

Part = dict[str, NDArray[np.generic]]


class PlacedPing(NamedTuple):
    """A ping with the pose of the robot's base at its emission, as reported and with its known errors taken out.

    `mount` is the sensor's place on the base.
    """

    ping: Ping
    reported: Pose
    base: Pose
    mount: Pose


class Intake:
    """Waits for odometry and for the sensor's place, and counts what becomes of every ping.

    Parameters
    ----------
    parameters : Parameters
        The groups `odometry` and `sensor` are used.
    at_most : int, optional
        Pings given in one go; more wait for the next one, and so does what comes meanwhile. Default: no limit.

    Attributes
    ----------
    locate : callable
        Gives the sensor's place in the robot's base frame by the name of the sensor's frame, such as from TF, in place
        of `sensor.x_m` and `sensor.y_m`; None as long as it is not known, for which pings wait. It raises `BadPing` at
        the first question for a frame that it will never know.
    plane : Plane or None
        The mapping plane; None until there was a pose.
    frame_id : str
        The odometry's frame; empty until there was a pose.
    behind : bool
        The last go has left something for the next one.
    held : bool
        Pings only get their poses, and wait until this is unset; as long as nothing is compiled.
    missing_frame : str
        The frame that the first waiting ping waits for `locate` to know; empty where it does not.
    resuming : bool
        A saved state was restored and no pose has come since. It may have been saved under another clock, so pings wait
        for that pose. Not with ``odometry.on_jump_back: ignore``, which takes the clock for the same.
    """

    def __init__(self, parameters: Parameters, at_most: int | None = None) -> None:
        self._parameters, self._at_most = parameters, at_most
        self.locate: Callable[[str], Pose | None] = lambda _: Pose(parameters.sensor.x_m, parameters.sensor.y_m)
        self.behind = self.held = False
        self.reset()

    def reset(self) -> None:
        """Forget everything that came."""
        odometry = self._parameters.odometry
        self._track = PoseTrack(odometry)
        self._queue = PingQueue(self._track, odometry.queue_size)
        self._correction = OdometryCorrection(OdometryError(odometry.scale, odometry.yaw_drift_deg_m))
        self.plane: Plane | None = None
        self.frame_id = self.missing_frame = ''
        self.resuming = False

    def copy(self) -> 'Intake':
        """Return an intake of its own that has taken the same."""
        twin = copy.copy(self)
        twin._track = self._track.copy()
        twin._queue = self._queue.copy(twin._track)
        twin._correction = copy.copy(self._correction)
        return twin

    @property
    def counts(self) -> PingCounts:
        """What became of the pings."""
        return self._queue.counts

    @property
    def last_drop_texts(self) -> Mapping[str, str]:
        """Last sentence of each drop reason."""
        return self._queue.last_texts

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose [ns] that is believed; None while there is none."""
        return self._track.newest_ns

    @property
    def outliers(self) -> int:
        """Poses that were taken, and turned out to be stamped far ahead of their time."""
        return self._track.outliers

    @property
    def waiting(self) -> list[Ping]:
        """The pings that wait."""
        return self._queue.pings

    @property
    def due(self) -> bool:
        """Whether there is a ping that the odometry has come up to."""
        return self._queue.due

    def add_pose(self, stamp_ns: int, pose: Pose | SpatialPose, frame_id: str) -> bool:
        """Take the pose of the robot's base [ns]; False, and not taken, where `PolygonMapper.add_pose` says so."""
        if self.frame_id not in ('', frame_id):
            return False
        newest_ns, odometry = self._track.newest_ns, self._parameters.odometry
        if self.resuming and newest_ns is not None and newest_ns - stamp_ns > 1e9 * odometry.max_gap_s:
            self._track = self._track.emptied()
            self._queue.restart(self._track)
        if not self._track.add(stamp_ns, pose):
            return False
        if self.plane is None:
            kind = odometry.plane
            self.plane = self._track.plane = Plane.of(kind, pose) if isinstance(pose, SpatialPose) else XY
        self.frame_id = frame_id
        if self.resuming and self._track.newest_ns != newest_ns:
            self.resuming = False
            self._queue.admit()
        return True

    def add_ping(self, ping: Ping) -> bool:
        """Take a ping; False where it is dropped at once, and counted."""
        try:
            self.locate(ping.frame_id)
        except BadPing as bad:
            self.refuse(bad.reason, str(bad))
            return False
        self._queue.put(ping, early=self.resuming)
        return True

    def refuse(self, reason: str, text: str) -> None:
        """Count a ping that was received and refused."""
        self._queue.refuse(reason, text)

    def place(self) -> None:
        """Give the pings that the odometry has come up to their poses, before these are forgotten."""
        if not self.resuming:
            self._queue.place()

    def placed(self, ready: Callable[[Ping], bool]) -> Iterator[PlacedPing]:
        """Give the pings that have waited long enough, for odometry, the sensor's place and to be `ready`, in time."""
        self.behind = False
        if self.held or self.resuming:
            return
        waiting = self._queue.placed(lambda ping: self._located(ping) and ready(ping))
        for number, (ping, reported) in enumerate(waiting, 1):
            mount = self.locate(ping.frame_id) or Pose(0.0, 0.0)
            yield PlacedPing(ping, reported, self._correction(reported), mount)
            if number == self._at_most:
                self.behind = True
                return

    def _located(self, ping: Ping) -> bool:
        located = self.locate(ping.frame_id) is not None
        self.missing_frame = '' if located else ping.frame_id
        return located

    def end(self) -> None:
        """No more odometry will come: all that can be placed is given in the next go."""
        self._track.finish()
        self._at_most, self.resuming, self.held = None, False, False
        self._queue.admit()

    def drop_waiting(self) -> None:
        """Drop what still waits as ``no_pose``."""
        self._queue.finish()

    def parts(self) -> dict[str, Part]:
        """Return all that is needed to go on, as arrays."""
        return {'track': self._track.state(), 'queue': self._queue.state(), 'odometry': self._correction.state()}

    def restore(self, parts: Mapping[str, Part], frame_id: str, plane: Plane | None) -> None:
        """Take over what `parts` gave, with the odometry's frame and the mapping plane."""
        self.frame_id, self.plane = frame_id, plane
        self._track.plane = plane or XY
        self._track.restore(parts['track'])
        self._queue.restore(parts['queue'])
        self._correction.restore(parts['odometry'])
