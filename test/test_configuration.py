"""polymap_ros/config/polymap.yaml: every parameter with its default, and what the source says of it."""

import re
from pathlib import Path

import pytest
import yaml

import polymap_ros
from polymap_ros.parameter_file import load_parameters
from polymap_ros.parameters import NODE_NAME, Parameters, specifications

FILE = Path(polymap_ros.__file__).parent / 'config' / 'polymap.yaml'


@pytest.fixture(scope='module')
def comments():
    """The comment above each parameter, by full name."""
    found, group, above = {}, '', ''
    for line in FILE.read_text(encoding='utf-8').splitlines():
        if match := re.fullmatch(r'      # (.+)', line):
            above = f'{above} {match[1]}'.strip()
        elif match := re.fullmatch(r'    (\w+):', line):
            group, above = match[1], ''
        elif match := re.fullmatch(r'      (\w+): .+', line):
            found[f'{group}.{match[1]}'], above = above, ''
        else:
            above = ''
    return found


def test_it_is_complete_in_order_and_at_the_defaults():
    tree = yaml.safe_load(FILE.read_text(encoding='utf-8'))[NODE_NAME]['ros__parameters']
    values = {f'{group}.{name}': value for group, entries in tree.items() for name, value in entries.items()}
    assert values == Parameters().flat()
    assert list(values) == list(Parameters().flat())
    # ROS takes no integer for a double: the file must write 3.0, not 3.
    assert {name: type(value) for name, value in values.items()} == {s.name: s.type for s in specifications()}
    assert load_parameters(FILE) == Parameters()


@pytest.mark.parametrize('spec', specifications(), ids=lambda spec: spec.name)
def test_every_parameter_is_explained_as_in_the_source(spec, comments):
    assert comments[spec.name] == f'{spec.text} [{spec.allowed()}{"; live" if spec.live else ""}]'
