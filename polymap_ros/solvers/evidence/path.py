"""The path as it is answered: where the pings were, how well that and the walls are known, what has to be told."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import Caution
from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.poses import between, onward
from polymap_ros.solvers.estimate import Trajectory
from polymap_ros.solvers.evidence import wording
from polymap_ros.solvers.evidence.likelihood import covariance_of, information_of
from polymap_ros.solvers.evidence.odometry import NOISIER, SLIP
from polymap_ros.solvers.evidence.power import Power, PowerLikelihood
from polymap_ros.solvers.evidence.tracking import Chain, Track
from polymap_ros.solvers.evidence.trajectory import Joint, JointLikelihood, World
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

_TOLD_M, _TOLD_RAD = 5e-5, np.deg2rad(0.05)
"""An odometry that is off by less is told as right: it would read as 0.0 mm and 0.0 deg."""

_SCALE_DEVIATIONS, _SCALE_LEAST = 3.5, 0.01
"""Deviations by which the lengths of ways have to differ from those by the echoes to be told, and the share: wheels are
seldom known better, and polygons by the wrong one of steel and aluminium are 2.7 % off."""


class Known(NamedTuple):
    """Covariances, given the frame: of r and theta of each wall (2 n, 2 n), and of each pose (m, 3, 3)."""

    walls: NDArray[np.float64]
    poses: NDArray[np.float64]


def known(track: Track, chain: Chain) -> Known | None:
    """Return how well walls and poses are known together, by the inverse of their joint information.

    The first pose is as it is reported, but for what each place is off by itself.
    """
    odometry, data = chain.between(track.pings).expected(), track.search.data
    world = World(track.found.walls, track.poses, odometry)
    top: Joint[Wave] | Joint[Power] | None
    if (wave := track.found.wave) is not None:
        top = JointLikelihood(WaveformLikelihood, data).evaluate(
            world, Joint(world, wave, -np.inf), FULL_ORDER, derive=True)
    else:
        top = JointLikelihood(PowerLikelihood, data).evaluate(
            world, Joint(world, track.found.power, -np.inf), FULL_ORDER, derive=True)
    if top is None:
        return None
    information, walls, free = information_of(top), 3 * len(world.walls), np.flatnonzero(~world.frame)
    covariance = np.zeros_like(information)
    covariance[np.ix_(free, free)] = covariance_of(information[np.ix_(free, free)])
    covariance += chain.noise.place**2 * world.by_shift @ world.by_shift.T
    number = np.arange(len(track.poses))
    poses = covariance[walls:, walls:].reshape(len(number), 3, len(number), 3)[number, :, number]
    return Known(Walls.of_lines(covariance[:walls, :walls]), poses)


def trajectory_of(track: Track, chain: Chain, joint: Known) -> Trajectory:
    """The poses of all pings of a chain: those of a track, and by dead reckoning beside it those that are lost."""
    count = len(chain.poses)
    beside = np.maximum(np.searchsorted(track.pings, np.arange(count), side='right') - 1, 0)
    poses = onward(track.poses[beside], between(chain.poses[track.pings[beside]], chain.poses))
    consistency = np.zeros(count)
    consistency[track.pings] = track.consistency
    return Trajectory(chain.stamps_ns, poses, chain.poses, joint.poses[beside], consistency)


def path_cautions(path: Trajectory, chain: Chain) -> list[Caution]:
    """What has to be told of a path that is found with the walls."""
    off, way_m = path.map_to_odom, float(chain.way[-1, 0] - chain.way[0, 0])
    away = path.poses[-1, :2] - path.reported[-1, :2]
    away_m, turned_rad = float(np.hypot(*away)), float(wrapped(off.yaw))
    drifts = away_m > _TOLD_M or abs(turned_rad) > _TOLD_RAD
    placed = np.flatnonzero(~path.lost)  # those that are lost are where the odometry says
    scale, deviation = chain.between(placed).loosened(path.poses[placed], NOISIER).scale(path.poses[placed])
    differs = abs(scale - 1.0) > max(_SCALE_LEAST, _SCALE_DEVIATIONS * deviation)
    return [*([wording.odometry_drift(away_m, turned_rad, way_m)] if drifts else []),
            *([wording.odometry_scale(scale, deviation)] if differs else []), *steps_and_losses(path, chain)]


def steps_and_losses(path: Trajectory, chain: Chain) -> list[Caution]:
    """What has to be told of single pings."""
    seconds = 1e-9 * (np.array(path.stamps_ns) - path.stamps_ns[0])
    cautions = []
    odometry = chain.between(np.arange(len(chain.poses)))
    slipped = np.flatnonzero(odometry.squares(path.poses) > SLIP)
    if len(slipped):
        errors = odometry.errors(path.poses)[slipped]
        cautions.append(wording.slips([(float(seconds[step + 1]), float(np.hypot(x, y)), float(turn))
                                       for step, (x, y, turn) in zip(slipped, errors, strict=True)]))
    if np.any(path.lost):
        cautions.append(wording.lost(int(path.lost.sum()), len(path.lost), float(seconds[path.lost][0])))
    return cautions
