"""polymap_replay: a recording in, the polygon out."""

import argparse
import dataclasses
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

from polymap_ros.commands import console
from polymap_ros.commands.mapped import PROGRAM, calibrated
from polymap_ros.commands.replaying import Outcome, replayed
from polymap_ros.errors import RecordingError, UsageError
from polymap_ros.parameters import Parameters

Job: TypeAlias = tuple[Path, Path, Parameters, argparse.Namespace]
"""What `attempt` takes."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    console.one_core()
    arguments = _parser().parse_intermixed_args(argv)
    return console.execute(PROGRAM, lambda: _run(arguments))


def _parser() -> argparse.ArgumentParser:
    parser = console.Parser(
        PROGRAM, 'Map the polygon in one or more recordings, as fast as the machine goes. No ROS is needed.',
        'Exit status: 0 done; 1 no polygon closes, the reason is on stderr; 2 wrong usage, recording or parameter; '
        '130 interrupted, 143 terminated.',
        ['polymap_replay bags/pentagon --plot --output polymap',
         'polymap_replay drive.mcap --params-file polymap.yaml -p topics.echo:=/sonar/raw',
         'polymap_replay drive.mcap --calibrate',
         'polymap_replay drives/*.mcap --jobs 4 --output maps   # many, and maps/summary.csv'])
    parser.add_argument('recordings', nargs='+', type=console.path_argument, metavar='RECORDING',
                        help='rosbag2 directory, or a bare MCAP or SQLite file, compressed or not; a map each')
    console.add_parameter_arguments(parser)
    parser.add_argument('--output', type=console.path_argument, metavar='DIR',
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
    parser.add_argument('--report', action='store_true',
                        help='write report.html: a page to read, print and pass on, with the outline drawn to scale, '
                             'the beamforming map, all numbers, and warnings with what to do; several recordings '
                             'get DIR/index.html over their pages, too')
    parser.add_argument('--record', action='store_true',
                        help='write result.mcap: the odometry, and all outputs of a node as they grew, for Foxglove '
                             'or RViz')
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
    parser.add_argument('--fit-pulse', action='store_true',
                        help='find the pulse that the echoes fit, as of a transducer that rings, map with it, and '
                             "write pulse.npy at the recording's sample period; not beside these three")
    parser.add_argument('--save-map', action='store_true', help='write beam_map.npz: the beamforming map')
    return parser


def _run(arguments: argparse.Namespace) -> int:
    parameters = console.read_parameters(PROGRAM, arguments)
    start_s, end_s = arguments.start, arguments.end
    if not (start_s is None or start_s >= 0.0) or not (end_s is None or end_s > (start_s or 0.0)):
        raise UsageError(f'--start {start_s} --end {end_s}: allowed: 0 <= start < end, in seconds after the first '
                         'message')
    if arguments.fit_pulse and (arguments.calibrate or arguments.fit_odometry or arguments.fit_time_zero):
        raise UsageError('--fit-pulse is not for a run with --calibrate, --fit-odometry or --fit-time-zero; do one '
                         'after the other')
    if parameters.output.load_path and (what := calibrated(arguments)):
        option = {'medium': 'calibrate', 'odometry': 'fit-odometry', 'time zero': 'fit-time-zero',
                  'pulse': 'fit-pulse'}[what]
        raise UsageError(f'--{option} starts from a recording alone; leave output.load_path out')
    output = arguments.output or Path(parameters.output.dir)
    _refuse_collections(arguments.recordings, output)
    folders = _folders(arguments.recordings, output, arguments.report)
    _check(arguments, parameters, folders)
    if arguments.scheduler:
        parameters, folders = _anywhere(parameters, folders)
    jobs = [(recording, folder, parameters, arguments) for recording, folder in folders.items()]
    if len(jobs) == 1:
        return _replay_all(jobs, arguments, lambda outcome: None)[0].status
    return _replay_many(jobs, arguments, output)


def _replay_many(jobs: Sequence[Job], arguments: argparse.Namespace, output: Path) -> int:
    """Replay recordings and sum them up, also those so far where the work is interrupted."""
    from polymap_ros.commands.ledger import Ledger
    from polymap_ros.commands.pages import clear_index, refuse_foreign_index, write_index

    if arguments.report:
        refuse_foreign_index(output)
    ledger = Ledger(output, {recording: folder.name for recording, folder, _, _ in jobs})
    had_index = clear_index(output)
    problem = ''
    try:
        _replay_all(jobs, arguments, ledger.add)
    finally:
        ledger.add_interrupted()
        indexed = arguments.report or (had_index and ledger.earlier)
        if indexed and (problem := write_index(output, ledger.outcomes, ledger.earlier)):
            console.complain(PROGRAM, f'error: {problem}')
        ledger.tell()
    return max(ledger.status, console.WRONG if problem else console.DONE)


def _refuse_collections(recordings: Sequence[Path], output: Path) -> None:
    """Of a folder that holds recordings and is none, name them all."""
    from polymap_ros.recordings.finding import collection, recording_name

    for path in recordings:
        if found := collection(path):
            commands = f'{PROGRAM} {shlex.join(map(str, found))}'
            if len(set(map(recording_name, found))) < len(found):  # which would name their folders of results
                commands = '; '.join(
                    f'{PROGRAM} {shlex.join([str(each), "--output", str(output / each.relative_to(path))])}'
                    for each in found)
            raise UsageError(f'{path}: is no recording, but holds {len(found)}; to replay '
                             f'{"it" if len(found) == 1 else "all of them"}: {commands}')


def _check(arguments: argparse.Namespace, parameters: Parameters, folders: dict[Path, Path]) -> None:
    """Refuse before the work what could not be written after it, and what every recording would be refused for."""
    _spare(folders, arguments.params_file)
    if not arguments.scheduler:  # whose workers may see other disks, and check it themselves
        from polymap_ros.pulse_file import read_pulse
        from polymap_ros.results.folder import check_folder
        from polymap_ros.results.loading import check_loading

        for folder in folders.values():
            check_folder(folder)
        read_pulse(parameters)
        check_loading(parameters)
    if arguments.plot or arguments.plot_signals:
        from polymap_ros.results.picture import require_matplotlib

        require_matplotlib()
    if arguments.report:
        from polymap_ros.results.report.templating import require_jinja

        require_jinja()
    if 'dxf' in arguments.exports:
        from polymap_ros.results.export import require_ezdxf

        require_ezdxf()
    if arguments.scheduler:
        from polymap_ros.commands.fleet import check_cluster

        check_cluster(arguments.scheduler)


def _replay_all(
    jobs: Sequence[Job], arguments: argparse.Namespace, note: Callable[[Outcome], object]
) -> list[Outcome]:
    """Replay every recording; `note` takes each outcome as soon as it is there."""
    processes = min(arguments.jobs, len(jobs))
    if not arguments.scheduler and processes == 1:
        outcomes = []
        for job in jobs:
            outcomes.append(replayed(*job))
            note(outcomes[-1])
        return outcomes
    from polymap_ros.commands.fleet import run_all

    def lost(recording: Path, folder: Path, _: Parameters, __: argparse.Namespace, error: str) -> Outcome:
        return Outcome(recording, folder, console.WRONG, error=error)

    return run_all(PROGRAM, replayed, jobs, processes, arguments.scheduler, lost, note)


def _anywhere(parameters: Parameters, folders: dict[Path, Path]) -> tuple[Parameters, dict[Path, Path]]:
    """The same files whatever folder a process works in."""
    state = parameters.output.load_path
    placed = parameters.replaced({'output.load_path': str(Path(state).absolute())}) if state else parameters
    return (dataclasses.replace(placed, folder=parameters.folder.absolute()),
            {recording.absolute(): folder.absolute() for recording, folder in folders.items()})


def _folders(recordings: Sequence[Path], output: Path, report: bool) -> dict[Path, Path]:
    """Where the results of each recording go."""
    if len(recordings) == 1:
        return {recordings[0]: output}
    from polymap_ros.commands.ledger import SUMMARY
    from polymap_ros.commands.pages import INDEX
    from polymap_ros.recordings.finding import recording_name

    names = [recording_name(path) for path in recordings]
    for path, name in zip(recordings, names, strict=True):
        if name in ('', '.', '..', SUMMARY) or (report and name == INDEX):
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


if __name__ == '__main__':
    sys.exit(main())
