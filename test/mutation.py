"""Would a wrong sign be noticed? python test/mutation.py [--number N] [--seed S] [--jobs N] [--rooms ROOM...]

First runs the tests of the method's rooms on a copy, with numba's compilation off (what is compiled cannot be
traced) and on (what is not, takes hours), notes which of them execute which line, and prints the branch coverage. Then
changes one token of these rooms' sources at a time and runs the tests that execute it, the quickest first, with
compilation off where the file has kernels; a mutant that none of them notices is told. The mutants are a sample of all
changes, drawn with a seed. Ends with 0 where at least 85 % of them die. With ``--rooms``, only these are changed and
only their tests run: quicker, but what only another room notices counts as unnoticed. Needs the extra ``mutation``.
"""

import argparse
import ast
import json
import os
import queue
import random
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

TOP = Path(__file__).parents[1]
ROOMS = 'geometry', 'acoustics', 'hearing', 'maps', 'solvers', 'mapping', 'calibration'
SOURCES = [str(path.relative_to(TOP / 'polymap_ros')) for room in ROOMS
           for path in sorted((TOP / 'polymap_ros' / room).rglob('*.py')) if path.name != '__init__.py']
SWAPPED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.And: ast.Or, ast.Or: ast.And, ast.USub: ast.UAdd, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}
NAMES = {'sin': 'cos', 'cos': 'sin', 'min': 'max', 'max': 'min', 'minimum': 'maximum', 'maximum': 'minimum',
         'floor': 'ceil', 'ceil': 'floor', 'argmax': 'argmin', 'argmin': 'argmax', 'real': 'imag', 'imag': 'real'}


def pytest_runtest_logreport(report):
    """This file is a plugin of the runs that it starts: it notes how long each part of a test took, and its outcome."""
    if file := os.environ.get('MUTATION_REPORTS'):
        with Path(file).open('a', encoding='utf-8') as reports:
            reports.write(json.dumps((report.nodeid, report.duration, report.passed)) + '\n')


def places(tree):
    """Nodes that can be changed, in a fixed order; annotations and texts of errors are left alone."""
    typed = {id(inner) for node in ast.walk(tree) for part in ('annotation', 'returns')
             if isinstance(outer := getattr(node, part, None), ast.AST) for inner in ast.walk(outer)}
    typed |= {id(inner) for node in ast.walk(tree) if isinstance(node, (ast.JoinedStr, ast.Raise, ast.Assert))
              for inner in ast.walk(node)}
    return [node for node in ast.walk(tree) if id(node) not in typed and mutated(node)]


def mutated(node):
    """Change a node by a function, or None."""
    if isinstance(node, (ast.BinOp, ast.AugAssign, ast.BoolOp, ast.UnaryOp)) and type(node.op) in SWAPPED:
        return lambda: setattr(node, 'op', SWAPPED[type(node.op)]())
    if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED:
        return lambda: node.ops.__setitem__(0, SWAPPED[type(node.ops[0])]())
    if isinstance(node, ast.Attribute) and node.attr in NAMES:
        return lambda: setattr(node, 'attr', NAMES[node.attr])
    if isinstance(node, ast.Name) and node.id in NAMES and isinstance(node.ctx, ast.Load):
        return lambda: setattr(node, 'id', NAMES[node.id])
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return lambda: setattr(node, 'value', node.value + 1 if isinstance(node.value, int) else 2.0 * node.value + 0.1)
    return None


def copy_to(folder):
    """The sources and their tests."""
    for name in ('polymap_ros', 'test', 'bags'):
        shutil.copytree(TOP / name, folder / name, ignore=shutil.ignore_patterns('__pycache__'))
    shutil.copy(TOP / 'pyproject.toml', folder)
    return folder


def run_pytest(copy, arguments, compiled, limit_s, timeout_s=None, **environment):
    """The status of pytest on a copy; None if all takes longer than `timeout_s`. A test that takes `limit_s` fails."""
    environment = {**os.environ, 'PYTHONPATH': f'{copy}{os.pathsep}{copy / "test"}', 'OMP_NUM_THREADS': '1',
                   'NUMBA_DISABLE_JIT': '0' if compiled else '1', 'NUMBA_CACHE_DIR': str(copy / 'cache'), **environment}
    command = [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-p', 'mutation', f'--timeout={limit_s}',
               *arguments]
    try:
        return subprocess.run(command, cwd=copy, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                              timeout=timeout_s).returncode
    except subprocess.TimeoutExpired:
        return None


class Covering:
    """Which tests execute which lines, and how long each takes [s], with compilation off and on."""

    def __init__(self, folder):
        from coverage import CoverageData

        self.seconds = [_passed(folder.glob(f'{int(compiled)}-*.jsonl')) for compiled in (False, True)]
        self._data = CoverageData(str(folder / '.coverage'))
        self._data.read()
        self._files = {name: file for file in self._data.measured_files()
                       for name in SOURCES if file.endswith(f'polymap_ros/{name}')}
        print(f'tests that pass in time: {len(self.seconds[0])}, compiled {len(self.seconds[1])}', flush=True)

    def tests(self, name, node, tree, compiled):
        """Those that execute a node, the quickest first; of a constant, those that execute a line with its name."""
        by_line = self._data.contexts_by_lineno(self._files[name]) if name in self._files else {}
        lines = {node.lineno}
        for statement in tree.body:
            if isinstance(statement, ast.Assign) and statement.lineno <= node.lineno <= statement.end_lineno:
                names = {each.id for target in statement.targets for each in ast.walk(target)
                         if isinstance(each, ast.Name)}
                lines = {each.lineno for each in ast.walk(tree) if isinstance(each, ast.Name) and each.id in names}
        contexts = {context for line in lines for context in by_line.get(line, ()) if context}
        contexts = contexts or {context for each in by_line.values() for context in each if context}
        tests, seconds = {context.rpartition('|')[0] for context in contexts}, self.seconds[compiled]
        # What a shared fixture executes, all tests of its file may look at.
        files = {context.partition('::')[0] for context in contexts if context.endswith('|setup')}
        tests |= {test for test in seconds if test.partition('::')[0] in files}
        return sorted(tests & seconds.keys(), key=lambda test: seconds[test])


def _passed(reports):
    """The tests that passed, and the seconds that each took."""
    seconds, failed = {}, set()
    for line in (line for file in reports for line in file.read_text(encoding='utf-8').splitlines()):
        test, part_s, passed = json.loads(line)
        seconds[test] = seconds.get(test, 0.0) + part_s
        failed |= set() if passed else {test}
    return {test: seconds[test] for test in seconds.keys() - failed}


def covering(folder, rooms, limit_s, jobs):
    """Run all tests of the rooms with compilation off and on, each file of them in a process of its own."""
    copy = copy_to(folder / 'covered')
    options = *(f'--cov=polymap_ros.{room}' for room in rooms), '--cov-branch', '--cov-context=test'

    def run(file, compiled):
        name = f'{int(compiled)}-{"-".join(file.relative_to(copy).with_suffix("").parts)}'
        run_pytest(copy, [str(file.relative_to(copy)), *options, '--cov-report='], compiled, limit_s,
                   COVERAGE_FILE=str(copy / f'.coverage.{name}'), MUTATION_REPORTS=str(copy / f'{name}.jsonl'))

    files = sorted(file for room in rooms for file in (copy / 'test' / room).rglob('test_*.py'))
    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(run, files * 2, [True] * len(files) + [False] * len(files)))
    for command in ('combine', 'report'):
        subprocess.run([sys.executable, '-m', 'coverage', command], cwd=copy, check=True)
    return copy


def noticed(copy, tests, seconds, compiled, budget_s):
    """Whether one of the tests fails, of which the quickest are run."""
    chosen, total_s = [], 0.0
    for test in tests:
        total_s += seconds[test]
        if chosen and total_s > budget_s:
            break
        chosen.append(test)
    limit_s = 20.0 + 5.0 * max(seconds[test] for test in chosen)
    return run_pytest(copy, ['-x', *chosen], compiled, limit_s, 60.0 + 5.0 * min(total_s, budget_s)) != 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--number', type=int, default=300)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--limit', type=float, default=60.0, help='tests that take longer [s] are left out')
    parser.add_argument('--budget', type=float, default=120.0, help='tests that take so long [s] together are tried')
    parser.add_argument('--covered', type=Path, help='the folder of an earlier first run')
    parser.add_argument('--rooms', nargs='+', default=ROOMS, choices=ROOMS, help='default: all of the method')
    parser.add_argument('--files', nargs='+', default=SOURCES, choices=SOURCES, metavar='FILE',
                        help='sources that are changed, such as geometry/lines.py')
    arguments = parser.parse_args()
    texts = {name: (TOP / 'polymap_ros' / name).read_text(encoding='utf-8') for name in arguments.files
             if name.partition('/')[0] in arguments.rooms}
    sample = [(name, k) for name, text in texts.items() for k in range(len(places(ast.parse(text))))]
    random.Random(arguments.seed).shuffle(sample)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        covered = Covering(arguments.covered or covering(folder, arguments.rooms, arguments.limit, arguments.jobs))
        copies = queue.SimpleQueue()
        for number in range(arguments.jobs):
            copies.put(copy_to(folder / str(number)))

        def dies(mutant):
            name, k = mutant
            tree = ast.parse(texts[name])
            node = places(tree)[k]
            compiled = '@kernel' not in texts[name]
            tests, before = covered.tests(name, node, tree, compiled), ast.unparse(node)
            mutated(node)()
            copy = copies.get()
            (copy / 'polymap_ros' / name).write_text(ast.unparse(tree), encoding='utf-8')
            begun_s = time.monotonic()
            dead = bool(tests) and noticed(copy, tests, covered.seconds[compiled], compiled, arguments.budget)
            (copy / 'polymap_ros' / name).write_text(texts[name], encoding='utf-8')
            copies.put(copy)
            print(f'{"died" if dead else "LIVED"} {name}:{node.lineno}: {before} -> {ast.unparse(node)} '
                  f'({len(tests)} tests, {time.monotonic() - begun_s:.0f} s)', flush=True)
            return dead

        with ThreadPoolExecutor(arguments.jobs) as pool:
            died = list(pool.map(dies, sample[:arguments.number]))
    share = sum(died) / max(len(died), 1)
    print(f'{sum(died)} of {len(died)} mutants died: {share:.1%}')
    return share < 0.85


if __name__ == '__main__':
    sys.exit(main())
