"""A drive for as long as one likes: round and round in a plate, with the pings of one round."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.trajectories import fitted
from polymap_ros.simulation.waveforms import simulate

PLATE = 'pentagon'
CLEARANCE_M = 0.08
ROUND_S = 30.0


@dataclass(frozen=True, eq=False)
class RoundTrip:
    """An oval in the pentagonal plate, driven once in `ROUND_S`.

    Parameters
    ----------
    ping_hz : float
        Pings per second [Hz].
    n_samples : int
        Samples per ping.
    """

    ping_hz: float
    n_samples: int

    @property
    def pings_per_round(self) -> int:
        """Pings after which the same ones come again."""
        return max(1, round(ROUND_S * self.ping_hz))

    def poses(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Poses (n, 3) at times [s] since the first ping."""
        turn = 2.0 * np.pi * times_s * self.ping_hz / self.pings_per_round
        x, y = 1.5 * np.cos(turn), np.sin(turn) + 0.2 * np.sin(2.0 * turn)
        yaw = np.arctan2(np.cos(turn) + 0.4 * np.cos(2.0 * turn), -1.5 * np.sin(turn))
        scale, first = self._placed
        return np.column_stack((scale * x + first[0], scale * y + first[1], np.unwrap(yaw)))

    @cached_property
    def _placed(self) -> tuple[float, NDArray[np.float64]]:
        """By how much the oval is scaled to fit into the plate, and where its middle then is [m]."""
        turn = 2.0 * np.pi * np.arange(360) / 360
        outline = np.column_stack((1.5 * np.cos(turn), np.sin(turn) + 0.2 * np.sin(2.0 * turn), np.zeros(360)))
        placed = fitted(outline, load_scene(PLATE).vertices, CLEARANCE_M)[:, :2]
        scale = np.ptp(placed[:, 0]) / np.ptp(outline[:, 0])
        return float(scale), placed[0] - scale * outline[0, :2]

    def samples(self) -> NDArray[np.float32]:
        """The pings of one round, shape (pings_per_round, n_samples)."""
        times_s = np.arange(self.pings_per_round) / self.ping_hz
        plate = load_scene(PLATE)
        scene = Scene(f'{PLATE}, round and round', plate.vertices, self.poses(times_s), n_samples=self.n_samples)
        return simulate(scene).astype(np.float32)
