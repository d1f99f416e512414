"""Where the odometry reported every ping that was used, and where the estimate says that it was."""

import copy
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import FARTHEST_M, Pose
from polymap_ros.geometry.poses import between, onward
from polymap_ros.solvers.estimate import Trajectory

_FIRST = 1024
_FREE = -1
"""Stamp of an anchor that is none."""


class Path(NamedTuple):
    """Stamps (n,) [ns] of the emissions, poses (n, 3) of the robot's base then, and which of them are lost (n,)."""

    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    lost: NDArray[np.bool_]


class PathLog:
    """Emissions, and poses of the robot's base in the start frame, ping by ping: 73 bytes each.

    A ping whose pose was estimated, and whose echoes are no longer kept, hangs on the nearest in time whose are: it
    moves with that one, and does not turn about it, whose heading is known by far worse than its place. One whose pose
    was never estimated follows the odometry from there.
    """

    def __init__(self) -> None:
        self._count = 0
        self._columns: dict[str, NDArray[Any]] = {
            'stamps_ns': np.empty(_FIRST, np.int64), 'reported': np.empty((_FIRST, 3)),
            'anchors_ns': np.empty(_FIRST, np.int64), 'seen': np.empty((_FIRST, 3)), 'lost': np.empty(_FIRST, np.bool_)}

    def copy(self) -> 'PathLog':
        """Return the same log, to go on from apart."""
        if not self._count:
            return PathLog()
        twin = copy.copy(self)
        # Full, so that what either adds goes elsewhere; and what hangs elsewhere takes columns of its own.
        twin._columns = {name: column[:self._count] for name, column in self._columns.items()}
        return twin

    def add(self, emission_ns: int, base: Pose) -> None:
        """Log a ping."""
        if self._count == len(self.stamps_ns) == len(self._columns['stamps_ns']):
            self._columns = {name: np.concatenate((column, np.empty_like(column)))
                             for name, column in self._columns.items()}
        row: dict[str, Any] = {'stamps_ns': emission_ns, 'reported': (base.x, base.y, base.yaw), 'anchors_ns': _FREE,
                               'seen': 0.0, 'lost': False}
        for name, value in row.items():
            self._columns[name][self._count] = value
        self._count += 1

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps (n,) of the emissions."""
        return self._columns['stamps_ns'][:self._count]

    @property
    def poses(self) -> NDArray[np.float64]:
        """Reported poses (n, 3)."""
        return self._columns['reported'][:self._count]

    def estimated(self, trajectory: Trajectory | None, delay_ns: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return where the pings were by an estimate (n, 3), and which of them are lost.

        `delay_ns` is from an emission to the stamp of its ping.
        """
        if trajectory is None or not self._count:
            return self.poses.copy(), np.zeros(self._count, np.bool_)
        kept = np.array(trajectory.stamps_ns, np.int64) - delay_ns
        anchors, seen = self._columns['anchors_ns'][:self._count], self._columns['seen'][:self._count]
        on = np.minimum(np.searchsorted(kept, anchors), len(kept) - 1)
        hung, beside = kept[on] == anchors, _nearest(kept, self.stamps_ns)
        by_odometry = onward(trajectory.poses[beside], between(trajectory.reported[beside], self.poses))
        poses = np.where(hung[:, None], trajectory.poses[on] + seen, by_odometry)
        lost = self._columns['lost'][:self._count].copy()
        own = kept[beside] == self.stamps_ns
        poses[own], lost[own] = trajectory.poses[beside[own]], trajectory.lost[beside[own]]
        return poses, lost

    def hang(self, trajectory: Trajectory, delay_ns: int, kept_ns: Iterable[int]) -> None:
        """Let the pings of an estimate, and what hangs on them, hang on those whose echoes are kept from now on."""
        poses, lost = self.estimated(trajectory, delay_ns)
        here = np.array(trajectory.stamps_ns, np.int64) - delay_ns
        stays = np.isin(here, np.array([*kept_ns], np.int64) - delay_ns) & ~trajectory.lost
        if not np.any(stays):
            return
        self._columns |= {name: self._columns[name].copy() for name in ('anchors_ns', 'seen', 'lost')}
        anchors = self._columns['anchors_ns'][:self._count]
        moved = np.isin(self.stamps_ns, here) | np.isin(anchors, here[~stays])
        on = np.flatnonzero(stays)[_nearest(here[stays], self.stamps_ns[moved])]
        anchors[moved] = here[on]
        self._columns['seen'][:self._count][moved] = poses[moved] - trajectory.poses[on]
        self._columns['lost'][:self._count][moved] = lost[moved]

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return all that is needed to go on, as arrays."""
        return {name: column[:self._count].copy() for name, column in self._columns.items()}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        columns = {name: np.asarray(state[name], column.dtype) for name, column in self._columns.items()}
        count = len(columns['stamps_ns'])
        shapes = {name: (count, *column.shape[1:]) for name, column in self._columns.items()}
        near = all(np.all(np.abs(columns[name]) <= 2.0 * FARTHEST_M) for name in ('reported', 'seen'))
        if {name: column.shape for name, column in columns.items()} != shapes or not near:
            raise StateError('the path is not that of a robot')
        self._columns, self._count = columns if count else PathLog()._columns, count


def _nearest(sorted_ns: NDArray[np.int64], stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return which of some stamps that increase is nearest to each of others."""
    after = np.clip(np.searchsorted(sorted_ns, stamps_ns), 0, len(sorted_ns) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(stamps_ns - sorted_ns[before] < np.abs(sorted_ns[after] - stamps_ns), before, after)
