"""`polymap_evaluate`: experiments on simulated scenes; tables, figures, and a row per scene and run."""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from polymap_ros.commands import console, live, speed
from polymap_ros.commands.experiments import EXPERIMENTS, PROGRAM, parser, refuse_what_does_not_act

if TYPE_CHECKING:
    from polymap_ros.evaluation.rows import Result
    from polymap_ros.parameters import Parameters

T = TypeVar('T')
RESULTS, TABLE = 'results.csv', 'table.md'
NAMES = RESULTS, TABLE, 'fig3.png', 'fig4b.png', 'success.png', 'online.png'


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    console.one_core()
    command_line = sys.argv[1:] if argv is None else list(argv)
    named = next((word for word in command_line if word in EXPERIMENTS), None)
    arguments = parser(named).parse_args(command_line)
    return console.execute(PROGRAM, lambda: _run_experiment(arguments))


def _run_experiment(arguments: argparse.Namespace) -> int:
    refuse_what_does_not_act(arguments)
    arguments.snr_db, arguments.jobs = arguments.snr_db or [0.0], arguments.jobs or 1
    _spare(arguments.output)
    return _RUN[arguments.experiment](arguments)


def _paper(arguments: argparse.Namespace) -> int:
    from polymap_ros.evaluation import figures, tables
    from polymap_ros.evaluation.paper_experiment import RECTANGLE, SIMULATED, PaperExperiment, by_scene

    repetitions, snr_db = arguments.repetitions or 10, _one(arguments.snr_db)
    experiment = PaperExperiment(repetitions, snr_db, console.read_parameters(PROGRAM, arguments))
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

    name, title = _variant(arguments)
    parameters, methods, seeds, edges = _scenes(arguments)
    experiment = OnlineExperiment(name, seeds, edges, methods, _one(arguments.snr_db), parameters)
    done = _run(experiment.run_one, experiment.scenes(), arguments, 'scenes', lambda runs: runs)
    runs = sorted((run for group in done for run in group), key=lambda run: (run.seed, run.edges, run.method))
    text = f'{online_report.online_table(runs)}\n\nNot steady:\n\n{online_report.unsteady(runs)}'
    _write(arguments.output, runs, text, {'online.png': online_report.online_figure(runs, title)})
    return console.DONE


def _doubt(arguments: argparse.Namespace) -> int:
    from polymap_ros.evaluation.doubt_experiment import DoubtExperiment, doubt_table, faults
    from polymap_ros.simulation.doubtful_scenes import KINDS

    kinds = _kinds(arguments, KINDS)
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
    rows, table = run(arguments)
    _write(arguments.output, rows, table, {})
    return console.DONE


def _speed(arguments: argparse.Namespace) -> int:
    rows, table = speed.speed(arguments)
    _write(arguments.output, rows, table, {})
    return console.DONE


def _calibration(arguments: argparse.Namespace) -> int:
    from polymap_ros.evaluation.calibration_experiment import CASES, CalibrationExperiment, calibration_table

    cases = _kinds(arguments, CASES)
    parameters, _, seeds, edges = _scenes(arguments)
    experiment = CalibrationExperiment(cases, seeds, edges, _one(arguments.snr_db), parameters)
    done = _run(experiment.run_one, experiment.scenes(), arguments, 'scenes', lambda trials: trials)
    trials = sorted((trial for group in done for trial in group), key=lambda trial: (
        cases.index(trial.case), trial.seed, trial.edges))
    _write(arguments.output, trials, calibration_table(trials), {})
    return console.DONE


def _slam(arguments: argparse.Namespace) -> int:
    from polymap_ros.evaluation.slam_experiment import CASES, SlamExperiment, path_failures, slam_table

    cases = _kinds(arguments, CASES)
    parameters, _, seeds, edges = _scenes(arguments)
    experiment = SlamExperiment(cases, seeds, edges, _one(arguments.snr_db), parameters)
    done = _run(experiment.run_one, experiment.scenes(), arguments, 'scenes', lambda trials: trials)
    trials = sorted((trial for group in done for trial in group), key=lambda entry: (
        cases.index(entry.case), entry.trial.seed, entry.trial.edges))
    text = f'{slam_table(trials)}\n\nNot right, by edges-seed:\n\n{path_failures(trials)}'
    _write(arguments.output, trials, text, {})
    return console.DONE


def _shapes(arguments: argparse.Namespace) -> int:
    from polymap_ros.errors import UsageError
    from polymap_ros.evaluation.shapes_experiment import ShapesExperiment, shape_failures, shapes_text
    from polymap_ros.simulation.shaped_scenes import SHAPE_KINDS, shaped_scene

    kinds = _kinds(arguments, SHAPE_KINDS)
    parameters, _, seeds, _ = _scenes(arguments)
    echoes = arguments.echoes or 'images'
    if echoes == 'waves' and (walled := [kind for kind in kinds if shaped_scene(kind, seeds[0]).inner_walls]):
        raise UsageError(f'--echoes waves: the wave equation is not solved with inner walls, which {", ".join(walled)} '
                         'have; name another --variant')
    if echoes == 'fresnel' and (bent := [kind for kind in kinds if len(shaped_scene(kind, seeds[0]).circles)]):
        raise UsageError(f'--echoes fresnel: diffraction is of corners, not of round holes, which {", ".join(bent)} '
                         'have; name another --variant, or --echoes waves')
    world = arguments.world or 'clean'
    if world != 'clean' and echoes != 'images':
        raise UsageError(f'--echoes {echoes}: of --world {world} echoes are images; leave one of the two out')
    if world == 'mild' and (filled := [kind for kind in kinds if SHAPE_KINDS[kind].inside]):
        raise UsageError(f'--world mild: edges turn the phase where nothing is inside; {", ".join(filled)} have '
                         'something; name another --variant')
    experiment = ShapesExperiment(kinds, seeds, _one(arguments.snr_db), parameters, echoes, world)
    done = _run(experiment.run_one, experiment.scenes(), arguments, 'scenes', lambda trials: trials)
    trials = sorted((trial for group in done for trial in group), key=lambda entry: (
        kinds.index(entry.kind), entry.trial.seed))
    text = f'{shapes_text(trials)}\n\nNot right, or flagged:\n\n{shape_failures(trials)}'
    _write(arguments.output, trials, text, {})
    return console.DONE


_RUN = {'paper': _paper, 'random': _random, 'online': _online, 'doubt': _doubt, 'calibration': _calibration,
        'slam': _slam, 'shapes': _shapes, 'live': _live, 'cpu': _live, 'speed': _speed}


def _spare(folder: Path) -> None:
    """Refuse to write where nothing can be, or in the place of what is of no earlier run, or of one interrupted."""
    from polymap_ros.atomic import check_writable
    from polymap_ros.errors import OutputError, UsageError
    from polymap_ros.evaluation.rows import PartialRows

    check_writable(folder)
    for path in map(folder.joinpath, NAMES):
        if path.is_dir():
            raise OutputError(path, 'it is a folder; move it away')
    if (partial := PartialRows(folder).path).exists():
        raise UsageError(f'{partial}: has the rows of a run that was interrupted; move it, or choose another --output')
    found = [name for name in NAMES if (folder / name).exists()]
    if found and RESULTS not in found:
        raise UsageError(f'{folder}: holds {", ".join(found)} and no {RESULTS}, so that is not of an earlier run, and '
                         'the results would take its place; choose another --output')


class _Told(Protocol):
    """What a kind of scenes says of itself."""

    @property
    def text(self) -> str: ...


def _variant(arguments: argparse.Namespace) -> tuple[str, str]:
    """Name of the variant, and a title for its pictures."""
    from polymap_ros.evaluation.variants import VARIANTS

    name = arguments.variant or 'plate'
    _check_known(name, VARIANTS)
    title = VARIANTS[name].text
    if len(arguments.snr_db) == 1:
        title += ', no noise' if arguments.snr_db[0] is None else f', {arguments.snr_db[0]:g} dB'
    return name, title


def _kinds(arguments: argparse.Namespace, all_kinds: Mapping[str, _Told]) -> list[str]:
    """The kind that is asked for, or all of them."""
    if arguments.variant is None:
        return list(all_kinds)
    _check_known(arguments.variant, all_kinds)
    return [arguments.variant]


def _check_known(name: str, all_kinds: Mapping[str, _Told]) -> None:
    from polymap_ros.errors import UsageError

    if name not in all_kinds:
        known = '; '.join(f'{other} ({kind.text})' for other, kind in all_kinds.items())
        raise UsageError(f'--variant {name}: known: {known}')


def _scenes(arguments: argparse.Namespace) -> 'tuple[Parameters, list[str], range, range]':
    """Parameters, methods, seeds and numbers of edges."""
    parameters = console.read_parameters(PROGRAM, arguments)
    methods = arguments.method or [parameters.solver.method]
    for method in methods:
        parameters.replaced({'solver.method': method})
    return parameters, methods, arguments.seeds or range(10), arguments.edges or range(3, 9)


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

    console.tell(table)  # before anything is written that may fail
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
    console.tell(f'\n{folder}: {", ".join((RESULTS, TABLE, *pictures))}')


if __name__ == '__main__':
    sys.exit(main())
