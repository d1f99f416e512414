"""Wheel odometry that errs: what a robot reports of the way it has driven."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Drift:
    """How odometry errs from one pose to the next, where the robot turns by a [rad] and drives a distance d [m].

    Parameters
    ----------
    distance_noise : float
        Random walk of the distance [m per square root of m]: d becomes d (scale) + distance_noise sqrt(d) N.
    heading_noise_deg : float
        Random walk of the heading along the way [deg per square root of m].
    turn_noise : float
        Share of every turn by which it is misjudged: a becomes a (1 + turn_noise N).
    scale : float
        Reported over true distance.
    heading_deg_m : float
        Steady turn of the heading [deg per m].
    """

    distance_noise: float = 0.0
    heading_noise_deg: float = 0.0
    turn_noise: float = 0.0
    scale: float = 1.0
    heading_deg_m: float = 0.0

    def beside(self, scale: float, heading_deg_m: float) -> 'Drift':
        """Return the same with another steady part added."""
        return Drift(self.distance_noise, self.heading_noise_deg, self.turn_noise, self.scale * scale,
                     self.heading_deg_m + heading_deg_m)


LEVELS = {
    'mild': Drift(0.003, 0.3, 0.02, 1.001, 0.1),
    'typical': Drift(0.01, 1.0, 0.03, 1.003, 0.3),
    'bad': Drift(0.03, 3.0, 0.05, 1.01, 1.0),
}
"""A differential drive on a clean floor, on an ordinary one, and one that slips a little all the time."""


def reported(poses: NDArray[np.float64], drift: Drift, generator: np.random.Generator) -> NDArray[np.float64]:
    """Return the poses (T, 3) that erring odometry adds up from the first one, which it reports rightly.

    A turn is made before the way is driven; what the heading errs by along the way, the way follows half.
    """
    steps, turns = np.diff(poses[:, :2], axis=0), np.diff(poses[:, 2])
    distance = np.linalg.norm(steps, axis=1)
    draws = generator.normal(size=(len(steps), 3))
    longer = drift.scale + drift.distance_noise * draws[:, 0] / np.sqrt(np.maximum(distance, 1e-300))
    along = np.deg2rad(drift.heading_noise_deg * np.sqrt(distance) * draws[:, 1] + drift.heading_deg_m * distance)
    turning = drift.turn_noise * turns * draws[:, 2]
    heading = np.concatenate(([0.0], np.cumsum(turning + along)))
    way = heading[:-1] + turning + 0.5 * along
    c, s = longer * np.cos(way), longer * np.sin(way)
    moved = np.column_stack((c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]))
    places = poses[0, :2] + np.vstack((np.zeros(2), np.cumsum(moved, axis=0)))
    return np.column_stack((places, poses[:, 2] + heading))


def with_slips(
    poses: NDArray[np.float64], by_m: float, by_rad: float, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return poses (T, 3), all from one in the middle half on moved by a jump and turned about the place there."""
    if len(poses) < 2 or (by_m == 0.0 and by_rad == 0.0):
        return poses
    first = 1 + int((len(poses) - 1) * generator.uniform(0.25, 0.75))
    angle, about = generator.uniform(0.0, 2.0 * np.pi), poses[first, :2]
    c, s = np.cos(by_rad), np.sin(by_rad)
    later = poses.copy()
    later[first:, :2] = about + (poses[first:, :2] - about) @ np.array([[c, s], [-s, c]]) + by_m * np.array(
        (np.cos(angle), np.sin(angle)))
    later[first:, 2] += by_rad
    return later
