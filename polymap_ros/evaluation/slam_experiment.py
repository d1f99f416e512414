"""Odometry that drifts: is the polygon right once the path lies on the true one, and how far is the path off."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.evaluation.tables import interval, markdown, percent, unique
from polymap_ros.evaluation.trials import Trial, feed, judged, ready
from polymap_ros.evaluation.variants import VARIANTS, Variant
from polymap_ros.geometry.alignment import PathError, alignment, path_error
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters, SensorParameters
from polymap_ros.simulation.random_scenes import Recipe, random_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.solvers.estimate import Estimate

INFORMATIVE = {'odometry_drift', 'slip'}
"""Cautions that say what was corrected: they do not make a wrong answer a flagged one."""


@dataclass(frozen=True)
class DriftCase(Variant):
    """A kind of scene, and the parameters with which it is mapped."""

    parameters: tuple[tuple[str, object], ...] = ()


def with_faults(scene: Scene, **faults: object) -> Scene:
    """Return a scene with these faults besides its own."""
    return dataclasses.replace(scene, faults=dataclasses.replace(scene.faults, **faults))  # type: ignore[arg-type]


def _with(make: Callable[[int, int], Scene], **faults: object) -> Callable[[int, int], Scene]:
    return lambda seed, edges: with_faults(make(seed, edges), **faults)


def _off_axis(seed: int, edges: int) -> Scene:
    return dataclasses.replace(random_scene(seed, edges), sensor=SensorParameters(x_m=0.03, y_m=0.04))


def _of_pings(count: int) -> Callable[[int, int], Scene]:
    return lambda seed, edges: random_scene(seed, edges, Recipe(pings=count))


CASES = {
    'none': DriftCase('exact odometry', random_scene),
    'mild': DriftCase('mild', _with(random_scene, drift='mild')),
    'typical': DriftCase('typical', _with(random_scene, drift='typical')),
    'mild_echoes': DriftCase('typical, with ' + VARIANTS['mild'].text, _with(VARIANTS['mild'].make, drift='typical')),
    'bad': DriftCase('bad', _with(random_scene, drift='bad')),
    'wheels': DriftCase('two wheels, each erring by itself', _with(random_scene, drift='wheels')),
    'slip': DriftCase('mild, a slip of 5 cm and 5 deg', _with(random_scene, drift='mild', slip_m=0.05, slip_deg=5.0)),
    'push': DriftCase('mild, a slip of 20 cm and 20 deg', _with(random_scene, drift='mild', slip_m=0.2, slip_deg=20.0)),
    'position_noise': DriftCase('position noise of 5 mm, each ping by itself', VARIANTS['position_noise'].make),
    'pings_20': DriftCase('typical, 20 pings', _with(VARIANTS['pings_20'].make, drift='typical')),
    'pings_30': DriftCase('typical, 30 pings', _with(_of_pings(30), drift='typical')),
    'pings_200': DriftCase('typical, 200 pings', _with(_of_pings(200), drift='typical')),
    'pings_1000': DriftCase('typical, 1,000 pings', _with(_of_pings(1000), drift='typical')),
    'edge_fading': DriftCase('typical, echoes that fade at the ends of walls, and corners that diffract',
                             _with(VARIANTS['edge_fading'].make, drift='typical')),
    'lossy': DriftCase('typical, reflection coefficients of 0.5 to 1 and random sign per edge',
                       _with(VARIANTS['lossy'].make, drift='typical')),
    'gain': DriftCase('typical, gain of the echoes varying by 6 dB', _with(VARIANTS['gain'].make, drift='typical')),
    'off_axis': DriftCase('typical, sensor 5 cm off the axis', _with(_off_axis, drift='typical')),
    'apart': DriftCase('typical, emitter and receiver 5 cm apart', _with(VARIANTS['apart'].make, drift='typical')),
    'air': DriftCase('typical, rooms of 4 to 8 m, air, 20 kHz burst',
                     _with(VARIANTS['air'].make, drift='typical'), VARIANTS['air'].tolerance_m),
    'air_magnitudes': DriftCase('the same, magnitudes', _with(VARIANTS['air'].make, drift='typical'),
                                VARIANTS['air'].tolerance_m, (('echo.kind', 'envelope'),)),
}
"""By name; drift levels as in the simulator."""


@dataclass(frozen=True)
class SlamTrial:
    """A trial whose polygon was judged once the path was brought onto the true one.

    Parameters
    ----------
    case : str
        Of `CASES`.
    trial : Trial
        Of the aligned polygon; `seconds` are of CPU, of hearing and solving.
    odometry, path : PathError
        Of the reported and of the estimated path, aligned each.
    corrected : bool
        Whether poses were estimated.
    lost : int
        Pings that are lost.
    gauge_z : tuple of float
        Errors of r and theta of the walls over their deviations, with the odometry's first pose exact by definition.
    """

    case: str
    trial: Trial
    odometry: PathError
    path: PathError
    corrected: bool
    lost: int
    gauge_z: tuple[float, ...]

    @property
    def silently_wrong(self) -> bool:
        """Whether the answer is closed and wrong, and nothing but the correction itself was told."""
        return (not self.trial.right and self.trial.status == 'closed'
                and not set(self.trial.cautions) - INFORMATIVE)

    def row(self) -> dict[str, object]:
        """The row of results.csv."""
        paths = {f'{name}_{entry}': value for name, error in (('odometry', self.odometry), ('path', self.path))
                 for entry, value in error._asdict().items()}
        return {'case': self.case, **self.trial.row(), **paths, 'corrected': self.corrected, 'lost': self.lost,
                'gauge_z': ';'.join(f'{score:.3f}' for score in self.gauge_z)}


@dataclass(frozen=True)
class SlamExperiment:
    """Every case with every seed and number of edges; parameters as in `DoubtExperiment`."""

    cases: Sequence[str]
    seeds: Sequence[int]
    edges: Sequence[int]
    snr_db: float | None
    parameters: Parameters

    def scenes(self) -> list[tuple[str, int, int]]:
        """Case, seed and number of edges of every scene."""
        return [(case, seed, edges) for case in self.cases for seed in self.seeds for edges in self.edges]

    def run_one(self, case: str, seed: int, edges: int) -> list[SlamTrial]:
        """The trial of one scene."""
        kind = CASES[case]
        scene = dataclasses.replace(kind.make(seed, edges), snr_db=self.snr_db)
        parameters = self.parameters.replaced(dict(kind.parameters))
        ready(parameters)
        started = time.process_time()
        mapper = PolygonMapper(scene.parameters(parameters), scene.recorded_pulse)
        feed(mapper, scene)
        estimate = mapper.solve()
        return [slam_trial(case, scene, estimate, time.process_time() - started, kind.tolerance_m)]


class Aligned(NamedTuple):
    """Poses (N, 3) of all pings of a scene, which of them are not lost (N,), and the motion that brings them there."""

    poses: NDArray[np.float64]
    places: NDArray[np.bool_]
    motion: Pose


def aligning(estimate: Estimate, scene: Scene) -> Aligned:
    """Return the path of an answer, the reported one where it has none, and what brings it onto the true one."""
    poses, places = scene.reported_poses(), np.ones(len(scene.poses), np.bool_)
    if estimate.trajectory is not None:
        poses = np.array(poses)
        numbers = np.searchsorted(scene.stamps_ns, estimate.trajectory.stamps_ns)
        poses[numbers] = estimate.trajectory.poses
        places = np.zeros(len(scene.poses), np.bool_)
        places[numbers[~estimate.trajectory.lost]] = True
    return Aligned(poses, places, alignment(poses[places, :2], scene.poses[places, :2]))


def slam_trial(case: str, scene: Scene, estimate: Estimate, seconds: float, tolerance_m: float) -> SlamTrial:
    """Judge an answer and its path."""
    true, reported = scene.poses, scene.reported_poses()
    poses, places, motion = aligning(estimate, scene)
    trial = judged(estimate.moved(motion), scene, 'evidence', seconds, tolerance_m)
    by_odometry = alignment(reported[:, :2], true[:, :2])
    gauge = _gauge(estimate, scene) if estimate.polygon and trial.right else ()
    return SlamTrial(
        case, trial, path_error(reported, true, by_odometry), path_error(poses[places], true[places], motion),
        estimate.trajectory is not None, int(np.sum(estimate.trajectory.lost)) if estimate.trajectory else 0, gauge)


def _gauge(estimate: Estimate, scene: Scene) -> tuple[float, ...]:
    """Errors over deviations where the truth is moved by the odometry's first pose, which is exact by definition."""
    first = judged(estimate, scene, 'evidence', 0.0, np.inf)
    return (*first.z_r, *first.z_theta)


def slam_table(trials: Sequence[SlamTrial]) -> str:
    """By case: right with its 95 % interval (Wilson 1927), path errors of right scenes, what is told, CPU time.

    A scene is silently wrong if it is closed and wrong, and tells of nothing but the correction.
    """
    header = ['case', 'right', '95 % interval', 'odometry ATE [mm] median / worst', 'ATE [mm] median / worst scene',
              'worst ping [mm]', 'heading rms [deg]', 'silently wrong', 'open', 'lost pings', 'within 2 / 3 sigma',
              'CPU [s] median / 95 % / worst']
    rows = []
    for case in unique(entry.case for entry in trials):
        group = [entry for entry in trials if entry.case == case]
        right = [entry for entry in group if entry.trial.right]
        z = np.abs([score for entry in right for score in entry.gauge_z])
        rows.append([
            CASES[case].text, f'{len(right)} of {len(group)}', interval(len(right), len(group)),
            _pair([1e3 * entry.odometry.ate_m for entry in group], 0),
            _pair([1e3 * entry.path.ate_m for entry in right], 2),
            _worst([1e3 * entry.path.worst_m for entry in right], 2),
            _pair([np.rad2deg(entry.path.heading_rad) for entry in right], 2),
            str(sum(entry.silently_wrong for entry in group)),
            str(sum(entry.trial.status != 'closed' for entry in group)), str(sum(entry.lost for entry in group)),
            f'{percent(np.mean(z <= 2.0).item())} / {percent(np.mean(z <= 3.0).item())}' if len(z) else '-',
            ' / '.join(f'{value:.1f}' for value in np.quantile(
                [entry.trial.seconds for entry in group], (0.5, 0.95, 1.0)))])
    return markdown(header, rows)


def path_failures(trials: Sequence[SlamTrial]) -> str:
    """The scenes that are not right, as edges-seed with their status and cautions."""
    lines = [f'- {entry.case} {entry.trial.edges}-{entry.trial.seed}: '
             f'{", ".join((entry.trial.status, *entry.trial.cautions))}'
             f'{" (silently wrong)" if entry.silently_wrong else ""}'
             for entry in trials if not entry.trial.right]
    return '\n'.join(lines) or '- none'


def _pair(values: Sequence[float], digits: int) -> str:
    return f'{np.median(values):.{digits}f} / {max(values):.{digits}f}' if values else '-'


def _worst(values: Sequence[float], digits: int) -> str:
    return f'{max(values):.{digits}f}' if values else '-'
