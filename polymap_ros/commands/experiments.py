"""The experiments of `polymap_evaluate`, as its help tells them: what each does, what acts in it, how long it takes."""

import argparse
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from polymap_ros.commands import console
from polymap_ros.errors import UsageError

PROGRAM = 'polymap_evaluate'
MOST_SEEDS = 1_000_000


class Experiment(NamedTuple):
    """What the help says of an experiment."""

    title: str
    what: str
    takes: str
    examples: tuple[str, ...]


EXPERIMENTS = {
    'paper': Experiment(
        "the paper's section III",
        'The published method on three plates and a rectangular one, as in section III of the paper: cost, edges and '
        'IoU over the iterations of several runs. Writes results.csv, table.md, fig3.png and fig4b.png.',
        'about 2 s of one core for each of the 4 scenes and 10 repetitions.',
        ('paper --output paper', 'paper --repetitions 3 --method evidence --snr-db -10 --output paper')),
    'random': Experiment(
        'random convex polygons',
        'Random convex polygons, all methods on the same scenes: how many are right, how exact, and which are not. '
        'Writes results.csv, table.md and success.png.',
        'about 1 s of one core for each scene (a seed and a number of edges) and level of noise by evidence, less by '
        'the others; 60 scenes by default.',
        ('random --output random', 'random --method evidence,paper --edges 4-6 --seeds 0:20 --jobs 2 --output random',
         'random --variant needle --snr-db none,0,-10 --output needle')),
    'online': Experiment(
        'an estimate after every ping',
        'Random convex polygons with an estimate after every ping: from which ping on the answer is right, and whether '
        'it stays so. Writes results.csv, table.md and online.png.',
        'about 10 s of one core for each scene; 60 scenes by default.',
        ('online --edges 4 --seeds 0:4 --output online', 'online --variant plate --jobs 2 --output online')),
    'doubt': Experiment(
        'scenes that no polygon explains, or that look like others',
        'Scenes that no polygon explains, or that cannot be told from others, L and T: how many are flagged, and '
        'how many are silently wrong. Writes results.csv and table.md.',
        'about 6 s of one core for each scene; 60 scenes of each kind by default.',
        ('doubt --seeds 1:3 --jobs 2 --output doubt', 'doubt --variant straight --output straight')),
    'calibration': Experiment(
        'wrong media and drifting odometry',
        'Wrong media and drifting odometry: what is noticed, what calibration makes of it, and whether the map is '
        'right then. Writes results.csv and table.md.',
        'about 20 s of one core for each scene; 60 scenes of each kind by default.',
        ('calibration --edges 4 --seeds 0:3 --jobs 2 --output calibration',
         'calibration --variant thickness --output thickness')),
    'slam': Experiment(
        'odometry that drifts',
        'Odometry that drifts and slips: is the polygon right once the path is brought onto the true one, how far is '
        'the path off, and what is told. Writes results.csv and table.md.',
        'about 4 s of one core for each scene; 60 scenes of each kind by default.',
        ('slam --variant typical --seeds 1:5 --jobs 2 --output typical', 'slam --jobs 2 --output slam')),
    'shapes': Experiment(
        'outlines that are not convex, holes and inner walls',
        'Outlines that are not convex, L, T and others, with paths into all of their arms, and plates with holes, a '
        'stiffener or a weld seam; echoes of every sequence of walls: how many are right, how exact, and what it '
        'takes. Writes results.csv and table.md.',
        'about 10 s of one core for each scene, more with holes; 10 scenes of each kind by default.',
        ('shapes --variant l --seeds 1:5 --jobs 2 --output l', 'shapes --variant hole --jobs 2 --output hole',
         'shapes --variant l --echoes waves --seeds 1:5 --output waves',
         'shapes --variant l --world typical --seeds 1:5 --output drifting', 'shapes --jobs 2 --output shapes')),
    'live': Experiment(
        'the real node over DDS for minutes',
        'The real node over DDS, driven round a plate: what it loses, what it costs and how late it is. Needs ROS. '
        'Writes results.csv and table.md.',
        'the length of the drive and about a minute more.',
        ('live --output live', 'live --minutes 2 --odom-hz 500 --ping-hz 50 --output live')),
    'cpu': Experiment(
        'what the node costs, idle and by message',
        'CPU time of an idle node, of an odometry message and of a ping, against a node that subscribes and does '
        'nothing. Needs ROS. Writes results.csv and table.md.',
        'about 10 minutes by default: 5 rounds of drives of 12 s.',
        ('cpu --output cpu', 'cpu --minutes 0.1 --samples 4096 --output cpu')),
    'speed': Experiment(
        'equations, a solve, a replay and --help against a reference',
        'CPU time of the equations, a solve, a replay and --help, as ratios to what everybody knows, measured in turn '
        'with them; with --growth instead, time and memory over what may grow. Writes results.csv and table.md.',
        'some minutes of one core that does nothing else; --growth as long as its pings take.',
        ('speed --output speed', 'speed --repetitions 4 --minutes 1 --output speed',
         'speed --growth 100000 --output growth')),
}

_SCENES = 'random', 'online', 'doubt', 'calibration', 'slam'
_SEEDED = *_SCENES, 'shapes'
_DRIVES = 'live', 'cpu'


def parser(experiment: str | None = None) -> console.Parser:
    """Make the parser; its help tells of all experiments, or of the one named and of the options that act in it."""
    if experiment is None:
        made = console.Parser(
            PROGRAM, 'Run experiments on simulated scenes. Ranges are always estimated from the signals.',
            f'{PROGRAM} EXPERIMENT --help tells what it does, which options act, and how long it takes.',
            [f'{PROGRAM} {words}' for words in ('random --help', 'paper --output paper', 'random --output random')])
        titles = (f'  {name:12} {each.title}' for name, each in EXPERIMENTS.items())
        made.epilog = '\n'.join(('experiments:', *titles, '', made.epilog or ''))
    else:
        told = EXPERIMENTS[experiment]
        made = console.Parser(PROGRAM, told.what, f'Time: {told.takes}',
                              [f'{PROGRAM} {example}' for example in told.examples])
    made.add_argument('experiment', choices=tuple(EXPERIMENTS), metavar=experiment or 'EXPERIMENT',
                      help='this experiment' if experiment else 'one of those listed below')
    made.add_argument('--output', type=console.path_argument, required=True, metavar='DIR',
                      help='folder for results and figures')
    for flag, (helps, keywords) in _options().items():
        text = helps.get(experiment, argparse.SUPPRESS) if experiment else _of_all(helps)
        made.add_argument(flag, help=text, **keywords)
    console.add_parameter_arguments(made)
    return made


def _of_all(helps: Mapping[str, str]) -> str:
    """What an option does, experiment by experiment, those alike together."""
    alike = {text: [name for name in helps if helps[name] == text] for text in helps.values()}
    return '; '.join(f'{", ".join(names)}: {text}' for text, names in alike.items())


def refuse_what_does_not_act(arguments: argparse.Namespace) -> None:
    """Refuse options that do nothing in the experiment.

    Raises
    ------
    UsageError
        With the option's name, and those in which it acts.
    """
    for flag, (helps, _) in _options().items():
        given = getattr(arguments, flag.removeprefix('--').replace('-', '_'))
        if given is not None and arguments.experiment not in helps:
            raise UsageError(f'{flag} does not act in "{arguments.experiment}", but in {", ".join(helps)}')


def _options() -> dict[str, tuple[Mapping[str, str], dict[str, Any]]]:
    """By flag: what it does in each experiment in which it acts, and how it is parsed."""
    noise = 'signal to noise of a ping [dB], or none for no noise (default: 0)'
    simulated = 'paper', *_SEEDED
    return {
        '--snr-db': (dict.fromkeys(simulated, noise) | {'random': f'{noise}, or several of them'},
                     {'type': _snrs, 'metavar': 'X,...'}),
        '--jobs': (dict.fromkeys(simulated, 'processes (default: 1)'), {'type': console.count, 'metavar': 'N'}),
        '--method': (dict.fromkeys(('random', 'online', 'doubt'), 'methods (default: solver.method)')
                     | {'paper': 'methods to run once beside'}, {'type': _names, 'metavar': 'M,...'}),
        '--repetitions': ({'paper': 'runs per scene (default: 10)', 'speed': 'pairs of measurements (default: 20)'},
                          {'type': console.count, 'metavar': 'N'}),
        '--edges': (dict.fromkeys(_SCENES, 'numbers of edges (default: 3-8)'), {'type': _edges, 'metavar': 'A-B'}),
        '--seeds': (dict.fromkeys(_SEEDED, 'first seed, end (exclusive) and step of the scenes (default: 0:10:1)'),
                    {'type': _seeds, 'metavar': 'A:B:STEP'}),
        '--variant': (dict.fromkeys(('random', 'online'), 'what the scenes are like (default: plate); an unknown name '
                                                          'lists all')
                      | dict.fromkeys(('doubt', 'calibration', 'slam', 'shapes'),
                                      'one kind of scene (default: all); an unknown name lists all'), {'metavar': 'V'}),
        '--echoes': ({'shapes': 'images: image sources, which end at once at the ends of walls (default); fresnel: '
                                'faded over a Fresnel zone there, and corners diffract; waves: the wave equation, '
                                'some minutes a scene; not with inner walls'},
                     {'choices': ('images', 'fresnel', 'waves')}),
        '--world': ({'shapes': 'clean: nothing but noise (default); mild: edges, device and medium as in the variant '
                               'mild of random; typical: odometry that drifts; echoes are images then'},
                    {'choices': ('clean', 'mild', 'typical')}),
        '--drive': ({'random': 'drive stretches of the odometry in this recording (topic: topics.odom; of a ROS 1 bag '
                               'rosbags-convert makes one), turned and scaled to fill the rooms'},
                    {'type': console.path_argument, 'metavar': 'RECORDING'}),
        '--minutes': ({'live': 'length of the drive (default: 10)', 'cpu': 'length of a drive (default: 0.2)',
                       'speed': 'length of the recording to be replayed (default: 10)'},
                      {'type': float, 'metavar': 'M'}),
        '--odom-hz': (dict.fromkeys(_DRIVES, 'odometry rate (default: 200)'), {'type': float, 'metavar': 'F'}),
        '--ping-hz': (dict.fromkeys(_DRIVES, 'pings per second (default: 20)'), {'type': float, 'metavar': 'F'}),
        '--samples': (dict.fromkeys(_DRIVES, 'samples per ping (default: 8192)'), {'type': int, 'metavar': 'N'}),
        '--growth': ({'speed': 'instead, time and memory over pings (100 to PINGS, default: 100000), samples, '
                               'cells and lines'},
                     {'type': console.count, 'nargs': '?', 'const': 100_000, 'metavar': 'PINGS'}),
    }


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
