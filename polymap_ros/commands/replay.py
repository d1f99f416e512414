"""polymap_replay: a recording in, the polygon out."""

import argparse
import dataclasses
import os
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from polymap_ros.commands import console
from polymap_ros.errors import RecordingError, UsageError
from polymap_ros.parameters import Parameters

if TYPE_CHECKING:
    from polymap_ros.mapping.estimate import Caution, Estimate
    from polymap_ros.mapping.mapper import PolygonMapper
    from polymap_ros.mapping.session import Tape
    from polymap_ros.recordings.reading import Recording
    from polymap_ros.recordings.replay import Replay

PROGRAM = 'polymap_replay'
SLICE = 5
"""Iterations of the solver between two looks at the progress bar."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    console.one_core()
    arguments = _parser().parse_intermixed_args(argv)
    return console.execute(PROGRAM, lambda: _run(arguments))


def _parser() -> argparse.ArgumentParser:
    parser = console.Parser(
        PROGRAM, 'Map the polygon in one or more recordings, as fast as the machine goes. No ROS is needed.',
        'Exit status: 0 done; 1 no polygon closes, the reason is on stderr; 2 wrong usage, recording or parameter; '
        '130 interrupted, 143 terminated.')
    parser.add_argument('recordings', nargs='+', type=Path, metavar='RECORDING',
                        help='rosbag2 directory, or a bare .mcap or .db3 file; each is a map of its own')
    console.add_parameter_arguments(parser)
    parser.add_argument('--output', type=Path, metavar='DIR',
                        help='folder of the results, made where missing, earlier results in it are replaced; several '
                             'recordings go to DIR/<name>/ (default: the parameter output.dir, which is polymap)')
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--jobs', type=console.count, default=1, metavar='N',
                       help='recordings at a time, in processes of this machine (default: 1)')
    where.add_argument('--scheduler', metavar='ADDRESS',
                       help='work on the Dask cluster of this scheduler, such as tcp://host:8786; its workers read the '
                            'recordings and write DIR themselves, by the same absolute paths')
    parser.add_argument('--start', type=float, metavar='S', help='leave out what was logged before S seconds')
    parser.add_argument('--end', type=float, metavar='S', help='leave out what was logged from S seconds on')
    parser.add_argument('--plot', action='store_true',
                        help='write polygon.png: the mapped room beside the beamforming map')
    parser.add_argument('--plot-signals', action='store_true',
                        help='write signals.png: the pings as received, after each step of the front end, and as heard')
    parser.add_argument('--record', action='store_true',
                        help='write result.mcap: the odometry and all outputs, for Foxglove or RViz')
    parser.add_argument('--export', action='append', default=[], choices=('csv', 'geojson', 'dxf'), dest='exports',
                        help='write polygon.csv, polygon.geojson or polygon.dxf, in metres in the odometry frame, if a '
                             'polygon closes (csv: or the walls that are certain); may be repeated')
    which = parser.add_mutually_exclusive_group()
    which.add_argument('--calibrate', action='store_true',
                       help='find the medium from the recording (thickness, with the shear speed if need be, or the '
                            'constant speed), map with it, and write calibration.yaml, a parameter file')
    which.add_argument('--fit-odometry', action='store_true',
                       help="the same for the odometry's scale and yaw drift")
    which.add_argument('--fit-time-zero', action='store_true',
                       help='the same for echo.t0_s; what the direct wave says of it is told, too')
    parser.add_argument('--save-map', action='store_true', help='write beam_map.npz: the beamforming map')
    return parser


def _run(arguments: argparse.Namespace) -> int:
    parameters = console.read_parameters(arguments)
    start_s, end_s = arguments.start, arguments.end
    if not (start_s is None or start_s >= 0.0) or not (end_s is None or end_s > (start_s or 0.0)):
        raise UsageError(f'--start {start_s} --end {end_s}: allowed: 0 <= start < end, in seconds after the first '
                         'message')
    if parameters.output.load_path and (what := _calibrated(arguments)):
        option = {'medium': 'calibrate', 'odometry': 'fit-odometry', 'time zero': 'fit-time-zero'}[what]
        raise UsageError(f'--{option} starts from a recording alone; leave output.load_path out')
    folders = _folders(arguments.recordings, arguments.output or Path(parameters.output.dir))
    _spare(folders, arguments.params_file)
    if arguments.plot or arguments.plot_signals:
        from polymap_ros.results.picture import require_matplotlib

        require_matplotlib()
    if 'dxf' in arguments.exports:
        from polymap_ros.results.export import require_ezdxf

        require_ezdxf()
    if arguments.scheduler:
        parameters, folders = _anywhere(parameters, folders)
    jobs = [(recording, folder, parameters, arguments) for recording, folder in folders.items()]
    if arguments.scheduler or min(arguments.jobs, len(jobs)) > 1:
        from polymap_ros.commands.fleet import run_all

        return run_all(PROGRAM, _attempt, jobs, min(arguments.jobs, len(jobs)), arguments.scheduler)
    return max(_attempt(*job) for job in jobs)


def _anywhere(parameters: Parameters, folders: dict[Path, Path]) -> tuple[Parameters, dict[Path, Path]]:
    """The same files whatever folder a process works in."""
    state = parameters.output.load_path
    placed = parameters.replaced({'output.load_path': str(Path(state).absolute())}) if state else parameters
    return (dataclasses.replace(placed, folder=parameters.folder.absolute()),
            {recording.absolute(): folder.absolute() for recording, folder in folders.items()})


def _attempt(path: Path, folder: Path, parameters: Parameters, arguments: argparse.Namespace) -> int:
    return console.attempt(PROGRAM, lambda: _replay(path, folder, parameters, arguments))


def _folders(recordings: Sequence[Path], output: Path) -> dict[Path, Path]:
    """Where the results of each recording go."""
    if len(recordings) == 1:
        return {recordings[0]: output}
    names = [path.stem if path.suffix in ('.mcap', '.db3') else Path(os.path.abspath(path)).name  # noqa: PTH100, with no ..
             for path in recordings]
    for path, name in zip(recordings, names, strict=True):
        if name in ('', '.', '..'):
            raise UsageError(f'{path}: has no name that its folder in {output} could have; replay it by itself')
        if names.count(name) > 1:
            raise UsageError(f'{names.count(name)} recordings are called {name}, which names their folder in {output}; '
                             'replay them one by one with an --output each')
    return {path: output / name for path, name in zip(recordings, names, strict=True)}


def _spare(folders: dict[Path, Path], parameter_file: Path | None) -> None:
    """Refuse to write where results would take the place of what is read."""
    from polymap_ros.recordings.layout import layout_of
    from polymap_ros.results.folder import NAMES, holds_foreign

    read = [parameter_file] if parameter_file else []
    for recording in folders:
        with suppress(RecordingError, OSError):  # told when it is its turn
            read += layout_of(recording).files
    kept = {os.path.realpath(path) for path in read}
    for folder in folders.values():
        for name in NAMES:
            if os.path.realpath(folder / name) in kept:
                raise UsageError(f'{folder / name}: is read, and the results would take its place; choose another '
                                 '--output')
        if foreign := holds_foreign(folder):
            raise UsageError(f'{folder}: holds {", ".join(foreign)} and no polygon.json, so that is not of an earlier '
                             'run, and the results would take its place; choose another --output')


def _replay(path: Path, folder: Path, parameters: Parameters, arguments: argparse.Namespace) -> int:
    from polymap_ros.commands import calibrating
    from polymap_ros.mapping.calibration import Fit
    from polymap_ros.mapping.comparison import compare
    from polymap_ros.pulse_file import read_pulse
    from polymap_ros.recordings.outcome import write_outcome
    from polymap_ros.recordings.reading import Recording
    from polymap_ros.recordings.replay import some_pings
    from polymap_ros.recordings.truth import read_truth
    from polymap_ros.results.calibration_yaml import calibration_yaml
    from polymap_ros.results.folder import CALIBRATION, RECORD, SIGNALS, result_folder
    from polymap_ros.results.save import write_results
    from polymap_ros.results.signal_picture import signals_png
    from polymap_ros.results.summary import summary

    began_s = time.monotonic()
    console.tell_compiling(PROGRAM)
    interval_s = arguments.start, arguments.end
    with Recording.open(path) as recording:
        truth = read_truth(path)
        mapper, replay, tape = _heard(recording, parameters, interval_s)
        noted, fit = [], None
        if what := _calibrated(arguments):
            session = tape.session(read_pulse(parameters))
            fit = calibrating.found(session, what, path.name)
            noted += [calibrating.heard_directly(session)] if what == 'time zero' else []
            noted.append(calibrating.told(session, fit))
            if isinstance(fit, Fit):
                parameters = parameters.replaced(fit.values)
                mapper, replay, tape = _heard(recording, parameters, interval_s)
        estimate = _solve(mapper, parameters, path.name)
        if not noted:
            noted += calibrating.checked(tape.session(read_pulse(parameters)), estimate, path.name)
        cautions = [*replay.cautions(), *noted]
        frame = mapper.frame_id
        if mapper.plane and not mapper.plane.is_xy:
            frame, truth = f'the plane of the first pose in {frame}', None  # the truth is in the odometry's x and y
        with result_folder(folder) as stage:
            write_results(stage, mapper, estimate, parameters, cautions=cautions, truth=truth,
                          plot=arguments.plot, save_map=arguments.save_map, exports=arguments.exports)
            if isinstance(fit, Fit):
                (stage / CALIBRATION).write_bytes(calibration_yaml(fit.values, fit.deviations))
            if arguments.plot_signals:
                pings = some_pings(recording, replay.echo_topic, parameters, *interval_s)
                (stage / SIGNALS).write_bytes(signals_png(mapper, pings))
            if arguments.record:
                write_outcome(stage / RECORD, recording, replay.odom_topic, mapper, parameters, *interval_s)
    closed = estimate.polygon if estimate.status == 'closed' else None
    comparison = compare(closed.vertices, truth) if closed and truth is not None else None
    console.tell(f'{path}: {summary(estimate, frame, mapper.counts, cautions, comparison)}')
    console.tell(f'odometry: {replay.odometry.received} received, {replay.odometry.used} used')
    if missing := [name for kind in arguments.exports if not (folder / (name := f'polygon.{kind}')).exists()]:
        console.tell(f'no {", ".join(missing)}: there is no polygon to export')
    console.tell(f'{time.monotonic() - began_s:.1f} s; results in {folder}')
    if closed is None:
        console.complain(PROGRAM, f'{path}: {_reason(estimate, mapper, cautions)}')
        return console.NO_POLYGON
    for caution in cautions:
        if caution.code.startswith('recording_'):
            console.complain(PROGRAM, f'warning: {path}: {caution.text}')
    return console.DONE


def _calibrated(arguments: argparse.Namespace) -> str:
    """What is to be found from the recording itself; empty if nothing is."""
    asked = {'medium': arguments.calibrate, 'odometry': arguments.fit_odometry, 'time zero': arguments.fit_time_zero}
    return next((what for what, wanted in asked.items() if wanted), '')


def _heard(
    recording: 'Recording', parameters: Parameters, interval_s: 'tuple[float | None, float | None]'
) -> 'tuple[PolygonMapper, Replay, Tape]':
    """A mapper that has taken the whole recording, and what it used."""
    from polymap_ros.mapping.session import Tape
    from polymap_ros.recordings.replay import Replay

    mapper = _make_mapper(parameters)
    tape = Tape(mapper)
    replay = Replay(recording, mapper, parameters, *interval_s)
    with console.progress(f'{recording.path.name}: reading', replay.total, 'msg') as advance:
        for _ in replay:
            advance(1)
    return mapper, replay, tape


def _make_mapper(parameters: Parameters) -> 'PolygonMapper':
    """A fresh mapper, or one that continues the saved state of `output.load_path`."""
    from polymap_ros.mapping.mapper import PolygonMapper
    from polymap_ros.pulse_file import read_pulse
    from polymap_ros.results.arrays import naming, read_state

    pulse = read_pulse(parameters)
    if path := parameters.output.load_path:
        state = read_state(Path(path))
        with naming(path):
            return PolygonMapper.from_state(parameters, state, pulse)
    return PolygonMapper(parameters, pulse)


def _solve(mapper: 'PolygonMapper', parameters: Parameters, name: str) -> 'Estimate':
    total = parameters.solver.iterations if parameters.solver.method == 'paper' else None
    mapper.begin_solve()
    with console.progress(f'{name}: solving', total) as advance:
        done = False
        while not done:
            done = mapper.advance(SLICE)
            advance(SLICE)
    assert mapper.estimate is not None
    return mapper.estimate


def _reason(estimate: 'Estimate', mapper: 'PolygonMapper', cautions: 'Sequence[Caution]') -> str:
    """Why no polygon closes."""
    parts = [caution.text for caution in (*estimate.cautions, *cautions)]
    if not mapper.counts.used and mapper.counts.dropped:
        reason = max(mapper.counts.dropped, key=lambda key: (mapper.counts.dropped[key], key))
        parts.insert(0, f'all pings were dropped, most as {reason}: {mapper.last_drop_texts.get(reason, "")}')
    return f'{estimate.status}, no polygon closes: {"; ".join(parts)}'


if __name__ == '__main__':
    sys.exit(main())
