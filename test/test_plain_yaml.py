"""YAML that is meant to do harm ends in YAMLError, at once."""

import math
import os
from pathlib import Path

import pytest
import yaml

from polymap_ros.errors import SceneError, UsageError
from polymap_ros.parameter_file import load_parameters
from polymap_ros.plain_yaml import MOST_BYTES, read_parameter_yaml, read_yaml
from polymap_ros.simulation.scene_file import load_scene

LAUGHS = 'a0: &a0 {x: 1}\n' + '\n'.join(f'a{k}: &a{k} {{p: *a{k - 1}, q: *a{k - 1}}}' for k in range(1, 60))
HOSTILE = {
    'aliases of aliases': LAUGHS,
    'nested too deeply': '[' * 100_000,
    'mappings nested too deeply': '{a: ' * 100_000,
    'a tag that calls': '!!python/object/apply:os.getcwd []',
    'a tag of a class': '!!python/name:os.system',
    'a key that is no key': '? {a: 1}\n: 2',
    'no YAML': 'a: [',
    'a key twice': 'a: 1\nb: 2\na: 1',
    'a key twice further in': 'a: {b: {c: 1, d: 2, c: 3}}',
    'many keys, all of them twice': ', '.join(f'{k}: 0' for k in range(20_000)).join('{}').replace('}', ', 7: 0}'),
}


@pytest.mark.parametrize('text', HOSTILE.values(), ids=HOSTILE)
def test_hostile_yaml_is_refused(tmp_path, text):
    with pytest.raises(yaml.YAMLError):
        read_yaml(text)
    path = tmp_path / 'hostile.yaml'
    path.write_text(text)
    with pytest.raises(UsageError, match=r'hostile\.yaml: is not YAML: '):
        load_parameters(path)
    with pytest.raises(SceneError, match=r'hostile\.yaml: is not YAML: '):
        load_scene(str(path), None)


def test_what_is_no_number_is_text():
    digits = '9' * 10_000
    text = f'a: 2001-02-30\nb: 0x{"f" * 10_000}\nc: {digits}\nd: 1e400\ne: 1_000\nf: 0b11'
    assert read_yaml(text) == {'a': '2001-02-30', 'b': '0x' + 'f' * 10_000, 'c': digits, 'd': '1e400', 'e': '1_000',
                               'f': '0b11'}


def test_keys_are_text():
    assert read_yaml('1: 2\nyes: 3\n2026-11-29: 4\n=: 5\n<<: {a: 1}') == {
        '1': 2, 'yes': 3, '2026-11-29': 4, '=': 5, '<<': {'a': 1}}


def test_nothing_is_none_but_in_a_parameter_file_only_what_is_not_there():
    text = '[~, null, "~", , ]'.replace(' , ', " '' , ")
    assert read_yaml(text) == [None, None, '~', '']
    assert read_parameter_yaml(text) == ['~', 'null', '~', '']
    assert read_parameter_yaml('a:') == {'a': None}


def test_plain_values_are_what_ros_reads():
    text = 'a: 1e-6\nb: -2E+3\nc: 1.5\nd: 7\ne: text\nf: [1, 2.0]\ng: true\nh: {i: null}'
    assert read_yaml(text) == {'a': 1e-6, 'b': -2000.0, 'c': 1.5, 'd': 7, 'e': 'text', 'f': [1, 2.0], 'g': True,
                               'h': {'i': None}}


def test_numbers_are_those_of_ros():
    """PyYAML's 1.1 takes 1:30 for 90 and 1_000 for 1000."""
    text = 'a: 1:30\nb: 1_000\nc: 1:30.5\nd: 0x1f\ne: 010\ng: .5\nh: -7.\ni: +3\nj: -.inf\nl: 0'
    assert read_yaml(text) == {'a': '1:30', 'b': '1_000', 'c': '1:30.5', 'd': 31, 'e': 8, 'g': 0.5, 'h': -7.0,
                               'i': 3, 'j': -math.inf, 'l': 0}
    assert math.isnan(read_yaml('.nan'))


def test_a_file_without_end_is_not_read(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    with (tmp_path / 'large.yaml').open('w') as file:
        file.truncate(MOST_BYTES + 1)
    for path in ('/dev/zero', tmp_path / 'pipe', tmp_path / 'large.yaml'):
        with pytest.raises(UsageError, match=rf'{path}: cannot be read'):
            load_parameters(Path(path))
        with pytest.raises(SceneError, match='no scene file that can be read'):
            load_scene(str(path))


@pytest.mark.parametrize(('text', 'says'), [
    ('polymap_node:\n  ros__parameters: {solver.seed: 5, solver: {seed: 5}}', 'polymap_node has solver.seed twice'),
    ('/a/polymap_node:\n  ros__parameters: {solver.seed: 6}\n/b/polymap_node:\n  ros__parameters: {solver.seed: 7}',
     'is for several nodes, of which one is asked for: /a/polymap_node, /b/polymap_node'),
])
def test_no_value_of_a_parameter_file_is_lost_without_a_word(tmp_path, text, says):
    path = tmp_path / 'two.yaml'
    path.write_text(text)
    with pytest.raises(UsageError, match=says):
        load_parameters(path)
