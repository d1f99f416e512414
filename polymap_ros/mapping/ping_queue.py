"""Pings on their way to a pose, and what became of every one."""

import copy
import dataclasses
import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import BadPing, StateError
from polymap_ros.mapping.packed_pings import packed_pings, unpacked_pings
from polymap_ros.mapping.pose import Pose
from polymap_ros.mapping.pose_track import PoseTrack
from polymap_ros.mapping.state import whole_number

_REMEMBERED = 1024
"""Times of emission kept at least before those too old to matter are forgotten."""


@dataclass
class PingCounts:
    """received = used + the sum of dropped + waiting, always."""

    received: int = 0
    used: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    waiting: int = 0


class PingQueue:
    """Holds pings until the odometry brackets them, drops those that never will be, and counts.

    Parameters
    ----------
    track : PoseTrack
        Where the poses come from.
    size : int
        Pings that may wait; the oldest is dropped as ``queue_full`` when one more comes.

    Attributes
    ----------
    counts : PingCounts
        What became of the pings.
    last_texts : dict
        Last sentence of each drop reason.
    """

    def __init__(self, track: PoseTrack, size: int) -> None:
        self.counts = PingCounts()
        self.last_texts: dict[str, str] = {}
        self._track = track
        self._size = size
        self._heap: list[tuple[int, int, Ping]] = []
        self._order = count()
        self._taken: set[int] = set()
        self._kept = 0

    @property
    def pings(self) -> list[Ping]:
        """Those that wait, by time of emission."""
        return [ping for _, _, ping in sorted(self._heap)]

    def copy(self, track: PoseTrack) -> 'PingQueue':
        """A queue of its own with the same pings, upon a copy of the track."""
        twin = copy.copy(self)
        twin._track, twin._heap, twin._taken = track, list(self._heap), set(self._taken)
        twin.counts = dataclasses.replace(self.counts, dropped=dict(self.counts.dropped))
        twin.last_texts = dict(self.last_texts)
        return twin

    def put(self, ping: Ping) -> None:
        """Take a ping that was received; one emitted when another one was is dropped as ``duplicate``."""
        self.counts.received += 1
        if ping.emission_ns in self._taken:
            self.drop('duplicate', f'a ping with the stamp {ping.stamp_ns} ns has been taken before')
            return
        if len(self._heap) == self._size:
            self._taken.discard(heapq.heappop(self._heap)[0])
            self.drop('queue_full', f'{self._size} pings wait for their odometry (odometry.queue_size)')
        self._taken.add(ping.emission_ns)
        heapq.heappush(self._heap, (ping.emission_ns, next(self._order), ping))
        self.counts.waiting = len(self._heap)
        self._forget()

    @property
    def due(self) -> bool:
        """Whether there is a ping that the odometry has come up to."""
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

    def placed(self, ready: Callable[[Ping], bool] = lambda ping: True) -> Iterator[tuple[Ping, Pose]]:
        """Pings, by time of emission, with the pose of the robot's base then; each counts as used.

        One that is not ready yet keeps those after it waiting.
        """
        while self.due and ready(self._heap[0][2]):
            emission_ns, _, ping = heapq.heappop(self._heap)
            self.counts.waiting = len(self._heap)
            try:
                pose = self._track.at(emission_ns)
            except BadPing as bad:
                self.drop(bad.reason, str(bad))
                continue
            assert pose is not None, 'the track ends before its newest pose'
            self.counts.used += 1
            yield ping, pose

    def finish(self) -> None:
        """No more odometry will come: what still waits is dropped as ``no_pose``."""
        for _ in self._heap:
            self.drop('no_pose', 'no odometry came after it')
        self._heap.clear()
        self.counts.waiting = 0

    def restart(self, track: PoseTrack) -> None:
        """Go on under a clock that began anew: what still waits is dropped, and stamps may come again."""
        self.finish()
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
            **{f'waiting_{name}': array for name, array in packed_pings(self.pings).items()},
        }

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        received, used = map(whole_number, state['counts'])
        dropped = dict(zip(state['reasons'].tolist(), map(whole_number, state['dropped']), strict=True))
        pings = unpacked_pings(state, 'waiting_')
        if received != used + sum(dropped.values()) + len(pings):
            raise StateError(f'{received} pings received are not {used} used, {sum(dropped.values())} dropped and '
                             f'{len(pings)} waiting')
        self.counts = PingCounts(received, used, dropped, len(pings))
        self._taken = set(state['taken_ns'].tolist())
        self._heap = [(ping.emission_ns, next(self._order), ping) for ping in pings]
        heapq.heapify(self._heap)
