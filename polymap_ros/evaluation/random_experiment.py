"""Trials on random scenes."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.evaluation.trials import Trial, run_trials
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import driven


@dataclass(frozen=True, eq=False)
class RandomExperiment:
    """All methods on every scene of the seeds and numbers of edges.

    Parameters
    ----------
    variant : str
        One of `VARIANTS`.
    seeds, edges : sequences of int
        Every combination is one scene.
    methods : sequence of str
        Values of ``solver.method``.
    snrs_db : sequence of float or None
        As `Scene.snr_db`; every scene at each of them.
    parameters : Parameters
        What the scene does not prescribe.
    drive : ndarray, shape (N, 3), optional
        A recorded path, stretches of which take the place of the scenes' own (see `driven`).
    """

    variant: str
    seeds: Sequence[int]
    edges: Sequence[int]
    methods: Sequence[str]
    snrs_db: Sequence[float | None]
    parameters: Parameters
    drive: NDArray[np.float64] | None = None

    def scenes(self) -> list[tuple[int, int, float | None]]:
        """Seed, number of edges and SNR of every scene."""
        return [(seed, edges, snr_db) for seed in self.seeds for edges in self.edges for snr_db in self.snrs_db]

    def run_one(self, seed: int, edges: int, snr_db: float | None) -> list[Trial]:
        """The trials of one scene."""
        variant = VARIANTS[self.variant]
        scene = dataclasses.replace(variant.make(seed, edges), snr_db=snr_db)
        if self.drive is not None:
            scene = driven(scene, self.drive)
        return run_trials(scene, self.methods, self.parameters, variant.tolerance_m)


def in_order(trials: Sequence[Trial]) -> list[Trial]:
    """Sorted by seed, edges, SNR from high to low, and method: the files do not depend on who was done first."""
    return sorted(trials, key=lambda trial: (
        trial.seed, trial.edges, -np.inf if trial.snr_db is None else -trial.snr_db, trial.method, trial.run))
