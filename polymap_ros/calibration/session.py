"""Poses and pings that are kept, to be heard again with other parameters."""

import copy
import dataclasses
from array import array
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.acoustics.common_part import common_part
from polymap_ros.acoustics.direct_wave import direct_wave_t0
from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import RecordedPulse, make_pulse
from polymap_ros.errors import ParameterError
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.odometry_error import OdometryError
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps.thinning import KEPT_PINGS
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.checkpoint import Checkpoint, unwatched
from polymap_ros.solvers.evidence.search import Search, search_of
from polymap_ros.solvers.solver import Evidence

_AS_REPORTED = {'odometry.scale': 1.0, 'odometry.yaw_drift_deg_m': 0.0}
_ALL_USED = _AS_REPORTED | {'grid.angle_step_deg': 90.0, 'odometry.max_gap_s': 1e9}
"""Poses are given where the pings are, freed of the odometry's error; the beamforming map is not looked at."""

_MOST_PINGS = 4 * KEPT_PINGS
"""Pings kept before those are forgotten that the mapper does not keep."""


class Tape:
    """Keeps what a mapper uses: all reported poses, and of the pings those whose echoes the mapper keeps.

    Parameters
    ----------
    mapper : PolygonMapper
        New; it is tapped.
    """

    def __init__(self, mapper: PolygonMapper) -> None:
        self._mapper = mapper
        self._poses = array('d')
        self._pings: dict[int, tuple[int, Ping]] = {}
        mapper.tap = self._take

    def _take(self, ping: Ping, base: Pose) -> None:
        self._pings[ping.stamp_ns] = self._count, ping
        self._poses.extend((base.x, base.y, base.yaw))
        if len(self._pings) >= _MOST_PINGS:
            # Of the newest, some may not have reached the soundings yet.
            self._forget(keep_from=self._count - KEPT_PINGS)

    @property
    def _count(self) -> int:
        return len(self._poses) // 3

    def _forget(self, keep_from: int) -> None:
        kept = {sounding.stamp_ns for sounding in self._mapper.soundings}
        self._pings = {stamp_ns: entry for stamp_ns, entry in self._pings.items()
                       if stamp_ns in kept or entry[0] >= keep_from}

    def session(self, recorded_pulse: RecordedPulse | ArrayLike | None = None) -> 'Session':
        """Give what is kept, to be heard again; `recorded_pulse` as in `PolygonMapper`."""
        self._forget(keep_from=self._count)
        mapper = self._mapper
        entries = sorted(self._pings.values(), key=lambda entry: entry[0])
        return Session(mapper.parameters, np.array(self._poses).reshape(-1, 3), [at for at, _ in entries],
                       [ping for _, ping in entries], mapper.intake.locate, recorded_pulse)


class Session:
    """What a mapper was fed with.

    The range axis is stretched with the medium's group speed, so that it covers the same time with every medium, and
    the noise of each ping is that of the first hearing: likelihoods of different media are of the same samples.

    Parameters
    ----------
    parameters : Parameters
        Those that the others are compared with.
    poses : ndarray, shape (M, 3)
        Reported poses of the base in the order of time: x, y [m], yaw [rad].
    at : sequence of int
        Which pose each ping was emitted at, rising.
    pings : sequence of Ping
        As many.
    locate : callable
        As of `PolygonMapper`.
    recorded_pulse : RecordedPulse or ndarray, shape (n,), optional
        As in `PolygonMapper`.
    """

    def __init__(
        self, parameters: Parameters, poses: NDArray[np.float64], at: Sequence[int], pings: Sequence[Ping],
        locate: Callable[[str], Pose | None], recorded_pulse: RecordedPulse | ArrayLike | None = None,
    ) -> None:
        self.checkpoint: Checkpoint = unwatched
        self.parameters = parameters
        self._poses, self._at, self._pings = poses, np.array(at, np.int64), tuple(pings)
        self._locate = locate
        places = [locate(ping.frame_id) or Pose(0.0, 0.0) for ping in pings]
        self._mounted = np.array([(place.x, place.y, place.yaw) for place in places]).reshape(-1, 3)
        self._recorded = recorded_pulse
        self._speed = self._group_speed(parameters)
        self._noise: dict[int, float] = {}
        self._louder: float | None = None
        self._heard: tuple[Parameters, Evidence] | None = None

    def watched(self, checkpoint: Checkpoint) -> 'Session':
        """Return the same session, whatever is found in it calling another checkpoint."""
        twin = copy.copy(self)
        twin.checkpoint = checkpoint
        return twin

    @property
    def pings(self) -> tuple[Ping, ...]:
        """What was heard."""
        return self._pings

    def mapper(self, parameters: Parameters) -> PolygonMapper:
        """A mapper that has heard all of it with these parameters; its beamforming map is not to be looked at."""
        stretch = self._group_speed(parameters) / self._speed
        grid = parameters.grid
        mapper = PolygonMapper(parameters.replaced(_ALL_USED | {
            'grid.range_max_m': grid.range_max_m * stretch, 'grid.range_step_m': grid.range_step_m * stretch,
        }), self._recorded)
        mapper.intake.locate = self._locate
        later_s = parameters.echo.t0_s - self.parameters.echo.t0_s
        for ping, pose in zip(self._pings, self._base_poses(parameters), strict=True):
            shifted = dataclasses.replace(ping, t0_s=ping.t0_s + later_s)
            mapper.add_pose(shifted.emission_ns, Pose(*pose.tolist()))
            mapper.add_ping(shifted)
        mapper.finish()
        return mapper

    def direct_wave_t0(self) -> float | None:
        """Time of the first sample after emission [s] as the direct wave tells it; None where none stands out."""
        first = self._pings[0]
        alike = [ping.samples for ping in self._pings
                 if (ping.samples.size, ping.period_s) == (first.samples.size, first.period_s)]
        pulse = make_pulse(self.parameters.pulse, self._recorded, first.period_s)
        common = common_part(np.array(alike), max(round(pulse.duration_s / first.period_s), 1))
        return direct_wave_t0(common, first.period_s, pulse, self.parameters.sensor.baseline_m / self._speed)

    def search(self, parameters: Parameters) -> Search:
        """Return the evidence of all of it under these parameters.

        Raises
        ------
        ParameterError
            Where pings end before the blanking does: it is a length, and a slower wave takes longer for it.
        """
        evidence = self.evidence(parameters)
        if len(evidence.soundings) < len(self._pings):
            raise ParameterError('echo.blanking_m', f'{parameters.echo.blanking_m:g} leaves {len(evidence.soundings)} '
                                                    f'of {len(self._pings)} pings to listen to, with such a medium')
        at = {ping.stamp_ns: place for ping, place in zip(self._pings, self._places(parameters).tolist(), strict=True)}
        soundings = []
        for sounding in evidence.soundings:
            x, y, yaw = at[sounding.stamp_ns]
            noise = self._noise.setdefault(sounding.stamp_ns, sounding.noise)
            soundings.append(dataclasses.replace(sounding, x=x, y=y, yaw=yaw, noise=noise))
        heard = dataclasses.replace(evidence, soundings=tuple(soundings))
        search = search_of(heard, parameters, self.checkpoint, self._louder)
        self._louder = search.data.louder
        return search

    def evidence(self, parameters: Parameters) -> Evidence:
        """What is heard, at the places as reported: not heard again where only the odometry changes."""
        heard = parameters.replaced(_AS_REPORTED)
        if self._heard is None or self._heard[0] != heard:
            self._heard = heard, self.mapper(heard).evidence
        return self._heard[1]

    def positions(self, parameters: Parameters) -> NDArray[np.float64]:
        """Sensor positions (N, 2) in the start frame [m] under these parameters."""
        return self._places(parameters)[:, :2]

    def _places(self, parameters: Parameters) -> NDArray[np.float64]:
        """The sensor's poses (N, 3) in the start frame."""
        poses, (x, y, yaw) = self._base_poses(parameters), self._mounted.T
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        places = np.column_stack((poses[:, 0] + c * x - s * y, poses[:, 1] + s * x + c * y))
        yaws = poses[:, 2] + yaw
        start = Pose(float(places[0, 0]), float(places[0, 1]), float(yaws[0]))
        return np.column_stack((start.inverse().apply(places), yaws - yaws[0]))

    def _base_poses(self, parameters: Parameters) -> NDArray[np.float64]:
        odometry = parameters.odometry
        true = OdometryError(odometry.scale, odometry.yaw_drift_deg_m).corrected(self._poses)
        return np.asarray(true[self._at])

    @staticmethod
    def _group_speed(parameters: Parameters) -> float:
        return float(group_speed(make_medium(parameters.medium), parameters.pulse.frequency_hz))
