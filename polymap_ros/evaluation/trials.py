"""One trial: a simulated scene, one method, and how far its answer is from the truth."""

import dataclasses
import functools
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from polymap_ros.mapping.comparison import compare
from polymap_ros.mapping.estimate import Estimate
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.pose import Pose
from polymap_ros.mapping.warm_up import warm_up
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import pings

TOLERANCE_M = 0.003
"""A wall is right within this at the middle of the true edge (and within 0.5 degrees)."""


@dataclass(frozen=True)
class Trial:
    """What came out of one trial.

    Parameters
    ----------
    scene : str
        Name of the scene.
    seed : int
        Seed of the scene.
    edges, estimated_edges : int
        True and estimated number; 0 where no polygon closed.
    method, status : str
        As in `Estimate`.
    snr_db : float or None
        As in `Scene`.
    run : int
        Repetition, where one scene is solved several times.
    right : bool
        As in `Comparison`.
    iou : float
        Overlap with the true polygon; 0 where no polygon closed.
    offsets_m, angles_deg : tuple of float
        Errors, as magnitudes, of the walls that were found: at the middle of the true edge, and in direction.
    seconds : float
        Time of the solve from scratch, without the simulation.
    """

    scene: str
    seed: int
    edges: int
    method: str
    snr_db: float | None
    run: int
    status: str
    estimated_edges: int
    right: bool
    iou: float
    offsets_m: tuple[float, ...]
    angles_deg: tuple[float, ...]
    seconds: float

    def row(self) -> dict[str, object]:
        """The row of results.csv: errors as their median and maximum over the walls, None where no wall was found."""
        row = {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}
        for name, errors in (('offset_m', row.pop('offsets_m')), ('angle_deg', row.pop('angles_deg'))):
            row[f'median_{name}'] = float(np.median(errors)) if errors else None
            row[f'max_{name}'] = max(errors, default=None)
        return row


def filled_mapper(scene: Scene, parameters: Parameters) -> PolygonMapper:
    """A mapper that has heard all pings of a scene at the poses that the odometry reports."""
    mapper = PolygonMapper(scene.parameters(parameters), scene.recorded_pulse)
    for ping, pose in zip(pings(scene), scene.reported_poses(), strict=True):
        mapper.add_pose(ping.emission_ns, Pose(*pose.tolist()))
        mapper.add_ping(ping)
    mapper.finish()
    return mapper


ready = functools.cache(warm_up)
"""Compile once per process what a method needs, so that `seconds` does not hold it."""


def run_trials(
    scene: Scene, methods: Sequence[str], parameters: Parameters, tolerance_m: float = TOLERANCE_M
) -> list[Trial]:
    """Map the same scene by several methods; a wall is right within `tolerance_m` (see `compare`)."""
    trials = []
    for method in methods:
        chosen = parameters.replaced({'solver.method': method})
        ready(chosen)
        mapper = filled_mapper(scene, chosen)
        started = time.perf_counter()
        estimate = mapper.solve()
        trials.append(judged(estimate, scene, method, time.perf_counter() - started, tolerance_m))
    return trials


def judged(
    estimate: Estimate, scene: Scene, method: str, seconds: float, tolerance_m: float = TOLERANCE_M, run: int = 0
) -> Trial:
    """Compare an estimate in the odometry's frame with the scene's truth."""
    comparison = compare(estimate.polygon.vertices, scene.vertices, tolerance_m) if estimate.polygon else None
    errors = np.abs([comparison.offsets_m, np.rad2deg(comparison.angles_rad)]) if comparison else np.empty((2, 0))
    offsets, angles = errors[:, np.isfinite(errors[0])].tolist()
    return Trial(
        scene=scene.name, seed=scene.seed, edges=len(scene.vertices), method=method, snr_db=scene.snr_db, run=run,
        status=estimate.status, estimated_edges=comparison.n_estimated if comparison else 0,
        right=bool(comparison and comparison.right), iou=comparison.iou if comparison else 0.0,
        offsets_m=tuple(offsets), angles_deg=tuple(angles), seconds=seconds)
