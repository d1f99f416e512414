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

    def errors(
        self, distance: NDArray[np.float64], turns: NDArray[np.float64], generator: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return of each step (n,) reported over true distance, and the errors of turn and heading on the way [rad]."""
        draws = generator.normal(size=(len(distance), 3))
        longer = self.scale + self.distance_noise * draws[:, 0] / np.sqrt(np.maximum(distance, 1e-300))
        along = np.deg2rad(self.heading_noise_deg * np.sqrt(distance) * draws[:, 1] + self.heading_deg_m * distance)
        return longer, self.turn_noise * turns * draws[:, 2], along


@dataclass(frozen=True)
class Wheels:
    """How two wheels err, each by itself; the robot turns on the spot and then drives straight on.

    Parameters
    ----------
    noise : float
        Random walk of the way that a wheel reports [m per square root of m].
    left, right : float
        Reported over true ways: their diameters are off.
    track_m, track_scale : float
        Distance between the wheels [m], and what it is taken for over that.
    """

    noise: float
    left: float
    right: float
    track_m: float
    track_scale: float

    def beside(self, scale: float, heading_deg_m: float) -> 'Wheels':
        """Return the same with another steady part added."""
        apart = 0.5 * self.track_m * float(np.deg2rad(heading_deg_m))
        return Wheels(self.noise, scale * self.left - apart, scale * self.right + apart, self.track_m, self.track_scale)

    def errors(
        self, distance: NDArray[np.float64], turns: NDArray[np.float64], generator: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return what `Drift.errors` does."""
        half = 0.5 * self.track_m * turns
        ways = np.stack((np.column_stack((-half, half)), np.column_stack((distance, distance))), axis=1)
        walk = self.noise * np.sqrt(np.abs(ways)) * generator.normal(size=ways.shape)
        rolled = ways * (self.left, self.right) + walk
        turned = (rolled[:, :, 1] - rolled[:, :, 0]) / (self.track_m * self.track_scale)
        return rolled[:, 1].mean(axis=1) / np.maximum(distance, 1e-300), turned[:, 0] - turns, turned[:, 1]


LEVELS: dict[str, Drift | Wheels] = {
    'mild': Drift(0.003, 0.3, 0.02, 1.001, 0.1),
    'typical': Drift(0.01, 1.0, 0.03, 1.003, 0.3),
    'bad': Drift(0.03, 3.0, 0.05, 1.01, 1.0),
    'wheels': Wheels(0.0037, 1.002, 1.0036, 0.3, 1.02),
}
"""A robot on a clean floor, on an ordinary one, and one that slips a little all the time; and two wheels whose heading
errs as much as `typical`: 1 deg after a metre, a steady 0.3 deg/m, 2 % of every turn."""


def reported(
    poses: NDArray[np.float64], drift: Drift | Wheels, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return the poses (T, 3) that erring odometry adds up from the first one, which it reports rightly.

    A turn is made before the way is driven; what the heading errs by along the way, the way follows half.
    """
    steps, turns = np.diff(poses[:, :2], axis=0), np.diff(poses[:, 2])
    distance = np.linalg.norm(steps, axis=1)
    longer, turning, along = drift.errors(distance, turns, generator)
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
