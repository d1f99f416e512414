"""Estimates after every ping of a run: how soon they are right, whether they stay right, and what they cost."""

import dataclasses
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from polymap_ros.evaluation.trials import ready
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import pings
from polymap_ros.solvers.estimate import Estimate

FROM_SCRATCH = ('paper', 'rectangle')
"""Methods of which every solve starts anew; the others go on from their last answer."""


@dataclass(frozen=True)
class OnlineRun:
    """One method on one scene, ping by ping.

    Parameters
    ----------
    scene : str
        Name of the scene.
    seed, edges : int
        Of the scene; true number of edges.
    method : str
        Value of ``solver.method``.
    snr_db : float or None
        As in `Scene`.
    right : tuple of bool
        After each ping, whether the polygon was right, as in `Comparison`.
    flagged : tuple of bool
        After each ping, whether no polygon closed or the estimate came with a caution.
    seconds : tuple of float
        Time of each solve.
    """

    scene: str
    seed: int
    edges: int
    method: str
    snr_db: float | None
    right: tuple[bool, ...]
    flagged: tuple[bool, ...]
    seconds: tuple[float, ...]

    @property
    def pings_until_right(self) -> int | None:
        """Pings heard when the estimate was right for the first time; None: never."""
        return self.right.index(True) + 1 if True in self.right else None

    @property
    def flips(self) -> int:
        """How often the estimate was right after one ping and no longer after the next."""
        return sum(before and not after for before, after in zip(self.right, self.right[1:], strict=False))

    @property
    def silently_wrong(self) -> int:
        """Estimates that were wrong without a word."""
        return sum(not right and not flagged for right, flagged in zip(self.right, self.flagged, strict=True))

    @property
    def warm_seconds(self) -> tuple[float, ...]:
        """Time of the solves after the first right one; all of them where there is none."""
        return self.seconds[self.pings_until_right or 0:] or self.seconds

    def row(self) -> dict[str, object]:
        """The row of results.csv; right and flagged as a digit per ping."""
        row = {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}
        seconds = row.pop('seconds')
        row |= {name: ''.join(str(int(value)) for value in row[name]) for name in ('right', 'flagged')}
        return row | {
            'pings': len(self.right), 'right_at_the_end': self.right[-1], 'pings_until_right': self.pings_until_right,
            'flips': self.flips, 'silently_wrong': self.silently_wrong, 'median_seconds': float(np.median(seconds)),
            'p95_seconds': float(np.quantile(seconds, 0.95)), 'max_seconds': max(seconds),
            'median_warm_seconds': float(np.median(self.warm_seconds)),
            'p95_warm_seconds': float(np.quantile(self.warm_seconds, 0.95))}


@dataclass(frozen=True)
class OnlineExperiment:
    """All methods on every scene of the seeds and numbers of edges; parameters as in `RandomExperiment`."""

    variant: str
    seeds: Sequence[int]
    edges: Sequence[int]
    methods: Sequence[str]
    snr_db: float | None
    parameters: Parameters

    def scenes(self) -> list[tuple[int, int]]:
        """Seed and number of edges of every scene."""
        return [(seed, edges) for seed in self.seeds for edges in self.edges]

    def run_one(self, seed: int, edges: int) -> list[OnlineRun]:
        """The runs of one scene."""
        variant = VARIANTS[self.variant]
        scene = dataclasses.replace(variant.make(seed, edges), snr_db=self.snr_db)
        return [run_online(scene, self.parameters.replaced({'solver.method': method}), variant.tolerance_m)
                for method in self.methods]


def run_online(scene: Scene, parameters: Parameters, tolerance_m: float) -> OnlineRun:
    """Solve after every ping of a scene."""
    ready(parameters)
    right, flagged, seconds = [], [], []
    for estimate, duration_s in estimates(scene, parameters):
        polygon = estimate.polygon
        right.append(polygon is not None and compare(polygon.vertices, scene.vertices, tolerance_m).right)
        flagged.append(estimate.status != 'closed' or bool(estimate.cautions))
        seconds.append(duration_s)
    return OnlineRun(scene.name, scene.seed, len(scene.vertices), parameters.solver.method, scene.snr_db,
                     tuple(right), tuple(flagged), tuple(seconds))


def estimates(scene: Scene, parameters: Parameters) -> Iterator[tuple[Estimate, float]]:
    """The estimate after each ping, and the time it took [s]."""
    mapper = PolygonMapper(scene.parameters(parameters), scene.recorded_pulse)
    for ping, pose in zip(pings(scene), scene.reported_poses(), strict=True):
        mapper.add_pose(ping.emission_ns, Pose(*pose.tolist()))
        mapper.add_ping(ping)
        if parameters.solver.method in FROM_SCRATCH:
            mapper.configure(mapper.parameters)
        started = time.perf_counter()
        estimate = mapper.solve()
        yield estimate, time.perf_counter() - started
