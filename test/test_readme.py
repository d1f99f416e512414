"""README.md says what is so: its library block runs, and its tables are those of the source."""

import re
from pathlib import Path

import numpy as np
import pytest

from polymap_ros.cautions import CAUTIONS
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.parameters import specifications
from polymap_ros.simulation.scene_file import load_scene

TOP = Path(__file__).parents[1]
README = (TOP / 'README.md').read_text(encoding='utf-8')


def blocks(language):
    return re.findall(rf'^```{language}\n(.*?)^```$', README, re.MULTILINE | re.DOTALL)


def parameter_table():
    lines = ['| parameter | default | allowed | live | what |', '| --- | --- | --- | --- | --- |']
    for spec in specifications():
        default = str(spec.default).lower() if spec.type is bool else str(spec.default) or "''"
        allowed = spec.allowed().replace('|', 'or')
        lines.append(f'| `{spec.name}` | {default} | {allowed} | {"yes" if spec.live else ""} | {spec.text} |')
    return '\n'.join(lines)


def test_the_first_two_shell_blocks_are_one_line_each():
    job, tests = blocks('sh')[:2]
    for line in (job, tests):
        assert line.count('\n') == 1
        assert line.startswith('python3 -m venv .venv && ')
    assert 'polymap_replay bags/' in job
    assert ' -m pytest ' in tests


def test_the_library_block_maps_a_plate():
    [code] = blocks('python')
    assert len([line for line in code.splitlines() if line]) <= 12
    names = {}
    exec(code, names)
    assert compare(names['vertices'], np.asarray(load_scene('triangle').vertices)).right


def test_the_parameter_table_is_the_source():
    [table] = re.findall(r'<!-- parameters -->\n(.*?)\n<!-- end of parameters -->', README, re.DOTALL)
    assert table == parameter_table()


def test_the_table_of_warnings_is_the_registry():
    [table] = re.findall(r'<!-- cautions -->\n(.*?)\n<!-- end of cautions -->', README, re.DOTALL)
    rows = [f'| `{code}` | {kind.meaning} | {kind.remedy} |' for code, kind in CAUTIONS.items()]
    assert table.splitlines() == ['| code | what it means | what to do |', '| --- | --- | --- |', *rows]


@pytest.mark.parametrize('link', re.findall(r'\]\(([^)#]+)\)', README))
def test_links_lead_to_files(link):
    assert (TOP / link).is_file()


def test_recordings_named_in_commands_are_there():
    named = set(re.findall(r'bags/\w+', '\n'.join(blocks('sh'))))
    assert named
    for name in named:
        assert (TOP / name).is_dir()
