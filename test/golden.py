"""Does a change of structure change answers? python test/golden.py keep FILE; python test/golden.py compare OLD NEW.

keep FILE [--package DIR] [--jobs N]
    Write what polygon.json holds, but for `parameters`, `software` and `recording`, of the four bags, of 60 random
    scenes (every variant at 0 and -10 dB, the plain plate with 3 to 8 edges) and of two scenes of every doubtful kind
    at 0 dB. Their seeds are even: odd ones stay free for tuning. Beside each answer stands the CPU time that it took
    [s]: of a bag the whole replay, of a scene the solve; the simulation and what is compiled are left out.
    DIR is the checkout to measure, such as one of an older commit made by `git worktree add`; default: this one.

compare OLD NEW [--tolerance X]
    Print how many answers are equal, the greatest change of each field and the answer it is in, every answer whose
    status, number of edges or warnings changed, and the ratios of CPU time. Ends with 0 where all answers of OLD are
    in NEW and equal, to the last bit or, where X is given, within it: numbers by less than X in their own units, and
    warnings by their codes. Keys that only NEW has are told, and do no harm.

Both files are to come from the same environment: other versions of numpy, scipy or numba round differently.
"""

import argparse
import contextlib
import dataclasses
import functools
import importlib.metadata
import io
import json
import math
import multiprocessing
import os
import platform
import statistics
import sys
import tempfile
import time
import zlib
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
BAGS = 'triangle', 'quadrilateral', 'pentagon', 'rectangle'
SNRS_DB = 0.0, -10.0
PLATE = 'plate'
EDGES = {PLATE: range(3, 9), 'needle': [3], 'unequal': [6], 'right_angled': [4]}
"""Numbers of edges of a variant, where one drawn from its name will not do."""
LEFT_OUT = 'parameters', 'software', 'recording'
ANGLES = 'theta', 'angle'
OF_ENVIRONMENT = 'numpy', 'scipy', 'shapely', 'numba'


def keep(arguments):
    sys.path.insert(0, str(arguments.package.resolve()))
    import polymap_ros

    if Path(polymap_ros.__file__).resolve().parents[1] != arguments.package.resolve():
        sys.exit(f'{arguments.package}: no checkout of polymap_ros')
    answers, seconds = {}, {}
    jobs = [('bag', (name,)) for name in BAGS] + [('random', job) for job in random_jobs()] + [
        ('doubt', job) for job in doubt_jobs()]
    with ProcessPoolExecutor(arguments.jobs, multiprocessing.get_context('spawn')) as pool:
        for name, answer, seconds_used in pool.map(answered, *zip(*jobs, strict=True)):
            answers[name] = {key: value for key, value in answer.items() if key not in LEFT_OUT}
            seconds[name] = seconds_used
            print(f'{name}: {answer["status"]}, {seconds_used:.2f} s', file=sys.stderr, flush=True)
    versions = {name: importlib.metadata.version(name) for name in OF_ENVIRONMENT}
    environment = {'python': platform.python_version(), 'machine': platform.machine(), **versions}
    content = {'environment': environment, 'answers': answers, 'seconds': seconds}
    arguments.file.write_text(json.dumps(content, indent=1) + '\n', encoding='utf-8')
    print(f'{len(answers)} answers in {sum(seconds.values()):.0f} s of CPU')


def random_jobs():
    """Variant, seed, number of edges and SNR; drawn from the name alone, so that new variants leave these alone."""
    from polymap_ros.evaluation.variants import VARIANTS

    return [(name, drawn(name, edges, snr_db), edges, snr_db) for name in VARIANTS
            for edges in EDGES.get(name, [3 + drawn(name) // 2 % 6]) for snr_db in SNRS_DB]


def doubt_jobs():
    """Kind, seed and number of edges."""
    from polymap_ros.simulation.doubtful_scenes import KINDS

    return [(name, drawn(name, edges), edges) for name in KINDS for edges in (4, 6)]


def drawn(*names):
    """An even number below 200."""
    return 2 * (zlib.crc32(repr(names).encode()) % 100)


def answered(group, job):
    """Name, polygon.json and CPU time [s] of a bag or a scene."""
    for library in ('OMP', 'OPENBLAS', 'MKL', 'NUMBA'):  # nothing numerical is imported before
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')
    from polymap_ros.evaluation.trials import ready
    from polymap_ros.parameters import Parameters

    ready(Parameters())
    return {'bag': replayed, 'random': random_scene, 'doubt': doubtful_scene}[group](*job)


def replayed(name):
    from polymap_ros.commands import replay

    _replayed_once(replay)
    with tempfile.TemporaryDirectory() as folder:
        seconds = _replay(replay, TOP / 'bags' / name, folder)
        return f'bag/{name}', json.loads((Path(folder) / 'polygon.json').read_bytes()), seconds


@functools.cache
def _replayed_once(replay):
    """Import and compile what a replay needs."""
    with tempfile.TemporaryDirectory() as folder:
        _replay(replay, TOP / 'bags' / BAGS[0], folder)


def _replay(replay, bag, folder):
    begun = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as told:
        status = replay.main([str(bag), '--output', str(folder)])
    if status > 1:
        sys.exit(f'polymap_replay {bag}: status {status}: {told.getvalue()}')
    return time.process_time() - begun


def random_scene(variant, seed, edges, snr_db):
    from polymap_ros.evaluation.variants import VARIANTS

    scene = dataclasses.replace(VARIANTS[variant].make(seed, edges), snr_db=snr_db)
    return f'random/{variant}-{edges}-{seed}@{snr_db:g}dB', *solved(scene)


def doubtful_scene(kind, seed, edges):
    from polymap_ros.simulation.doubtful_scenes import KINDS

    made = KINDS[kind].make(seed, edges)
    scene = dataclasses.replace(made.scene, name=f'{kind}-{edges}-{seed}', snr_db=0.0)
    return f'doubt/{scene.name}', *solved(scene, made.clean)


def solved(scene, clean=None):
    """The answer as polygon.json has it, and the CPU time of the solve [s]."""
    from polymap_ros.evaluation.trials import filled_mapper
    from polymap_ros.parameters import Parameters
    from polymap_ros.results.polygon_json import polygon_document

    mapper = filled_mapper(scene, Parameters(), clean)
    begun = time.process_time()
    estimate = mapper.solve()
    seconds = time.process_time() - begun
    return json.loads(json.dumps(polygon_document(estimate, 'odom', mapper.counts, mapper.parameters))), seconds


def compare(arguments):
    old, new = (json.loads(file.read_bytes()) for file in (arguments.old, arguments.new))
    if old['environment'] != new['environment']:
        print(f'Different environments: {old["environment"]} against {new["environment"]}')
    both = [name for name in old['answers'] if name in new['answers']]
    missing = len(old['answers']) - len(both)
    changes = {name: list(differences(old['answers'][name], new['answers'][name])) for name in both}
    unequal = [name for name in both if not all(within(change, arguments.tolerance) for change in changes[name])]
    print(f'{len(both) - len(unequal)} of {len(old["answers"])} answers are equal'
          + (f' within {arguments.tolerance:g}' if arguments.tolerance else '')
          + (f'; {missing} are only in {arguments.old}' if missing else '')
          + (f'; {len(new["answers"]) - len(both)} more in {arguments.new}' if len(new['answers']) > len(both) else ''))
    if added := keys([*new['answers'].values()]) - keys([*old['answers'].values()]):
        print(f'Keys that are new: {", ".join(sorted(added))}')
    print_fields(changes)
    for name in both:
        print_verdict(name, old['answers'][name], new['answers'][name])
    print_seconds([(old['seconds'][name], new['seconds'][name]) for name in both])
    return int(bool(missing or unequal))


def differences(old, new, field=''):
    """Yield field, old and new value where an answer differs; a key that is not there any more is None."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key, value in old.items():
            yield from differences(value, new.get(key), f'{field}.{key}' if field else key)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f'number of {field}', str(len(old)), str(len(new))
        for one, other in zip(old, new, strict=False):
            yield from differences(one, other, field)
    elif old != new:
        yield field, old, new


def change_of(field, old, new):
    """The magnitude of a change of a number, None of anything else."""
    if not all(isinstance(value, (int, float)) for value in (old, new)):
        return None
    change = abs(new - old)
    return min(change, abs(2.0 * math.pi - change)) if field.rpartition('.')[2] in ANGLES else change


def within(change, tolerance):
    size = change_of(*change)
    return tolerance > 0.0 and (change[0] == 'warnings.text' if size is None else size <= tolerance)


def keys(document):
    """Names of all fields, without where in a list they are."""
    if isinstance(document, list):
        return {key for entry in document for key in keys(entry)}
    if not isinstance(document, dict):
        return set()
    return {*document, *(f'{key}.{inner}' for key, value in document.items() for inner in keys(value))}


def print_fields(changes):
    """The greatest change of each field."""
    fields = {}
    for name, each in changes.items():
        for field, old, new in each:
            fields.setdefault(field, []).append((change_of(field, old, new), name, old, new))
    for field, entries in fields.items():
        size, name, old, new = max(entries, key=lambda entry: math.inf if entry[0] is None else entry[0])
        answers = len({entry[1] for entry in entries})
        print(f'{field}: {answers} answers, ' + (
            f'{old!s:.60} became {new!s:.60}' if size is None else f'at most {size:.3g}') + f' in {name}')


def print_verdict(name, old, new):
    """What a user would see first."""
    told = [f'{what} {before} became {after}' for what, before, after in (
        ('status', old['status'], new['status']), ('edges', len(old['edges']), len(new['edges'])),
        ('warnings', codes(old), codes(new))) if before != after]
    if told:
        print(f'{name}: {"; ".join(told)}')


def codes(answer):
    return ', '.join(sorted({warning['code'] for warning in answer['warnings']})) or 'none'


def print_seconds(pairs):
    sums = [sum(each) for each in zip(*pairs, strict=True)]
    if sums:
        print(f'CPU: {sums[1]:.1f} s against {sums[0]:.1f} s, ratio {sums[1] / sums[0]:.3f}; '
              f'median of the ratios {statistics.median(new / old for old, new in pairs):.3f}')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(required=True)
    keeping = verbs.add_parser('keep')
    keeping.add_argument('file', type=Path)
    keeping.add_argument('--package', type=Path, default=TOP, metavar='DIR')
    keeping.add_argument('--jobs', type=int, default=1, metavar='N')
    keeping.set_defaults(run=keep)
    comparing = verbs.add_parser('compare')
    comparing.add_argument('old', type=Path)
    comparing.add_argument('new', type=Path)
    comparing.add_argument('--tolerance', type=float, default=0.0, metavar='X')
    comparing.set_defaults(run=compare)
    arguments = parser.parse_args()
    return arguments.run(arguments)


if __name__ == '__main__':
    sys.exit(main())
