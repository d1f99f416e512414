"""test/golden.py, the comparison: what counts as equal, what is told."""

import copy
import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

ANSWER = {
    'status': 'closed', 'vertices': [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
    'edges': [{'r': 0.5, 'theta': 2.0 * math.pi - 1e-9, 'r_std': None}] * 3,
    'warnings': [{'code': 'weak', 'text': 'Edge 1 is weak'}]}


@pytest.fixture
def compared(tmp_path):
    """Compare the answer, twice, with a changed one beside it unchanged."""
    def run(change, *options):
        changed = copy.deepcopy(ANSWER)
        change(changed)
        files = [tmp_path / 'old.json', tmp_path / 'new.json']
        for file, answer, seconds in zip(files, (ANSWER, changed), (1.0, 3.0), strict=True):
            file.write_text(json.dumps({'environment': {}, 'answers': {'a': answer, 'b': ANSWER},
                                        'seconds': {'a': seconds, 'b': 1.0}}))
        done = subprocess.run([sys.executable, Path(__file__).with_name('golden.py'), 'compare', *files, *options],
                              capture_output=True, text=True, check=False)
        assert not done.stderr
        return done.returncode, done.stdout
    return run


def test_equal_answers_end_with_0_whatever_is_added(compared):
    status, told = compared(lambda answer: answer.update(holes=[], edges=[
        {**edge, 'reflection': 1.0} for edge in answer['edges']]))
    assert (status, told.splitlines()) == (0, [
        '2 of 2 answers are equal', 'Keys that are new: edges.reflection, holes',
        'CPU: 4.0 s against 2.0 s, ratio 2.000; median of the ratios 2.000'])


def test_the_last_bit_counts_unless_a_tolerance_is_given(compared):
    def move(answer):
        answer['vertices'][1] = [math.nextafter(1.0, 2.0), 0.0]
        answer['edges'][2] = {**answer['edges'][2], 'theta': 1e-9}
        answer['warnings'][0]['text'] = 'Edge 2 is weak'

    status, told = compared(move)
    assert status == 1
    assert told.splitlines()[:4] == [
        '1 of 2 answers are equal', 'vertices: 1 answers, at most 2.22e-16 in a',
        'edges.theta: 1 answers, at most 2e-09 in a',
        'warnings.text: 1 answers, Edge 1 is weak became Edge 2 is weak in a']
    assert compared(move, '--tolerance', '1e-8')[0] == 0
    assert compared(move, '--tolerance', '1e-9')[0] == 1


@pytest.mark.parametrize(('change', 'line'), [
    (lambda answer: answer.update(status='open'), 'a: status closed became open'),
    (lambda answer: answer['edges'].pop(), 'a: edges 3 became 2'),
    (lambda answer: answer['warnings'].clear(), 'a: warnings weak became none'),
    (lambda answer: answer['edges'].__setitem__(0, {**answer['edges'][0], 'r_std': 0.1}),
     'edges.r_std: 1 answers, None became 0.1 in a'),
    (lambda answer: answer.pop('vertices'),
     'vertices: 1 answers, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] became None in a'),
])
def test_what_a_user_would_see_is_told_and_no_tolerance_allows_it(compared, change, line):
    status, told = compared(change, '--tolerance', '10')
    assert status == 1
    assert line in told.splitlines()
