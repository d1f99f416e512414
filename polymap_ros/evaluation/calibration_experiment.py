"""Wrong media and drifting odometry on random scenes: what is noticed, and what calibration makes of it."""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.calibration.diagnosis import diagnosis, doubtful
from polymap_ros.calibration.fit import calibrated_medium, calibrated_odometry
from polymap_ros.calibration.session import Tape
from polymap_ros.calibration.stages import Fit, Refusal
from polymap_ros.evaluation.tables import markdown, percent, unique
from polymap_ros.evaluation.trials import feed, judged, ready
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import MediumParameters, Parameters
from polymap_ros.simulation.doubtful_scenes import KINDS as DOUBTFUL
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import air_filled, mistaken, random_scene
from polymap_ros.simulation.scenes import Scene

T = TypeVar('T')

_TOLERANCE_M = {'lamb_a0': 0.003, 'constant': 0.01}
"""Within what a wall is right, in plates and in rooms of air."""

_STEEL = MediumParameters(longitudinal_speed_m_s=5960.0, shear_speed_m_s=3235.0)
_ALUMINIUM = MediumParameters(longitudinal_speed_m_s=6149.0, shear_speed_m_s=3097.0)


class Case(NamedTuple):
    """What is wrong: a text, the scene of a seed and a number of edges, and which of the two has to be named."""

    text: str
    make: Callable[[int, int], Scene]
    culprit: str = ''


def _side(seed: int) -> int:
    """-1 and 1 in turn, over even seeds and over odd ones."""
    return 1 if seed // 2 % 2 else -1


def _thickness(seed: int, edges: int) -> Scene:
    scene = random_scene(seed, edges)
    return mistaken(scene, thickness_m=scene.medium.thickness_m * (1.0 + 0.2 * _side(seed)))


def _material(seed: int, edges: int) -> Scene:
    true, told = (_ALUMINIUM, _STEEL)[::_side(seed)]
    return dataclasses.replace(random_scene(seed, edges), medium=true, told_medium=told)


def _speed(seed: int, edges: int) -> Scene:
    scene = air_filled(random_scene(seed, edges))
    return mistaken(scene, speed_m_s=scene.medium.speed_m_s * (1.0 + 0.2 * _side(seed)))


def _drift(seed: int, edges: int) -> Scene:
    return dataclasses.replace(random_scene(seed, edges), faults=Faults(yaw_drift_deg_m=2.0 * _side(seed)))


def _scale(seed: int, edges: int) -> Scene:
    return dataclasses.replace(random_scene(seed, edges), faults=Faults(odometry_scale=1.0 + 0.02 * _side(seed)))


CASES = {
    'thickness': Case('thickness 20 % off', _thickness, 'medium'),
    'material': Case('steel taken for aluminium, or the reverse', _material, 'medium'),
    'speed': Case('air, speed 20 % off', _speed, 'medium'),
    'yaw_drift': Case('yaw drift of 2 deg/m', _drift, 'odometry'),
    'odometry_scale': Case('odometry scale 2 % off', _scale, 'odometry'),
    'ordinary': Case('ordinary scenes', random_scene),
    'l_shape': Case('L-shaped outlines', lambda seed, edges: DOUBTFUL['l_shape'].make(seed, edges).scene),
    'position_noise': Case('position noise of 5 mm', lambda seed, edges: dataclasses.replace(
        random_scene(seed, edges), position_noise_m=0.005)),
    'straight': Case('straight path', lambda seed, edges: DOUBTFUL['straight'].make(seed, edges).scene),
}


@dataclass(frozen=True)
class CalibrationTrial:
    """What came out of one scene.

    Parameters
    ----------
    case : str
        Of `CASES`.
    seed, edges : int
        The scene.
    clean_right : bool
        Whether the map is right when nothing is wrong.
    flagged : bool
        Whether the map made with what was given came with a warning or did not close.
    named : str
        What the self-check named: medium, odometry or nothing.
    refused : str
        Why the calibration refused; empty if it did not.
    scale_error_percent : float or None
        Ranges, or positions, are too long by this after the calibration.
    drift_error_deg_m : float or None
        What is left of the yaw drift.
    scores : tuple of float
        Errors of scale and drift over their deviations, where the odometry was fitted, or of the one medium parameter.
    right : bool
        Whether the calibrated map is right.
    seconds : float
        Time of the calibration.
    """

    case: str
    seed: int
    edges: int
    clean_right: bool
    flagged: bool
    named: str
    refused: str
    scale_error_percent: float | None
    drift_error_deg_m: float | None
    scores: tuple[float, ...]
    right: bool
    seconds: float

    def row(self) -> dict[str, object]:
        """The row of results.csv."""
        row = {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}
        return row | {'scores': ';'.join(f'{score:.3f}' for score in self.scores)}


@dataclass(frozen=True)
class CalibrationExperiment:
    """Every case with every seed; the number of edges goes round with the seeds.

    Parameters
    ----------
    cases : sequence of str
        Of `CASES`.
    seeds, edges : sequences of int
        As many scenes per case as seeds.
    snr_db : float or None
        As in `Scene`.
    parameters : Parameters
        What the scene does not prescribe.
    """

    cases: Sequence[str]
    seeds: Sequence[int]
    edges: Sequence[int]
    snr_db: float | None
    parameters: Parameters

    def scenes(self) -> list[tuple[str, int, int]]:
        """Case, seed and number of edges of every scene."""
        return [(case, seed, self.edges[index % len(self.edges)])
                for case in self.cases for index, seed in enumerate(self.seeds)]

    def run_one(self, case: str, seed: int, edges: int) -> list[CalibrationTrial]:
        """The trial of one scene."""
        culprit = CASES[case].culprit
        scene = dataclasses.replace(CASES[case].make(seed, edges), snr_db=self.snr_db)
        clean = DOUBTFUL[case].make(seed, edges).clean if case in DOUBTFUL else None
        ready(self.parameters)
        mapper = PolygonMapper(scene.parameters(self.parameters), scene.recorded_pulse)
        tape = Tape(mapper)
        feed(mapper, scene, clean)
        estimate, session = mapper.solve(), tape.session(scene.recorded_pulse)
        started = time.perf_counter()
        named = diagnosis(session) if doubtful(estimate) else None
        result: Fit | Refusal | None = named
        if culprit not in ('', _culprit(named)) or case == 'straight':
            result = calibrated_odometry(session) if culprit == 'odometry' else calibrated_medium(session)
        seconds = time.perf_counter() - started
        fit = result if isinstance(result, Fit) and culprit else None
        clean_scene = dataclasses.replace(scene, told_medium=None, faults=Faults())
        return [CalibrationTrial(
            case, seed, edges, bool(culprit) and self._right(clean_scene, {}),
            estimate.status != 'closed' or bool(estimate.cautions), _culprit(named),
            '; '.join(filter(None, (result.reason, result.remedy))) if isinstance(result, Refusal) else '',
            *_errors(scene, fit),
            fit is not None and self._right(scene, fit.values), seconds)]

    def _right(self, scene: Scene, values: Mapping[str, float]) -> bool:
        """Whether the map made with some values replaced is right."""
        mapper = PolygonMapper(scene.parameters(self.parameters).replaced(values), scene.recorded_pulse)
        feed(mapper, scene)
        return judged(mapper.solve(), scene, 'evidence', 0.0, _TOLERANCE_M[scene.medium.model]).right


def _errors(scene: Scene, fit: Fit | None) -> tuple[float | None, float | None, tuple[float, ...]]:
    """What is left of the error of scale [%] and of the drift [deg/m], and errors over deviations."""
    if fit is None:
        return None, None, ()
    if _culprit(fit) == 'odometry':
        true = {'odometry.scale': scene.faults.odometry_scale, 'odometry.yaw_drift_deg_m': scene.faults.yaw_drift_deg_m}
        errors = {name: fit.values[name] - true[name] for name in true}
        return (100.0 * errors['odometry.scale'] / scene.faults.odometry_scale, errors['odometry.yaw_drift_deg_m'],
                tuple(error / fit.deviations[name] for name, error in errors.items()))
    found = scene.parameters().replaced(fit.values).medium
    speeds = [float(group_speed(make_medium(medium), scene.pulse.frequency_hz)) for medium in (found, scene.medium)]
    name = next(iter(fit.values))
    true_value = getattr(scene.medium, name.partition('.')[2])
    # With two numbers the one that is kept, and wrong, shifts both.
    scores = ((fit.values[name] - true_value) / fit.deviations[name],) if len(fit.values) == 1 else ()
    return 100.0 * float(np.log(speeds[0] / speeds[1])), None, scores


def _culprit(fit: Fit | None) -> str:
    return '' if fit is None else next(iter(fit.values)).partition('.')[0]


def calibration_table(trials: Sequence[CalibrationTrial]) -> str:
    """By case: what was flagged and named, what the calibration found, and whether the map is right then."""
    header = ['case', 'scenes', 'flagged', 'rightly named', 'wrongly named', 'refused',
              'scale error [%] 50 / 95 / 100 %', 'drift error [deg/m] 50 / 95 / 100 %', 'within 2 sigma', 'right',
              'right without the fault', 'median time [s]']
    rows = []
    for case in unique(trial.case for trial in trials):
        group = [trial for trial in trials if trial.case == case]
        culprit = CASES[case].culprit
        scores = [score for trial in group for score in trial.scores]
        rows.append([
            CASES[case].text, str(len(group)), _share([trial.flagged for trial in group]),
            _share([trial.named == culprit for trial in group]) if culprit else '-',
            _share([trial.named not in ('', culprit) for trial in group]),
            _share([bool(trial.refused) for trial in group]),
            _spread([trial.scale_error_percent for trial in group], 4),
            _spread([trial.drift_error_deg_m for trial in group], 4),
            _share([abs(score) <= 2.0 for score in scores]),
            _share([trial.right for trial in group]) if culprit else '-',
            _share([trial.clean_right for trial in group]) if culprit else '-',
            f'{np.median([trial.seconds for trial in group]):.1f}'])
    return markdown(header, rows)


def _share(values: Sequence[bool]) -> str:
    return percent(float(np.mean(values))) if values else '-'


def _spread(errors: Sequence[float | None], digits: int) -> str:
    known = np.abs([error for error in errors if error is not None])
    if known.size == 0:
        return '-'
    return ' / '.join(f'{value:.{digits}f}' for value in np.quantile(known, (0.5, 0.95, 1.0)))
