"""The pings whose echoes are kept: a spread choice of all, and where poses are estimated those that wait for one."""

import copy
from collections.abc import Iterable

from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.maps.thinning import Thinning
from polymap_ros.solvers.estimate import Trajectory

WAITING = 64
"""Pings that wait for a pose, at most; more are thinned by where the odometry leads."""

NEWEST = 24
"""Pings that are kept where the map is given: the next ones are placed from the last, and what went wrong is seen."""


class KeptPings:
    """Soundings, thinned by their places: the reported ones, or once poses are estimated those.

    Attributes
    ----------
    soundings : list of Sounding
        The choice, in order of emission as far as they came in time.
    waiting : list of Sounding
        Those that came since poses were estimated the last time.
    correction : Pose or None
        What corrects the odometry in the start frame; None as long as no poses are estimated.
    """

    def __init__(self, soundings: Iterable[Sounding] = (), waiting: Iterable[Sounding] = ()) -> None:
        self.soundings, self.waiting = list(soundings), list(waiting)
        self.correction: Pose | None = None
        self._thinning = Thinning(self.soundings)

    def copy(self) -> 'KeptPings':
        """Return the same pings, to go on from apart."""
        twin = copy.copy(self)
        twin.soundings, twin.waiting, twin._thinning = list(self.soundings), list(self.waiting), self._thinning.copy()
        return twin

    @property
    def all(self) -> tuple[Sounding, ...]:
        """The choice, and those that wait."""
        return (*self.soundings, *self.waiting)

    def wants(self, place: Pose) -> bool:
        """Whether a ping from there would be kept; else its echo need not be worked out."""
        return self.correction is not None or self._thinning.wants(place.x, place.y)

    def take(self, sounding: Sounding) -> None:
        """Take a ping among those that are kept; where poses are estimated, once it has one, or has waited long."""
        if self.correction is None:
            self._thinning.add(self.soundings, sounding)
            return
        self.waiting.append(sounding)
        if len(self.waiting) > WAITING:
            oldest = self.waiting.pop(0)
            seen = self.correction.compose(Pose(oldest.x, oldest.y))
            self._thinning.add(self.soundings, oldest, (seen.x, seen.y))

    def resume(self) -> None:
        """Let pings wait until it is known whether the robot is where it was."""
        self.correction = Pose(0.0, 0.0)

    def as_reported(self) -> None:
        """No poses are estimated: the reported ones explain the echoes."""
        waiting, self.waiting, self.correction = self.waiting, [], None
        for sounding in waiting:
            self._thinning.add(self.soundings, sounding)

    def follow(self, path: Trajectory) -> None:
        """Thin by estimated places from now on, given where the kept pings were, in the start frame.

        Of those that waited, what was placed is taken in, and what is lost between others is let go. Lost at the end
        they wait on: they may be the first from elsewhere.
        """
        self.correction = path.map_to_odom
        mounts = {each.stamp_ns: each.mount for each in self.all}
        sensors = {stamp_ns: Pose(*pose).compose(mounts[stamp_ns])
                   for stamp_ns, pose in zip(path.stamps_ns, path.poses.tolist(), strict=True) if stamp_ns in mounts}
        lost = {stamp_ns for stamp_ns, is_lost in zip(path.stamps_ns, path.lost, strict=True) if is_lost}
        at = {stamp_ns: (sensor.x, sensor.y) for stamp_ns, sensor in sensors.items()}
        self._thinning = self._thinning.moved(self.soundings, at)
        for sounding in self.waiting:
            if sounding.stamp_ns in at and sounding.stamp_ns not in lost:
                self._thinning.add(self.soundings, sounding, at[sounding.stamp_ns])
        last_ns = max((stamp_ns for stamp_ns in at if stamp_ns not in lost), default=0)
        self.waiting = [each for each in self.waiting if each.stamp_ns not in at or each.stamp_ns > last_ns]


class NewestPings(KeptPings):
    """The newest soundings, for a robot in a map that is given."""

    def wants(self, place: Pose) -> bool:
        """Each ping tells where the robot is."""
        return True

    def take(self, sounding: Sounding) -> None:
        """Take a ping; of those that were not looked at yet, the oldest goes where they are too many."""
        self.waiting = [*self.waiting, sounding][-WAITING:]

    def follow(self, path: Trajectory) -> None:
        """Keep the newest of those that were looked at."""
        self.correction = path.map_to_odom
        looked_at = set(path.stamps_ns)
        self.soundings = [*self.soundings, *(each for each in self.waiting if each.stamp_ns in looked_at)][-NEWEST:]
        self.waiting = [each for each in self.waiting if each.stamp_ns not in looked_at]
