"""Would a wrong sign be noticed? python test/mutation.py [--number N] [--seed S] [--minutes M] [--files FILE...]

Changes one token of the solver's sources at a time, in a copy, and runs the tests of that file; a mutant that no test
notices is printed. A sample of all changes, drawn with a seed. Ends with 0 where at least 85 % of the mutants die.
"""

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TOP = Path(__file__).parents[1]
EVIDENCE = 'mapping/evidence'
SOURCES = {
    'acoustics/matched_filter.py': ['acoustics/test_matched_filter.py'],
    'mapping/beamforming.py': ['mapping/test_beamforming.py'],
    'mapping/lines.py': ['mapping/test_lines.py', 'mapping/test_paper_solver.py'],
    'mapping/paper_solver.py': ['mapping/test_paper_solver.py'],
    **{f'{EVIDENCE}/{name}.py': [f'{EVIDENCE}/test_{name}.py', f'{EVIDENCE}/test_search.py']
       for name in ('data', 'paths', 'power', 'proposals', 'waveform', 'positions')},
    f'{EVIDENCE}/power_search.py': [f'{EVIDENCE}/test_power.py', f'{EVIDENCE}/test_search.py'],
    f'{EVIDENCE}/search.py': [f'{EVIDENCE}/test_search.py'],
    f'{EVIDENCE}/certainty.py': [f'{EVIDENCE}/test_solver.py'],
    f'{EVIDENCE}/solver.py': [f'{EVIDENCE}/test_solver.py'],
}
"""What is changed, and the tests that have to notice, the first ones first."""

SWAPPED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.And: ast.Or, ast.Or: ast.And, ast.USub: ast.UAdd, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}
NAMES = {'sin': 'cos', 'cos': 'sin', 'min': 'max', 'max': 'min', 'minimum': 'maximum', 'maximum': 'minimum',
         'floor': 'ceil', 'ceil': 'floor', 'argmax': 'argmin', 'argmin': 'argmax', 'real': 'imag', 'imag': 'real'}


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


def noticed(copy, tests, timeout_s):
    """Whether a test fails, or takes far longer than it should."""
    environment = {**os.environ, 'PYTHONPATH': str(copy)}
    for test in tests:
        command = [sys.executable, '-m', 'pytest', '-q', '-x', '-p', 'no:cacheprovider', f'test/{test}']
        try:
            if subprocess.run(command, cwd=copy, env=environment, capture_output=True, timeout=timeout_s).returncode:
                return True
        except subprocess.TimeoutExpired:
            return True
    return False


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--number', type=int, default=300)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--minutes', type=float, default=float('inf'), help='begin no mutant after so long')
    parser.add_argument('--files', nargs='*', default=list(SOURCES), choices=list(SOURCES))
    arguments = parser.parse_args()
    texts = {name: (TOP / 'polymap_ros' / name).read_text(encoding='utf-8') for name in arguments.files}
    sample = [(name, k) for name, text in texts.items() for k in range(len(places(ast.parse(text))))]
    random.Random(arguments.seed).shuffle(sample)
    begun_s, died, lived = time.monotonic(), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in ('polymap_ros', 'test', 'bags'):
            shutil.copytree(TOP / name, copy / name, ignore=shutil.ignore_patterns('__pycache__'))
        shutil.copy(TOP / 'pyproject.toml', copy)
        for tests in {tuple(SOURCES[name]) for name in arguments.files}:
            assert not noticed(copy, tests, 3600.0), f'{tests} fail as they are'
        for name, k in sample[:arguments.number]:
            if time.monotonic() - begun_s > 60.0 * arguments.minutes:
                break
            tree = ast.parse(texts[name])
            node = places(tree)[k]
            before = ast.unparse(node)
            mutated(node)()
            (copy / 'polymap_ros' / name).write_text(ast.unparse(tree), encoding='utf-8')
            dead = noticed(copy, SOURCES[name], 600.0)
            died, lived = died + dead, lived + (not dead)
            if not dead:
                print(f'{name}:{node.lineno}: {before} -> {ast.unparse(node)}', flush=True)
            (copy / 'polymap_ros' / name).write_text(texts[name], encoding='utf-8')
    share = died / max(died + lived, 1)
    print(f'{died} of {died + lived} mutants died: {share:.0%}')
    return share < 0.85


if __name__ == '__main__':
    sys.exit(main())
