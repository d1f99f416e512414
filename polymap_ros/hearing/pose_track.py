"""The odometry's recent past: the pose at any time between two messages."""

import copy
from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import BadPing, StateError
from polymap_ros.geometry.plane import XY, Placed, SpatialPose
from polymap_ros.geometry.pose import FARTHEST_M, Pose
from polymap_ros.packing import whole_number
from polymap_ros.parameters import OdometryParameters

_NS = 1_000_000_000

_TRIM = 256
"""Expired poses are removed in batches of this size, so that a message costs the same at any length."""


class PoseTrack:
    """Poses by stamp, as far back as `odometry.buffer_s`; positions and headings between two are interpolated.

    Poses in space are placed in the plane only where they are needed: of ten, two lie about a ping.

    Parameters
    ----------
    parameters : OdometryParameters
        Length of the buffer, the longest gap that is interpolated across, and how far off the plane the robot may be.

    Attributes
    ----------
    plane : Plane
        The mapping plane, in which poses in space are placed.
    outliers : int
        Poses that were stamped far ahead of those that came after them, and are left out.
    """

    def __init__(self, parameters: OdometryParameters) -> None:
        self._buffer_ns = round(parameters.buffer_s * _NS)
        self._max_gap_ns = round(parameters.max_gap_s * _NS)
        self._max_tilt_deg, self._max_height_m = parameters.max_tilt_deg, parameters.max_height_m
        self._stamps: list[int] = []
        self._poses: list[Placed | SpatialPose] = []
        self._held: tuple[int, Placed | SpatialPose] | None = None
        self.plane = XY
        self.outliers = 0

    def copy(self) -> 'PoseTrack':
        """A track of its own with the same poses."""
        twin = copy.copy(self)
        twin._stamps, twin._poses = list(self._stamps), list(self._poses)
        return twin

    def emptied(self) -> 'PoseTrack':
        """A track without poses that goes on counting."""
        twin = copy.copy(self)
        twin._stamps, twin._poses, twin._held = [], [], None
        return twin

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose [ns]; None while there is none."""
        return self._stamps[-1] if self._stamps else None

    @property
    def horizon_ns(self) -> int | None:
        """Earlier times [ns] are forgotten; None while there is no pose."""
        return self._stamps[-1] - self._buffer_ns if self._stamps else None

    def add(self, stamp_ns: int, pose: Pose | Placed | SpatialPose) -> bool:
        """Append a pose; False, and not taken, if its stamp is not after the newest one or it cannot be a robot's.

        One stamped further ahead than a gap may be is held back until a later one confirms that time has gone on: a
        single wild stamp would make all that is true come too late. So is the first one, where the second comes as far
        before it.
        """
        if not pose.is_sound:
            return False
        if isinstance(pose, Pose):
            pose = Placed(pose)
        if len(self._stamps) == 1 and stamp_ns < self._stamps[0] - self._max_gap_ns:
            self._hold(self._stamps.pop(), self._poses.pop())
            self._append(stamp_ns, pose)
            return True
        if self._stamps and stamp_ns <= self._stamps[-1]:
            return False
        if self._stamps and stamp_ns > self._stamps[-1] + self._max_gap_ns:
            if self._held is None or stamp_ns <= self._held[0]:
                self._hold(stamp_ns, pose)
                return True
            self._append(*self._held)
        else:
            self.outliers += self._held is not None
        self._held = None
        self._append(stamp_ns, pose)
        return True

    def finish(self) -> None:
        """No more poses will come: one that is held back is taken, since nothing speaks against it."""
        if self._held is not None:
            self._append(*self._held)
            self._held = None

    def _hold(self, stamp_ns: int, pose: Placed | SpatialPose) -> None:
        self.outliers += self._held is not None
        self._held = stamp_ns, pose

    def _append(self, stamp_ns: int, pose: Placed | SpatialPose) -> None:
        self._stamps.append(stamp_ns)
        self._poses.append(pose)
        # The pose before the horizon stays: it brackets the times just after the horizon.
        expired = bisect_right(self._stamps, stamp_ns - self._buffer_ns) - 1
        if expired >= _TRIM:
            del self._stamps[:expired], self._poses[:expired]

    def at(self, stamp_ns: int) -> Pose | None:
        """Pose at a time [ns], the heading interpolated by the short way; None if that is still to come.

        Raises
        ------
        BadPing
            If there will never be one: ``stale`` before the buffer, ``no_pose`` before the first pose, ``pose_gap``
            between two poses too far apart, ``off_plane`` where the robot is tilted or lifted off the mapping plane.
        """
        if not self._stamps or stamp_ns > self._stamps[-1]:
            return None
        if stamp_ns < self._stamps[-1] - self._buffer_ns:
            late_s = (self._stamps[-1] - stamp_ns) / _NS
            raise BadPing('stale', f'emitted {late_s:.3f} s before the newest odometry; odometry.buffer_s keeps '
                                   f'{self._buffer_ns / _NS:g} s')
        after = bisect_right(self._stamps, stamp_ns)
        if after == 0:
            early_s = (self._stamps[0] - stamp_ns) / _NS
            raise BadPing('no_pose', f'emitted {early_s:.3f} s before the first odometry')
        before = after - 1
        if self._stamps[before] == stamp_ns:
            return self._on_plane(self._placed(self._poses[before]))
        gap_ns = self._stamps[after] - self._stamps[before]
        if gap_ns > self._max_gap_ns:
            raise BadPing('pose_gap', f'emitted within a gap of {gap_ns / _NS:.3f} s in the odometry; '
                                      f'odometry.max_gap_s allows {self._max_gap_ns / _NS:g} s')
        share = (stamp_ns - self._stamps[before]) / gap_ns
        first, second = map(self._placed, self._poses[before:after + 1])
        return self._on_plane(_between(first, second, share))

    def _placed(self, pose: Placed | SpatialPose) -> Placed:
        return self.plane.place(pose) if isinstance(pose, SpatialPose) else pose

    def _on_plane(self, placed: Placed) -> Pose:
        tilt_deg = float(np.rad2deg(placed.tilt_rad))
        if tilt_deg > self._max_tilt_deg:
            raise BadPing('off_plane', f'the robot is tilted by {tilt_deg:.1f} deg off the mapping plane '
                                       f'(odometry.plane); odometry.max_tilt_deg allows {self._max_tilt_deg:g}')
        if abs(placed.height_m) > self._max_height_m:
            raise BadPing('off_plane', f'the robot is {placed.height_m:.3f} m off the mapping plane (odometry.plane); '
                                       f'odometry.max_height_m allows {self._max_height_m:g}')
        return placed.pose

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        held = [] if self._held is None else [self._held]
        rows = [(pose.x, pose.y, pose.yaw, height_m, tilt_rad)
                for pose, height_m, tilt_rad in map(self._placed, [*self._poses, *(pose for _, pose in held)])]
        return {
            'stamps_ns': np.array([*self._stamps, *(stamp_ns for stamp_ns, _ in held)], dtype=np.int64),
            'poses': np.array(rows, dtype=float).reshape(-1, 5),
            'held': np.array(len(held)), 'outliers': np.array(self.outliers),
        }

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        stamps, poses = np.asarray(state['stamps_ns'], np.int64), np.asarray(state['poses'], float)
        held, outliers = whole_number(state['held']), whole_number(state['outliers'])
        if stamps.ndim != 1 or poses.shape != (len(stamps), 5) or np.any(stamps[1:] <= stamps[:-1]):
            raise StateError('the poses do not match their stamps')
        if not (np.all(np.isfinite(poses)) and np.all(np.abs(poses[:, :3]) <= FARTHEST_M)):
            raise StateError('the poses are not those of a robot')
        if not 0 <= held <= min(1, len(stamps)):
            raise StateError(f'{held} poses are held back of {len(stamps)}')
        placed = [Placed(Pose(x, y, yaw), height_m, tilt_rad) for x, y, yaw, height_m, tilt_rad in poses.tolist()]
        self._stamps, self._poses, self.outliers = stamps.tolist(), [*placed], outliers
        self._held = (self._stamps.pop(), self._poses.pop()) if held else None


def _between(first: Placed, second: Placed, share: float) -> Placed:
    one, other = first.pose, second.pose
    turn = (other.yaw - one.yaw + np.pi) % (2.0 * np.pi) - np.pi
    pose = Pose(one.x + share * (other.x - one.x), one.y + share * (other.y - one.y), float(one.yaw + share * turn))
    return Placed(pose, first.height_m + share * (second.height_m - first.height_m),
                  first.tilt_rad + share * (second.tilt_rad - first.tilt_rad))
