"""`polymap_evaluate`: experiments on simulated scenes; tables, figures, and a row per scene and run."""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from polymap_ros.commands import console, live, speed

if TYPE_CHECKING:
    from polymap_ros.evaluation.rows import Result
    from polymap_ros.parameters import Parameters

T = TypeVar('T')
PROGRAM = 'polymap_evaluate'
MOST_SEEDS = 1_000_000
RESULTS, TABLE = 'results.csv', 'table.md'
NAMES = RESULTS, TABLE, 'fig3.png', 'fig4b.png', 'success.png', 'online.png'
_DESCRIPTION = '''Run experiments on simulated scenes. "paper": section III of the paper, three plates and a
rectangular one, cost, edges and IoU over the iterations. "random": random convex polygons, several methods on the
same scenes. "online": the same scenes with an estimate after every ping. "doubt": scenes that no convex polygon
explains, and how many of them are flagged. "calibration": wrong media and drifting odometry, what is noticed and what
calibration makes of it. "live": the real node over DDS for minutes, what it loses, costs and how
late it is. "cpu": CPU of an idle node, an odometry message and a ping. "speed": equations, a solve, a replay and
--help, as ratios to what everybody knows. Ranges are always estimated from the
signals.'''


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    console.one_core()
    arguments = _parser().parse_args(argv)
    return console.execute(PROGRAM, lambda: _run_experiment(arguments))


def _run_experiment(arguments: argparse.Namespace) -> int:
    if arguments.experiment not in ('live', 'cpu'):
        _refuse(arguments, *(name for name in live.ARGUMENTS if (arguments.experiment, name) != ('speed', 'minutes')))
    if arguments.experiment != 'speed':
        _refuse(arguments, 'growth')
    _spare(arguments.output)
    return _EXPERIMENTS[arguments.experiment](arguments)


def _parser() -> console.Parser:
    parser = console.Parser(PROGRAM, _DESCRIPTION)
    parser.add_argument('experiment', choices=tuple(_EXPERIMENTS))
    parser.add_argument('--output', type=Path, required=True, metavar='DIR', help='folder for results and figures')
    parser.add_argument('--snr-db', type=_snrs, default=[0.0], metavar='X,...',
                        help='per ping; none: no noise; random: one or several (default: 0)')
    parser.add_argument('--jobs', type=console.count, default=1, metavar='N', help='processes (default: 1)')
    parser.add_argument('--method', type=_names, metavar='M,...',
                        help='methods (default: solver.method); paper: methods to run once beside')
    parser.add_argument('--repetitions', type=console.count, metavar='N',
                        help='paper: per scene (default: 10); speed: pairs of measurements (default: 20)')
    parser.add_argument('--edges', type=_edges, metavar='A-B', help='all but paper: numbers of edges (default: 3-8)')
    parser.add_argument('--seeds', type=_seeds, metavar='A:B:STEP',
                        help='all but paper: first seed, end (exclusive) and step of the scenes (default: 0:10:1)')
    parser.add_argument('--variant', metavar='V',
                        help='random, online: what the scenes are like (default: plate); doubt, calibration: one '
                             'kind (default: all); an unknown name lists all')
    parser.add_argument('--drive', type=Path, metavar='RECORDING',
                        help='random: drive stretches of the odometry in this recording (topic: topics.odom; of a '
                             'ROS 1 bag rosbags-convert makes one), turned and scaled to fill the rooms')
    live.add_arguments(parser)
    speed.add_arguments(parser)
    console.add_parameter_arguments(parser)
    return parser


@console.argument('finite numbers or none, separated by commas')
def _snrs(text: str) -> list[float | None]:
    levels = [None if part == 'none' else float(part) for part in text.split(',')]
    if not all(level is None or math.isfinite(level) for level in levels):
        raise ValueError
    return list(dict.fromkeys(levels))


def _names(text: str) -> list[str]:
    return list(dict.fromkeys(text.split(',')))


@console.argument('a number of edges, or A-B with 3 <= A <= B <= 64')
def _edges(text: str) -> range:
    """``A-B``, both included, or a single number."""
    first, _, last = text.partition('-')
    numbers = range(int(first), int(last or first) + 1)
    if not 3 <= numbers.start < numbers.stop <= 65:
        raise ValueError
    return numbers


@console.argument(f'A:B or A:B:STEP with one seed to {MOST_SEEDS:,}, from 0 to 2**32')
def _seeds(text: str) -> range:
    """``A:B`` or ``A:B:STEP``, as in Python's range."""
    first, *rest = (int(part) for part in text.split(':', 2))
    if not rest or max(abs(first), *map(abs, rest)) > 2**32:
        raise ValueError
    seeds = range(first, *rest)
    if not 0 < len(seeds) <= MOST_SEEDS or min(seeds[0], seeds[-1]) < 0:
        raise ValueError
    return seeds


def _paper(arguments: argparse.Namespace) -> int:
    from polymap_ros.evaluation import figures, tables
    from polymap_ros.evaluation.paper_experiment import RECTANGLE, SIMULATED, PaperExperiment, by_scene

    _refuse(arguments, 'edges', 'seeds', 'variant', 'drive')
    repetitions, snr_db = arguments.repetitions or 10, _one(arguments.snr_db)
    experiment = PaperExperiment(repetitions, snr_db, console.read_parameters(arguments))
    others = [(name, method) for method in arguments.method or [] if method != 'paper'
              for name in (*SIMULATED, RECTANGLE) if (name, method) != (RECTANGLE, 'rectangle')]
    for _, method in others:
        experiment.parameters.replaced({'solver.method': method})
    done = _run(experiment.run_one, experiment.jobs(), arguments, 'repetitions', lambda history: [history.trial])
    histories = by_scene(done)
    baseline = experiment.run_once(RECTANGLE, 'rectangle')
    trials = [history.trial for runs in histories.values() for history in runs]
    trials += [baseline, *(experiment.run_once(*other) for other in others)]
    rectangle = {RECTANGLE: histories.pop(RECTANGLE)}
    _write(arguments.output, trials, tables.paper_table(trials), {
        'fig3.png': figures.convergence_figure({name: histories[name] for name in SIMULATED}, {}),
        'fig4b.png': figures.convergence_figure(rectangle, {RECTANGLE: baseline.iou}),
    })
    return console.DONE


def _random(arguments: argparse.Namespace) -> int:
    from polymap_ros.evaluation import figures, tables
    from polymap_ros.evaluation.random_experiment import RandomExperiment, in_order

    _refuse(arguments, 'repetitions')
    name, title = _variant(arguments)
    parameters, methods, seeds, edges = _scenes(arguments)
    drive = None
    if arguments.drive:
        from polymap_ros.commands.simulate import recorded_path

        drive, title = recorded_path(arguments.drive, parameters.topics.odom), f'{title}, recorded paths'
    experiment = RandomExperiment(name, seeds, edges, methods, arguments.snr_db, parameters, drive)
    done = _run(experiment.run_one, experiment.scenes(), arguments, 'scenes', lambda trials: trials)
    trials = in_order([trial for group in done for trial in group])
    text = (f'{tables.random_table(trials)}\n\n{tables.accuracy_table(trials)}\n\n'
            f'Not right, by seed (*: flagged):\n\n{tables.failures(trials)}')
    _write(arguments.output, trials, text, {'success.png': figures.success_figure(trials, title)})
    return console.DONE


def _online(arguments: argparse.Namespace) -> int:
    from polymap_ros.evaluation import online_report
    from polymap_ros.evaluation.online_experiment import OnlineExperiment

    _refuse(arguments, 'repetitions', 'drive')
    name, title = _variant(arguments)
    parameters, methods, seeds, edges = _scenes(arguments)
    experiment = OnlineExperiment(name, seeds, edges, methods, _one(arguments.snr_db), parameters)
    done = _run(experiment.run_one, experiment.scenes(), arguments, 'scenes', lambda runs: runs)
    runs = sorted((run for group in done for run in group), key=lambda run: (run.seed, run.edges, run.method))
    text = f'{online_report.online_table(runs)}\n\nNot steady:\n\n{online_report.unsteady(runs)}'
    _write(arguments.output, runs, text, {'online.png': online_report.online_figure(runs, title)})
    return console.DONE


def _doubt(arguments: argparse.Namespace) -> int:
    from polymap_ros.errors import UsageError
    from polymap_ros.evaluation.doubt_experiment import DoubtExperiment, doubt_table, faults
    from polymap_ros.simulation.doubtful_scenes import KINDS

    _refuse(arguments, 'repetitions', 'drive')
    if arguments.variant not in (None, *KINDS):
        known = '; '.join(f'{other} ({kind.text})' for other, kind in KINDS.items())
        raise UsageError(f'--variant {arguments.variant}: known: {known}')
    kinds = [arguments.variant] if arguments.variant else list(KINDS)
    parameters, methods, seeds, edges = _scenes(arguments)
    experiment = DoubtExperiment(kinds, seeds, edges, methods, _one(arguments.snr_db), parameters)
    done = _run(experiment.run_one, experiment.scenes(), arguments, 'scenes', lambda trials: trials)
    trials = sorted((trial for group in done for trial in group), key=lambda entry: (
        entry.trial.method, kinds.index(entry.kind), entry.trial.seed))
    text = f'{doubt_table(trials)}\n\nSilently wrong, or flagged though ordinary, by edges-seed:\n\n{faults(trials)}'
    _write(arguments.output, trials, text, {})
    return console.DONE


def _live(arguments: argparse.Namespace) -> int:
    run = {'live': live.live, 'cpu': live.cpu}[arguments.experiment]
    _refuse(arguments, 'repetitions', 'method', 'edges', 'seeds', 'variant')
    rows, table = run(arguments)
    _write(arguments.output, rows, table, {})
    return console.DONE


def _speed(arguments: argparse.Namespace) -> int:
    _refuse(arguments, 'method', 'edges', 'seeds', 'variant', 'drive')
    rows, table = speed.speed(arguments)
    _write(arguments.output, rows, table, {})
    return console.DONE


def _calibration(arguments: argparse.Namespace) -> int:
    from polymap_ros.errors import UsageError
    from polymap_ros.evaluation.calibration_experiment import CASES, CalibrationExperiment, calibration_table

    _refuse(arguments, 'repetitions', 'drive', 'method')
    if arguments.variant not in (None, *CASES):
        known = '; '.join(f'{other} ({case.text})' for other, case in CASES.items())
        raise UsageError(f'--variant {arguments.variant}: known: {known}')
    cases = [arguments.variant] if arguments.variant else list(CASES)
    parameters, _, seeds, edges = _scenes(arguments)
    experiment = CalibrationExperiment(cases, seeds, edges, _one(arguments.snr_db), parameters)
    done = _run(experiment.run_one, experiment.scenes(), arguments, 'scenes', lambda trials: trials)
    trials = sorted((trial for group in done for trial in group), key=lambda trial: (
        cases.index(trial.case), trial.seed, trial.edges))
    _write(arguments.output, trials, calibration_table(trials), {})
    return console.DONE


_EXPERIMENTS = {'paper': _paper, 'random': _random, 'online': _online, 'doubt': _doubt, 'calibration': _calibration,
                'live': _live, 'cpu': _live, 'speed': _speed}


def _spare(folder: Path) -> None:
    """Refuse to write where results would take the place of what is not of an earlier run, or of one interrupted."""
    from polymap_ros.errors import UsageError
    from polymap_ros.evaluation.rows import PartialRows

    if (partial := PartialRows(folder).path).exists():
        raise UsageError(f'{partial}: has the rows of a run that was interrupted; move it, or choose another --output')
    found = [name for name in NAMES if (folder / name).exists()]
    if found and RESULTS not in found:
        raise UsageError(f'{folder}: holds {", ".join(found)} and no {RESULTS}, so that is not of an earlier run, and '
                         'the results would take its place; choose another --output')


def _variant(arguments: argparse.Namespace) -> tuple[str, str]:
    """Name of the variant, and a title for its pictures."""
    from polymap_ros.errors import UsageError
    from polymap_ros.evaluation.variants import VARIANTS

    name = arguments.variant or 'plate'
    if name not in VARIANTS:
        known = '; '.join(f'{other} ({variant.text})' for other, variant in VARIANTS.items())
        raise UsageError(f'--variant {name}: known: {known}')
    title = VARIANTS[name].text
    if len(arguments.snr_db) == 1:
        title += ', no noise' if arguments.snr_db[0] is None else f', {arguments.snr_db[0]:g} dB'
    return name, title


def _scenes(arguments: argparse.Namespace) -> 'tuple[Parameters, list[str], range, range]':
    """Parameters, methods, seeds and numbers of edges."""
    parameters = console.read_parameters(arguments)
    methods = arguments.method or [parameters.solver.method]
    for method in methods:
        parameters.replaced({'solver.method': method})
    return parameters, methods, arguments.seeds or range(10), arguments.edges or range(3, 9)


def _refuse(arguments: argparse.Namespace, *names: str) -> None:
    from polymap_ros.errors import UsageError

    for name in names:
        if getattr(arguments, name) is not None:
            raise UsageError(f'--{name.replace("_", "-")} does not act in "{arguments.experiment}"')


def _one(levels: list[float | None]) -> float | None:
    from polymap_ros.errors import UsageError

    if len(levels) > 1:
        raise UsageError('--snr-db takes several values in "random" only')
    return levels[0]


def _run(
    function: Callable[..., T], jobs: Sequence[tuple[Any, ...]], arguments: argparse.Namespace, unit: str,
    rows: 'Callable[[T], Sequence[Result]]',
) -> list[T]:
    """Do the jobs; the rows of each are kept as soon as it is done."""
    from polymap_ros.evaluation.parallel import run_jobs
    from polymap_ros.evaluation.rows import PartialRows

    results, kept = [], PartialRows(arguments.output)
    with console.progress('polymap_evaluate', len(jobs), unit) as advance, \
            closing(run_jobs(_job, [(function, *job) for job in jobs], arguments.jobs)) as done:
        for result in done:
            results.append(result)
            kept.add(rows(result))
            advance(1)
    return results


def _job(function: Callable[..., T], *job: Any) -> T:
    """In whatever process."""
    console.tell_compiling(PROGRAM)
    return function(*job)


def _write(folder: Path, results: 'Sequence[Result]', table: str, pictures: dict[str, Any]) -> None:
    """Print the table; write it, results.csv and the pictures, each whole or not at all, and none of two runs."""
    from polymap_ros.atomic import move_into_place, staging
    from polymap_ros.evaluation.rows import PartialRows, csv_text

    with staging(folder / RESULTS) as stage:
        (stage / RESULTS).write_text(csv_text(results), encoding='utf-8')
        (stage / TABLE).write_text(f'{table}\n', encoding='utf-8')
        for name, figure in pictures.items():
            figure.savefig(stage / name, dpi=150)
        for name in NAMES:  # of an earlier run, which may have had others
            (folder / name).unlink(missing_ok=True)
        for name in (RESULTS, TABLE, *pictures):
            move_into_place(stage / name, folder / name)
    PartialRows(folder).discard()
    console.tell(table)
    console.tell(f'\n{folder}: {", ".join((RESULTS, TABLE, *pictures))}')


if __name__ == '__main__':
    sys.exit(main())
