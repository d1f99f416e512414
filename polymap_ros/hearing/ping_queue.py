"""Pings on their way to a pose and to their turn, and what became of every one."""

import copy
import dataclasses
import heapq
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import BadPing, StateError
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.clocks import NOT_STAMPED, apart
from polymap_ros.hearing.packed_pings import packed_pings, unpacked_pings
from polymap_ros.hearing.pose_track import PoseTrack
from polymap_ros.packing import whole_number

_REMEMBERED = 1024
"""Times of emission kept at least before those too old to matter are forgotten."""

BACKLOG_BYTES = 256 * 1024 * 1024
"""Samples of pings that have their pose and wait for their turn: 20 pings a second of 8192 samples for 6 minutes."""


@dataclass
class PingCounts:
    """received = used + the sum of dropped + waiting, always."""

    received: int = 0
    used: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    waiting: int = 0


class PingQueue:
    """Holds pings until the odometry brackets them, drops those that never will be, and counts.

    A ping gets its pose as soon as the odometry has come up to it. From then on it waits only for its turn, for as
    long as it takes: the poses about it may be forgotten meanwhile.

    Parameters
    ----------
    track : PoseTrack
        Where the poses come from.
    size : int
        Pings that may wait for their odometry; the oldest is dropped as ``queue_full`` when one more comes.
    backlog_bytes : int, optional
        Samples of the pings that may wait for their turn [bytes]; the oldest is dropped as ``queue_full`` beyond it.

    Attributes
    ----------
    counts : PingCounts
        What became of the pings.
    last_texts : dict
        Last sentence of each drop reason.
    """

    def __init__(self, track: PoseTrack, size: int, backlog_bytes: int = BACKLOG_BYTES) -> None:
        self.counts = PingCounts()
        self.last_texts: dict[str, str] = {}
        self._track = track
        self._size = size
        self._heap: list[tuple[int, int, Ping]] = []
        self._order = count()
        self._early: deque[Ping] = deque()
        self._backlog: deque[tuple[Ping, Pose]] = deque()
        self._backlog_bytes, self._most_bytes = 0, backlog_bytes
        self._taken: set[int] = set()
        self._kept = 0

    @property
    def pings(self) -> list[Ping]:
        """Those that wait: for their turn, and for their odometry."""
        return [*(ping for ping, _ in self._backlog), *self._waiting]

    @property
    def _waiting(self) -> list[Ping]:
        """Those that wait for their odometry, by time of emission, and those that came early."""
        return [*(ping for _, _, ping in sorted(self._heap)), *self._early]

    def copy(self, track: PoseTrack) -> 'PingQueue':
        """A queue of its own with the same pings, upon a copy of the track."""
        twin = copy.copy(self)
        twin._track, twin._heap, twin._taken = track, list(self._heap), set(self._taken)
        twin._backlog, twin._early = self._backlog.copy(), self._early.copy()
        twin.counts = dataclasses.replace(self.counts, dropped=dict(self.counts.dropped))
        twin.last_texts = dict(self.last_texts)
        return twin

    def put(self, ping: Ping, early: bool = False) -> None:
        """Take a ping that was received; one emitted when another one was is dropped as ``duplicate``.

        One that is `early` came before it is known whether the clock began anew: it waits for `admit`.
        """
        self.counts.received += 1
        if not early:
            self._sort_in(ping)
            return
        if len(self._early) == self._size:
            self._early.popleft()
            self.drop('queue_full', f'{self._size} pings wait for the first odometry (odometry.queue_size)')
        self._early.append(ping)
        self._count_waiting()

    def admit(self) -> None:
        """The clock of those that came early is known, after `restart` where it is another one."""
        while self._early:
            self._sort_in(self._early.popleft())

    def _sort_in(self, ping: Ping) -> None:
        if ping.emission_ns in self._taken:
            why = f'; stamps are all 0: {NOT_STAMPED}' if ping.stamp_ns == 0 else ''
            self.drop('duplicate', f'a ping with the stamp {ping.stamp_ns} ns has been taken before{why}')
            self._count_waiting()
            return
        if len(self._heap) == self._size:
            emission_ns, _, oldest = heapq.heappop(self._heap)
            self._taken.discard(emission_ns)
            self.drop('queue_full', apart(oldest.stamp_ns, self._track.newest_ns)
                      or f'{self._size} pings wait for their odometry (odometry.queue_size)')
        self._taken.add(ping.emission_ns)
        heapq.heappush(self._heap, (ping.emission_ns, next(self._order), ping))
        self._count_waiting()
        self._forget()

    @property
    def due(self) -> bool:
        """Whether there is a ping that the odometry has come up to."""
        return bool(self._backlog) or self._bracketed

    @property
    def _bracketed(self) -> bool:
        """Whether there is such a ping that has no pose yet."""
        newest_ns = self._track.newest_ns
        return bool(self._heap) and newest_ns is not None and self._heap[0][0] <= newest_ns

    def refuse(self, reason: str, text: str) -> None:
        """Count a ping that was received and cannot even wait."""
        self.counts.received += 1
        self.drop(reason, text)

    def drop(self, reason: str, text: str) -> None:
        """Count a ping that was received before as dropped."""
        self.counts.dropped[reason] = self.counts.dropped.get(reason, 0) + 1
        self.last_texts[reason] = text

    def place(self) -> None:
        """Give the pings that the odometry has come up to their poses; from then on they wait for their turn."""
        while self._bracketed:
            emission_ns, _, ping = heapq.heappop(self._heap)
            try:
                pose = self._track.at(emission_ns)
            except BadPing as bad:
                self.drop(bad.reason, apart(ping.stamp_ns, self._track.newest_ns) or str(bad))
                continue
            assert pose is not None, 'the track ends before its newest pose'
            self._backlog.append((ping, pose))
            self._backlog_bytes += ping.samples.nbytes
        while self._backlog_bytes > self._most_bytes and len(self._backlog) > 1:
            self._taken.discard(self._next()[0].emission_ns)
            self.drop('queue_full', f'{self._most_bytes / 1e6:.0f} MB of pings wait for their turn')
        self._count_waiting()

    def placed(self, ready: Callable[[Ping], bool] = lambda ping: True) -> Iterator[tuple[Ping, Pose]]:
        """Pings, by time of emission, with the pose of the robot's base then; each counts as used.

        One that is not ready yet keeps those after it waiting.
        """
        self.place()
        while self._backlog and ready(self._backlog[0][0]):
            taken = self._next()
            self.counts.used += 1
            self._count_waiting()
            yield taken

    def _next(self) -> tuple[Ping, Pose]:
        ping, pose = self._backlog.popleft()
        self._backlog_bytes -= ping.samples.nbytes
        return ping, pose

    def _count_waiting(self) -> None:
        self.counts.waiting = len(self._heap) + len(self._early) + len(self._backlog)

    def finish(self) -> None:
        """No more odometry will come, and no turn: what still waits is dropped as ``no_pose``."""
        self._drop_waiting()
        while self._backlog:
            ping, _ = self._next()
            self.drop('no_pose', f'the place of its frame {ping.frame_id!r} on the robot never became known')
        self._count_waiting()

    def _drop_waiting(self) -> None:
        for _, _, ping in self._heap:
            self.drop('no_pose', apart(ping.stamp_ns, self._track.newest_ns) or 'no odometry came after it')
        self._heap.clear()
        self._count_waiting()

    def restart(self, track: PoseTrack) -> None:
        """Go on under a clock that began anew: what waits for odometry is dropped, and stamps may come again."""
        self._drop_waiting()
        self._track, self._taken, self._kept = track, set(), 0

    def _forget(self) -> None:
        """Forget pings that would be stale by now, in batches."""
        horizon_ns = self._track.horizon_ns
        if horizon_ns is not None and len(self._taken) >= max(_REMEMBERED, 2 * self._kept):
            self._taken = {emission_ns for emission_ns in self._taken if emission_ns >= horizon_ns}
            self._kept = len(self._taken)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        dropped = sorted(self.counts.dropped.items())
        return {
            'counts': np.array((self.counts.received, self.counts.used), np.int64),
            'reasons': np.array([reason for reason, _ in dropped], dtype=str),
            'dropped': np.array([number for _, number in dropped], np.int64),
            'taken_ns': np.array(sorted(self._taken), np.int64),
            **{f'waiting_{name}': array for name, array in packed_pings(self._waiting).items()},
            **{f'placed_{name}': array for name, array in packed_pings([ping for ping, _ in self._backlog]).items()},
            'placed_poses': np.array([(pose.x, pose.y, pose.yaw) for _, pose in self._backlog]).reshape(-1, 3),
        }

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        received, used = map(whole_number, state['counts'])
        dropped = dict(zip(state['reasons'].tolist(), map(whole_number, state['dropped']), strict=True))
        pings = unpacked_pings(state, 'waiting_')
        backlog = _unpacked_backlog(state) if 'placed_poses' in state else []
        waiting = len(pings) + len(backlog)
        if received != used + sum(dropped.values()) + waiting:
            raise StateError(f'{received} pings received are not {used} used, {sum(dropped.values())} dropped and '
                             f'{waiting} waiting')
        self.counts = PingCounts(received, used, dropped, waiting)
        self._taken = set(state['taken_ns'].tolist())
        self._heap = [(ping.emission_ns, next(self._order), ping) for ping in pings]
        heapq.heapify(self._heap)
        self._backlog = deque(backlog)
        self._backlog_bytes = sum(ping.samples.nbytes for ping, _ in backlog)


def _unpacked_backlog(state: dict[str, NDArray[np.generic]]) -> list[tuple[Ping, Pose]]:
    pings, rows = unpacked_pings(state, 'placed_'), np.asarray(state['placed_poses'], float)
    poses = [Pose(*row) for row in rows.reshape(-1, 3).tolist()]
    if len(poses) != len(pings) or not all(pose.is_sound for pose in poses):
        raise StateError(f'{len(pings)} pings that have their pose do not match {len(poses)} poses of a robot')
    return list(zip(pings, poses, strict=True))
