import ast
import pickle
from pathlib import Path

import pytest

import polymap_ros
from polymap_ros.errors import DROP_REASONS, BadPing, ParameterError, SceneError


@pytest.mark.parametrize('error', [
    ParameterError('grid.range_step_m', 'must be above 0'), BadPing('bad_samples', 'all zero'), SceneError('no room')])
def test_errors_come_back_whole_from_another_process(error):
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error)
    assert str(copy) == str(error)
    assert vars(copy) == vars(error)


def test_pings_are_dropped_for_registered_reasons_and_for_each_of_them():
    calls = [node for path in Path(polymap_ros.__file__).parent.rglob('*.py')
             for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))) if isinstance(node, ast.Call)]
    named = [call for call in calls if call.args and isinstance(call.args[0], ast.Constant) and (
        getattr(call.func, 'id', '') == 'BadPing' or getattr(call.func, 'attr', '') in ('drop', 'refuse'))]
    assert {call.args[0].value for call in named} == set(DROP_REASONS)


@pytest.mark.parametrize('reason', DROP_REASONS)
def test_what_is_said_of_a_drop_reason_is_a_clause(reason):
    said = DROP_REASONS[reason]
    assert said.meaning
    for text in said:
        assert not text.endswith('.')
        assert '|' not in text  # it is a cell of a table
