"""A path with ~ is the one that a shell would make of it, wherever it is written."""

import os
from pathlib import Path

import pytest

from polymap_ros.commands import replay
from polymap_ros.errors import ParameterError, SceneError
from polymap_ros.parameter_file import load_parameters, parse_override
from polymap_ros.parameters import Parameters, specifications
from polymap_ros.paths import expanded
from polymap_ros.simulation.scene_file import load_scene

BAG = Path(__file__).parents[1] / 'bags' / 'triangle'
PATHS = [spec.name for spec in specifications() if spec.is_path]


@pytest.fixture
def home(tmp_path, monkeypatch):
    (tmp_path / 'home').mkdir()
    monkeypatch.setenv('HOME', str(tmp_path / 'home'))
    monkeypatch.chdir(tmp_path)
    return tmp_path / 'home'


def test_every_parameter_that_names_a_file_is_a_path():
    assert PATHS == ['pulse.path', 'output.dir', 'output.load_path']


@pytest.mark.parametrize('name', PATHS)
def test_home_is_found_from_a_file_and_from_the_command_line(home, name):
    path = home / 'p.yaml'
    path.write_text(f'polymap_node: {{ros__parameters: {{{name}: ~/maps}}}}')
    assert load_parameters(path)[name] == str(home / 'maps')
    assert Parameters().replaced(dict([parse_override(f'{name}:=~/maps')]))[name] == str(home / 'maps')
    assert Parameters().replaced({name: '~'})[name] == str(home)


def test_the_home_of_a_user():
    assert expanded('~root/maps') == os.path.expanduser('~root/maps') != '~root/maps'  # noqa: PTH111


@pytest.mark.parametrize('path', ['./~', 'maps/~', '', 'a~b', '/~', './$HOME', 'a$b'])
def test_any_other_path_is_left_alone(path):
    assert expanded(path) == path


@pytest.mark.parametrize(('path', 'says'), [
    ('~nobody-of-that-name/maps', 'there is no user nobody-of-that-name; write the whole path'),
    ('$HOME/maps', 'names a variable, which is not looked up here; write ~, or the whole path'),
    ('${HOME}', 'names a variable'), ('$(env HOME)/maps', 'names a variable'),
])
def test_what_only_a_shell_knows_is_refused_by_name(path, says):
    with pytest.raises(ParameterError, match=r'parameter output\.dir: ') as refused:
        Parameters().replaced({'output.dir': path})
    assert says in str(refused.value)
    with pytest.raises(SceneError, match=r'user nobody|a variable'):
        load_scene(path)


def test_results_land_at_home(home, capsys):
    """No shell expands the ~ in name:=~/maps, nor in --output=~/maps."""
    common = [str(BAG), '-p', 'solver.method:=paper', '-p', 'solver.iterations:=1']
    for more in (['-p', 'output.dir:=~/maps'], ['-p', 'output.load_path:=~/maps', '--output=~/more/of them']):
        assert replay.main([*common, *more]) == 1  # one iteration closes no polygon
    assert (home / 'maps' / 'polygon.json').is_file()
    assert (home / 'more' / 'of them' / 'polygon.json').is_file()
    assert not Path('~').exists()
    with pytest.raises(SystemExit):
        replay.main([str(BAG), '--output', '~nobody-of-that-name/maps'])
    assert capsys.readouterr().err.endswith(
        "argument --output: '~nobody-of-that-name/maps': there is no user nobody-of-that-name; write the whole path "
        '(see polymap_replay --help)\n')
