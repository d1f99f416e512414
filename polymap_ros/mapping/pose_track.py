"""The odometry's recent past: the pose at any time between two messages."""

import copy
from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import BadPing, StateError
from polymap_ros.mapping.pose import Pose
from polymap_ros.parameters import OdometryParameters

_NS = 1_000_000_000

_TRIM = 256
"""Expired poses are removed in batches of this size, so that a message costs the same at any length."""


class PoseTrack:
    """Poses by stamp, as far back as `odometry.buffer_s`; positions and headings between two are interpolated.

    Parameters
    ----------
    parameters : OdometryParameters
        Length of the buffer, and the longest gap that is interpolated across.
    """

    def __init__(self, parameters: OdometryParameters) -> None:
        self._buffer_ns = round(parameters.buffer_s * _NS)
        self._max_gap_ns = round(parameters.max_gap_s * _NS)
        self._stamps: list[int] = []
        self._poses: list[Pose] = []

    def copy(self) -> 'PoseTrack':
        """A track of its own with the same poses."""
        twin = copy.copy(self)
        twin._stamps, twin._poses = list(self._stamps), list(self._poses)
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

    def add(self, stamp_ns: int, pose: Pose) -> bool:
        """Append a pose; False, and not taken, if its stamp is not after the newest one."""
        if self._stamps and stamp_ns <= self._stamps[-1]:
            return False
        self._stamps.append(stamp_ns)
        self._poses.append(pose)
        # The pose before the horizon stays: it brackets the times just after the horizon.
        expired = bisect_right(self._stamps, stamp_ns - self._buffer_ns) - 1
        if expired >= _TRIM:
            del self._stamps[:expired], self._poses[:expired]
        return True

    def at(self, stamp_ns: int) -> Pose | None:
        """Pose at a time [ns], the heading interpolated by the short way; None if that is still to come.

        Raises
        ------
        BadPing
            If there will never be one: ``stale`` before the buffer, ``no_pose`` before the first pose, ``pose_gap``
            between two poses too far apart.
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
            return self._poses[before]
        gap_ns = self._stamps[after] - self._stamps[before]
        if gap_ns > self._max_gap_ns:
            raise BadPing('pose_gap', f'emitted within a gap of {gap_ns / _NS:.3f} s in the odometry; '
                                      f'odometry.max_gap_s allows {self._max_gap_ns / _NS:g} s')
        share = (stamp_ns - self._stamps[before]) / gap_ns
        return _between(self._poses[before], self._poses[after], share)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {
            'stamps_ns': np.array(self._stamps, dtype=np.int64),
            'poses': np.array([(pose.x, pose.y, pose.yaw) for pose in self._poses], dtype=float).reshape(-1, 3),
        }

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        stamps, poses = np.asarray(state['stamps_ns'], np.int64), np.asarray(state['poses'], float)
        if stamps.ndim != 1 or poses.shape != (len(stamps), 3) or np.any(stamps[1:] <= stamps[:-1]):
            raise StateError('the poses do not match their stamps')
        if not np.all(np.isfinite(poses)):
            raise StateError('the poses are not finite')
        self._stamps = stamps.tolist()
        self._poses = [Pose(*row) for row in poses.tolist()]


def _between(first: Pose, second: Pose, share: float) -> Pose:
    turn = (second.yaw - first.yaw + np.pi) % (2.0 * np.pi) - np.pi
    return Pose(
        first.x + share * (second.x - first.x), first.y + share * (second.y - first.y),
        float(first.yaw + share * turn))
