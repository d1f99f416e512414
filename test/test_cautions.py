"""Warnings are an interface: every code is registered once, made somewhere, and explained with a remedy."""

import ast
from pathlib import Path

import pytest

import polymap_ros
from polymap_ros.cautions import CAUTIONS, Caution, causes, in_metres, of_the_first_stage, with_those_of_samples

PACKAGE = Path(polymap_ros.__file__).parent
STRINGS = {
    path: [node.value for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
           if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    for path in PACKAGE.rglob('*.py')}


def test_an_unknown_code_cannot_be_made():
    with pytest.raises(ValueError, match='no_such_code: no registered caution; known: recording_damaged, '):
        Caution('no_such_code', 'whatever')


@pytest.mark.parametrize('code', CAUTIONS)
def test_a_registered_code_is_made_somewhere(code):
    assert any(code in strings for path, strings in STRINGS.items() if path.name != 'cautions.py')


def test_codes_in_calls_are_registered():
    calls = [node for path in PACKAGE.rglob('*.py') for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
             if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == 'Caution']
    codes = {call.args[0].value for call in calls if isinstance(call.args[0], ast.Constant)}
    assert codes
    assert codes <= set(CAUTIONS)


@pytest.mark.parametrize('code', CAUTIONS)
def test_sentences_are_clauses(code):
    kind = CAUTIONS[code]
    for text in (kind.meaning, kind.remedy):
        assert text
        assert not text.endswith('.')
        assert '\n' not in text
        assert '  ' not in text
        assert '|' not in text  # it is a cell of a table


def test_what_was_found_comes_with_what_to_do():
    assert Caution('straight_path', 'so it is').text == f'so it is; {CAUTIONS["straight_path"].remedy}'
    assert Caution('straight_path', 'so it is', 'do that').text == 'so it is; do that'


def picked(*codes):
    return [caution.code for caution in causes([Caution(code, '') for code in codes])]


@pytest.mark.parametrize(('told', 'cause'), [
    ([], []),
    (['not_closed', 'weak_edge', 'recording_incomplete'], ['not_closed']),
    (['not_closed', 'wrong_odometry'], ['wrong_odometry']),
    (['not_closed', 'echo_band', 'wrong_medium'], ['echo_band']),
    (['not_closed', 'not_calibrated', 'direct_wave'], ['not_closed']),
    (['straight_path', 'not_closed', 'odometry_dropped'], ['straight_path']),
    (['not_closed', 'recording_damaged', 'pings_dropped'], ['pings_dropped', 'not_closed']),
    (['straight_path', 'pings_dropped'], ['pings_dropped']),
    (['too_few_pings', 'recording_damaged', 'calibrated', 'wrong_type'],
     ['too_few_pings', 'recording_damaged', 'wrong_type'])])
def test_the_earliest_stage_at_fault_is_the_cause(told, cause):
    assert picked(*told) == cause


def test_where_pings_were_dropped_nobody_is_sent_on_pinging():
    few, dropped, path = (Caution(code, '') for code in ('too_few_pings', 'pings_dropped', 'straight_path'))
    assert of_the_first_stage([few, path], [dropped]) == (path,)
    assert of_the_first_stage([few, path], [path]) == (few, path)


@pytest.mark.parametrize(('length_m', 'text'), [
    (1.97e-16, '0 mm'), (0.0123, '12 mm'), (0.0996, '100 mm'), (0.25, '0.25 m'), (12.3456, '12.3 m'),
    (1234.5, '1234 m')])
def test_lengths_are_rounded_sensibly(length_m, text):
    assert in_metres(length_m) == text


def test_a_polygon_that_explains_the_echoes_shows_that_the_period_is_right():
    band, hum, drift, doubt, gap = (Caution(code, '') for code in (
        'echo_band', 'baseline_drift', 'odometry_drift', 'unexplained', 'not_closed'))
    assert with_those_of_samples(True, [drift], [hum, band]) == (drift, hum)
    assert with_those_of_samples(True, [doubt], [band]) == (doubt, band)
    assert with_those_of_samples(False, [gap, doubt], [band]) == (band,)
    assert with_those_of_samples(False, [gap], []) == (gap,)
