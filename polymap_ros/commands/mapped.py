"""One recording heard and solved, in `polymap_replay`: the mapper, the answer, and what is beside it."""

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from polymap_ros.commands import calibrating, console
from polymap_ros.errors import RecordingError
from polymap_ros.parameters import Parameters

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from polymap_ros.acoustics.pulse import RecordedPulse
    from polymap_ros.calibration.pulse_fit import FittedPulse
    from polymap_ros.calibration.session import Tape
    from polymap_ros.calibration.stages import Fit
    from polymap_ros.cautions import Caution
    from polymap_ros.geometry.pose import Pose
    from polymap_ros.mapping.mapper import PolygonMapper
    from polymap_ros.recordings.reading import Recording
    from polymap_ros.recordings.replay import Replay
    from polymap_ros.recordings.truth import TrueInside
    from polymap_ros.solvers.estimate import Candidate, Estimate

PROGRAM = 'polymap_replay'
T = TypeVar('T')


@dataclass(frozen=True)
class Mapped:
    """A recording that was heard and solved; `parameters` are those after a calibration."""

    recording: 'Recording'
    replay: 'Replay'
    mapper: 'PolygonMapper'
    parameters: Parameters
    estimate: 'Estimate'
    cautions: 'Sequence[Caution]'
    fit: 'Fit | None'
    pulse: 'FittedPulse | None'
    truth: 'NDArray[np.float64] | None'
    true_path: 'tuple[NDArray[np.int64], NDArray[np.float64]] | None'
    true_inside: 'TrueInside | None'

    @property
    def closed(self) -> 'Candidate | None':
        """The polygon, if it is the answer."""
        return self.estimate.polygon if self.estimate.status == 'closed' else None

    @property
    def complaints(self) -> 'list[Caution]':
        """What stderr tells: what keeps the polygon from closing, or what the recording or the map lacks."""
        from polymap_ros.cautions import causes

        known = [*self.estimate.cautions, *self.cautions]
        if self.closed is None:
            return causes(known)
        return [each for each in known if each.code.startswith(('recording_', 'map_'))]


def map_recording(recording: 'Recording', parameters: Parameters, arguments: argparse.Namespace) -> Mapped:
    """Hear the recording, calibrate where that is asked for, solve, and check what is in doubt."""
    from polymap_ros.calibration.pulse_fit import FittedPulse
    from polymap_ros.calibration.stages import Fit
    from polymap_ros.cautions import of_the_first_stage
    from polymap_ros.pulse_file import read_pulse
    from polymap_ros.recordings.truth import read_true_inside, read_true_path, read_truth
    from polymap_ros.results.folder import PULSE
    from polymap_ros.results.save import map_cautions

    name, interval_s = recording.path.name, (arguments.start, arguments.end)
    truth, true_path = _of_truth(read_truth, recording.path), _of_truth(read_true_path, recording.path)
    true_inside = None if truth is None else _of_truth(read_true_inside, recording.path)
    mapper, replay, tape = _heard(recording, parameters, interval_s)
    noted, fit, pulse = [], None, None
    if (what := calibrated(arguments)) and what != 'pulse':
        session = tape.session(read_pulse(parameters))
        fit = calibrating.found(session, what, name)
        noted += [calibrating.heard_directly(session)] if what == 'time zero' else []
        noted.append(calibrating.told(session, fit))
        if isinstance(fit, Fit):
            parameters = parameters.replaced(fit.values)
            mapper, replay, tape = _heard(recording, parameters, interval_s)
    if what == 'pulse':
        session = tape.session(read_pulse(parameters))
        result = calibrating.pulse_found(session, name)
        if isinstance(result, FittedPulse):
            parameters = parameters.replaced({'pulse.kind': 'file', 'pulse.path': PULSE})
            pulse, (mapper, replay, tape) = result, _heard(recording, parameters, interval_s, result.recorded)
        noted.append(calibrating.pulse_told(session, result))
    estimate = console.worked(mapper.solve, f'{name}: solving')
    if not noted and 'pulse_adapted' not in (each.code for each in estimate.cautions):
        noted += calibrating.checked(tape.session(read_pulse(parameters)), estimate, name)
    if mapper.plane and not mapper.plane.is_xy:
        truth = true_path = true_inside = None  # they are in the odometry's x and y
    truth, true_path, true_inside = _in_map_frame(mapper.origin, truth, true_path, true_inside)
    cautions = (*replay.cautions(), *noted, *map_cautions(estimate, parameters))
    estimate = dataclasses.replace(estimate, cautions=of_the_first_stage(estimate.cautions, cautions))
    return Mapped(recording, replay, mapper, parameters, estimate, cautions, fit if isinstance(fit, Fit) else None,
                  pulse, truth, true_path, true_inside)


def _of_truth(read: Callable[[Path], T | None], path: Path) -> T | None:
    """What is known to be true; a file that cannot be read costs the comparison, not the map."""
    try:
        return read(path)
    except RecordingError as error:
        console.complain(PROGRAM, f'warning: {error}; the map is not compared with it')
        return None


def _in_map_frame(
    origin: 'Pose | None', truth: 'NDArray[np.float64] | None',
    true_path: 'tuple[NDArray[np.int64], NDArray[np.float64]] | None', true_inside: 'TrueInside | None',
) -> """tuple[NDArray[np.float64] | None, tuple[NDArray[np.int64], NDArray[np.float64]] | None,
              TrueInside | None]""":
    """The ground truth, which is in the odometry's frame, where the map frame has another origin."""
    from polymap_ros.geometry.pose import Pose
    from polymap_ros.geometry.poses import in_frame

    if origin is None or origin == Pose(0.0, 0.0):
        return truth, true_path, true_inside
    frame = origin.inverse()
    return (None if truth is None else frame.apply(truth),
            None if true_path is None else (true_path[0], in_frame(true_path[1], frame)),
            None if true_inside is None else true_inside.moved(frame))


def calibrated(arguments: argparse.Namespace) -> str:
    """What is to be found from the recording itself; empty if nothing is."""
    asked = {'medium': arguments.calibrate, 'odometry': arguments.fit_odometry, 'time zero': arguments.fit_time_zero,
             'pulse': arguments.fit_pulse}
    return next((what for what, wanted in asked.items() if wanted), '')


def _heard(
    recording: 'Recording', parameters: Parameters, interval_s: 'tuple[float | None, float | None]',
    pulse: 'RecordedPulse | None' = None,
) -> 'tuple[PolygonMapper, Replay, Tape]':
    """A mapper that has taken the whole recording, and what it used."""
    from polymap_ros.calibration.session import Tape
    from polymap_ros.pulse_file import read_pulse
    from polymap_ros.recordings.replay import Replay
    from polymap_ros.results.loading import loaded_mapper

    mapper = loaded_mapper(parameters, pulse or read_pulse(parameters))
    tape = Tape(mapper)
    replay = Replay(recording, mapper, parameters, *interval_s)
    with console.progress(f'{recording.path.name}: reading', replay.total, 'msg') as advance:
        for _ in replay:
            advance(1)
            if mapper.solve_due:
                mapper.solve()
    return mapper, replay, tape
