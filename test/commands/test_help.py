"""What --help says: examples that are command lines of the command at hand."""

import importlib
import re
import shlex

import pytest

COMMANDS = 'node', 'replay', 'play', 'simulate', 'evaluate'


def help_of(name, capsys):
    with pytest.raises(SystemExit) as caught:
        importlib.import_module(f'polymap_ros.commands.{name}').main(['--help'])
    assert caught.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize('name', COMMANDS)
def test_help_ends_with_examples(name, capsys):
    told = help_of(name, capsys)
    examples = told.partition('\nexamples:\n')[2].splitlines()
    assert 2 <= len(examples) <= 4
    for line in examples:
        assert line.startswith('  polymap_')
        assert len(line) < 120
    assert sum(line.startswith(f'  polymap_{name}') for line in examples) >= 2


@pytest.mark.parametrize('name', ['replay', 'simulate', 'evaluate', 'play'])
def test_examples_are_understood(name, capsys):
    examples = re.findall(rf'^  polymap_{name} (.*)$', help_of(name, capsys), re.MULTILINE)
    module = importlib.import_module(f'polymap_ros.commands.{name}')
    parser = module.parser() if name == 'evaluate' else module._parser()
    for line in examples:
        words = [word for word in shlex.split(line.partition(' --ros-args')[0], comments=True) if word != '--help']
        parser.parse_intermixed_args(words if '--output' in words or name != 'evaluate' else [*words, '--output', 'x'])


@pytest.mark.parametrize('columns', ['80', '200'])
def test_help_fits_the_terminal(columns, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', columns)
    told = help_of('replay', capsys).partition('\nexamples:')[0]
    assert max(map(len, told.splitlines())) <= int(columns)
