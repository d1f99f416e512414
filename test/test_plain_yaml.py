"""YAML that is meant to do harm ends in YAMLError, at once."""

import pytest
import yaml

from polymap_ros.errors import SceneError, UsageError
from polymap_ros.parameter_file import load_parameters
from polymap_ros.plain_yaml import read_yaml
from polymap_ros.simulation.scene_file import load_scene

LAUGHS = 'a0: &a0 {x: 1}\n' + '\n'.join(f'a{k}: &a{k} {{p: *a{k - 1}, q: *a{k - 1}}}' for k in range(1, 60))
HOSTILE = {
    'aliases of aliases': LAUGHS,
    'nested too deeply': '[' * 100_000,
    'mappings nested too deeply': '{a: ' * 100_000,
    'a tag that calls': '!!python/object/apply:os.getcwd []',
    'a tag of a class': '!!python/name:os.system',
    'a date that does not exist': 'a: 2001-02-30',
    'a number without end': 'a: 0x' + 'f' * 10_000 + '\nb: ' + '9' * 10_000,
    'a key that is no key': '? {a: 1}\n: 2',
    'no YAML': 'a: [',
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


def test_plain_values_are_what_ros_reads():
    text = 'a: 1e-6\nb: -2E+3\nc: 1.5\nd: 7\ne: text\nf: [1, 2.0]\ng: true\nh: {i: null}'
    assert read_yaml(text) == {'a': 1e-6, 'b': -2000.0, 'c': 1.5, 'd': 7, 'e': 'text', 'f': [1, 2.0], 'g': True,
                               'h': {'i': None}}
