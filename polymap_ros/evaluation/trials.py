"""One trial: a simulated scene, one method, and how far its answer is from the truth."""

import dataclasses
import functools
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.inside_error import InsideComparison, compare_inside
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.polygon_error import ANGLE_TOLERANCE_RAD, Comparison, compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.warm_up import warm_up
from polymap_ros.parameters import Parameters
from polymap_ros.results.dimensions import dimensions
from polymap_ros.simulation.inside import Hole
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import pings
from polymap_ros.solvers.estimate import Candidate, Estimate

TOLERANCE_M = 0.003
"""A wall is right within this at the middle of the true edge (and within 0.5 degrees)."""

HEIGHT_TOLERANCE_M = 0.01
"""Floor and ceiling are right within this."""

CERTAIN = 0.9
"""Of the edges with at least this likelihood at least as large a share is to be real."""


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
        As in `Comparison`, floor and ceiling within `HEIGHT_TOLERANCE_M` of the true ones, and no others; holes and
        inner walls as in `InsideComparison`.
    iou : float
        Overlap with the true polygon; 0 where no polygon closed.
    offsets_m, angles_deg : tuple of float
        Errors, as magnitudes, of the walls that were found: at the middle of the true edge, and in direction.
    z_r, z_theta : tuple of float
        Errors of r and theta of the same walls, over their standard deviations; empty where the method gives none.
    z_length, z_angle, z_area : tuple of float
        Likewise of the edges' lengths, the corners' angles and the area (one); of right polygons only.
    least_likelihood : float or None
        Of the polygon's edges; None where no polygon closed.
    certain_edges, certain_real : int
        Edges with a likelihood of at least `CERTAIN`, and how many of them are a true wall within the tolerances.
    cautions : tuple of str
        Codes of what the estimate warned of.
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
    z_r: tuple[float, ...]
    z_theta: tuple[float, ...]
    z_length: tuple[float, ...]
    z_angle: tuple[float, ...]
    z_area: tuple[float, ...]
    least_likelihood: float | None
    certain_edges: int
    certain_real: int
    cautions: tuple[str, ...]
    seconds: float

    @property
    def flagged(self) -> bool:
        """Whether the user was told that something is not as it should be."""
        return self.status != 'closed' or bool(self.cautions)

    def row(self) -> dict[str, object]:
        """The row of results.csv: errors as their median and maximum over the walls, None where no wall was found.

        z-scores, wall by wall, and the cautions' codes are joined by semicolons.
        """
        row = {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}
        row |= {name: ';'.join(f'{score:.3f}' for score in row[name]) for name in row if name.startswith('z_')}
        row['cautions'] = ';'.join(self.cautions)
        for name, errors in (('offset_m', row.pop('offsets_m')), ('angle_deg', row.pop('angles_deg'))):
            row[f'median_{name}'] = float(np.median(errors)) if errors else None
            row[f'max_{name}'] = max(errors, default=None)
        return row


@dataclass(frozen=True)
class KindTrial:
    """A trial and the kind of its scene."""

    kind: str
    trial: Trial

    def row(self) -> dict[str, object]:
        """The row of results.csv."""
        return {'kind': self.kind, **self.trial.row()}


def filled_mapper(
    scene: Scene, parameters: Parameters, clean: NDArray[np.float64] | None = None
) -> PolygonMapper:
    """A mapper that has heard all pings of a scene at the poses that the odometry reports; `clean` as in `simulate`."""
    mapper = PolygonMapper(scene.parameters(parameters), scene.recorded_pulse)
    feed(mapper, scene, clean)
    return mapper


def feed(mapper: PolygonMapper, scene: Scene, clean: NDArray[np.float64] | None = None) -> None:
    """Let a mapper hear all pings of a scene at the poses that the odometry reports; `clean` as in `simulate`.

    The device gives the kind of samples that the mapper takes.
    """
    scene = dataclasses.replace(scene, echo_kind=mapper.parameters.echo.kind)
    for ping, pose in zip(pings(scene, clean), scene.reported_poses(), strict=True):
        mapper.add_pose(ping.emission_ns, Pose(*pose.tolist()))
        mapper.add_ping(ping)
        if mapper.solve_due:
            mapper.solve()
    mapper.finish()


ready = functools.cache(warm_up)
"""Compile once per process what a method needs, so that `seconds` does not hold it."""


def run_trials(
    scene: Scene, methods: Sequence[str], parameters: Parameters, tolerance_m: float = TOLERANCE_M,
    clean: NDArray[np.float64] | None = None,
) -> list[Trial]:
    """Map the same scene by several methods; a wall is right within `tolerance_m` (see `compare`)."""
    trials = []
    for method in methods:
        chosen = parameters.replaced({'solver.method': method})
        ready(chosen)
        mapper = filled_mapper(scene, chosen, clean)
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
    edges = estimate.polygon.edges if estimate.polygon else ()
    certain = {index for index, edge in enumerate(edges) if edge.likelihood >= CERTAIN}
    real = _real(comparison, tolerance_m) if comparison else set()
    z_r, z_theta = _z_scores(estimate.polygon, scene, comparison) if estimate.polygon and comparison else ((), ())
    sizes = _z_sizes(estimate.polygon, scene, comparison) if estimate.polygon and comparison else ((), (), ())
    return Trial(
        scene=scene.name, seed=scene.seed, edges=len(scene.vertices), method=method, snr_db=scene.snr_db, run=run,
        status=estimate.status, estimated_edges=comparison.n_estimated if comparison else 0,
        right=bool(comparison and comparison.right and _heights_right(estimate, scene)
                   and inside_judged(estimate, scene, tolerance_m).right),
        iou=comparison.iou if comparison else 0.0,
        offsets_m=tuple(offsets), angles_deg=tuple(angles), z_r=z_r, z_theta=z_theta,
        z_length=sizes[0], z_angle=sizes[1], z_area=sizes[2],
        least_likelihood=min((edge.likelihood for edge in edges), default=None),
        certain_edges=len(certain), certain_real=len(certain & real),
        cautions=tuple(caution.code for caution in estimate.cautions), seconds=seconds)


def inside_judged(estimate: Estimate, scene: Scene, tolerance_m: float = TOLERANCE_M) -> InsideComparison:
    """Compare the holes and inner walls of an estimate in the odometry's frame with the scene's."""
    return compare_inside(
        [hole.vertices for hole in estimate.holes],
        [wall.ends for wall in estimate.inner_walls],
        [hole.vertices for hole in scene.holes if isinstance(hole, Hole)],
        [np.array((wall.start, wall.end)) for wall in scene.inner_walls], tolerance_m,
        true_circles=list(scene.circles))


def _heights_right(estimate: Estimate, scene: Scene) -> bool:
    """Whether floor and ceiling are as many as there are, and right."""
    found, true = estimate.storey.height_m, np.sort(scene.height.storey.height_m)
    return len(found) == len(true) and bool(np.all(np.abs(found - true) <= HEIGHT_TOLERANCE_M))


def _real(comparison: Comparison, tolerance_m: float) -> set[int]:
    """Estimated edges that are a true wall."""
    within = (np.abs(comparison.offsets_m) <= tolerance_m) & (np.abs(comparison.angles_rad) <= ANGLE_TOLERANCE_RAD)
    return set(comparison.matches[within].tolist())


def _z_scores(
    polygon: Candidate, scene: Scene, comparison: Comparison
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Errors of r and theta, in the odometry's frame, over their standard deviations, for the walls matched."""
    z_r, z_theta = [], []
    for (r, _), angle, match in zip(
            polygon_lines(scene.vertices), comparison.angles_rad, comparison.matches, strict=True):
        edge = polygon.edges[match]
        if match < 0 or not edge.r_std or not edge.theta_std:
            continue
        z_r.append(float((edge.r - r) / edge.r_std))
        z_theta.append(float(angle / edge.theta_std))
    return tuple(z_r), tuple(z_theta)


def _z_sizes(polygon: Candidate, scene: Scene, comparison: Comparison) -> tuple[tuple[float, ...], ...]:
    """Errors of lengths, angles and area of a right polygon, over their standard deviations where these are known."""
    if not comparison.right:
        return (), (), ()
    # In the order of the estimated edges; a wall's number says nothing about which of them comes first.
    found, true = dimensions(polygon), dimensions(Candidate(
        np.asarray(scene.vertices)[np.argsort(comparison.matches)], polygon.edges))
    scores = ((found.lengths_m - true.lengths_m) / found.length_stds_m,
              (found.angles_rad - true.angles_rad) / found.angle_stds_rad,
              np.array([(found.area_m2 - true.area_m2) / found.area_std_m2]))
    return tuple(tuple(each[np.isfinite(each)].tolist()) for each in scores)
