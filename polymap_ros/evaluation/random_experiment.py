"""Trials on random scenes."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from polymap_ros.evaluation.trials import Trial, run_trials
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.parameters import Parameters


@dataclass(frozen=True)
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
    snr_db : float or None
        As in `Scene`.
    parameters : Parameters
        What the scene does not prescribe.
    """

    variant: str
    seeds: Sequence[int]
    edges: Sequence[int]
    methods: Sequence[str]
    snr_db: float | None
    parameters: Parameters

    def scenes(self) -> list[tuple[int, int]]:
        """Seed and number of edges of every scene."""
        return [(seed, edges) for seed in self.seeds for edges in self.edges]

    def run_one(self, seed: int, edges: int) -> list[Trial]:
        """The trials of one scene."""
        variant = VARIANTS[self.variant]
        scene = dataclasses.replace(variant.make(seed, edges), snr_db=self.snr_db)
        return run_trials(scene, self.methods, self.parameters, variant.tolerance_m)


def in_order(trials: Sequence[Trial]) -> list[Trial]:
    """Sorted by seed, edges and method, so that the files do not depend on who was done first."""
    return sorted(trials, key=lambda trial: (trial.seed, trial.edges, trial.method, trial.run))
