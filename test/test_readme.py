"""README.md says what is so: its commands and its library block run, and what it names is there."""

import re
from pathlib import Path

import numpy as np
import pytest

from polymap_ros.geometry.polygon_error import compare
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scene_file import load_scene

TOP = Path(__file__).parents[1]
README = (TOP / 'README.md').read_text(encoding='utf-8')
MOST_WORDS = 1200


def blocks(language):
    return re.findall(rf'^```{language}\n(.*?)^```$', README, re.MULTILINE | re.DOTALL)


def test_it_is_read_in_a_few_minutes():
    assert len(README.split()) < MOST_WORDS


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


def test_the_five_parameters_have_these_defaults():
    rows = re.findall(r'^\| `(\w+\.\w+)` \| (\S+) \|', README, re.MULTILINE)
    assert len(rows) == 5
    assert {name: default.strip('`') for name, default in rows} == {name: str(Parameters()[name]) for name, _ in rows}


@pytest.mark.parametrize('link', re.findall(r'\]\(([^)#]+)', README))
def test_links_lead_to_files(link):
    assert (TOP / link).is_file()
