"""Tables of the reference, from the sources that declare them; needs polymap_ros only, not Sphinx.

`write` is called by conf.py before the pages are read, which include what it writes.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import polymap_ros
from polymap_ros.cautions import CAUTIONS
from polymap_ros.commands.experiments import EXPERIMENTS
from polymap_ros.errors import DROP_REASONS
from polymap_ros.parameters import Parameters, specifications
from polymap_ros.specification import Specification

TOP = Path(polymap_ros.__file__).parents[1]
COMMANDS = 'replay', 'simulate', 'evaluate', 'node', 'play'
STAGES = {
    'recording': 'The recording', 'path': 'The path', 'echoes': 'The echoes', 'answer': 'The answer',
    'device': 'Device and odometry', 'calibration': 'Calibration', 'map': 'The occupancy map', 'node': 'The node',
}
"""Headings of what a warning is about."""

LIVE = ' (*live*)'
_COLUMNS = '96'
"""Width of the help."""


def parameters() -> str:
    """Return a table for each group of parameters."""
    defaults, sections = Parameters(), []
    for group in dict.fromkeys(each.name.partition('.')[0] for each in specifications()):
        about = (type(getattr(defaults, group)).__doc__ or '').partition('\n')[0]
        rows = [_parameter(each) for each in specifications() if each.name.startswith(f'{group}.')]
        table = _table(('parameter', 'default', 'type and range', 'what'), rows)
        sections.append(f'## {group}\n\n{about}\n\n{table}')
    return '\n\n'.join(sections)


def warnings() -> str:
    """Return a table of the warnings for each stage."""
    sections = []
    for stage, heading in STAGES.items():
        rows = [(f'`{code}`', _code(kind.meaning), _code(kind.remedy)) for code, kind in CAUTIONS.items()
                if kind.about == stage]
        sections.append(f'## {heading}\n\n{_table(("code", "what it means", "what to do"), rows)}')
    return '\n\n'.join(sections)


def drops() -> str:
    """Return the table of drop reasons."""
    general = CAUTIONS['pings_dropped'].remedy
    return _table(('reason', 'what it means', 'what to do'), (
        (f'`{reason}`', _code(said.meaning), _code(said.remedy or general)) for reason, said in DROP_REASONS.items()))


def commands() -> str:
    """Return what ``--help`` of every command says, and of every experiment."""
    sections = []
    for name in COMMANDS:
        sections.append(f'## polymap_{name}\n\n{_help(name)}')
        if name == 'evaluate':
            sections += [f'### polymap_evaluate {each}\n\n{_help(name, each)}' for each in EXPERIMENTS]
    return '\n\n'.join(sections)


PAGES = {'parameters': parameters, 'warnings': warnings, 'drops': drops, 'commands': commands}


def write(folder: Path) -> None:
    """Write every page's tables, and copies of what lies outside of the documentation, into a folder."""
    folder.mkdir(exist_ok=True)
    for name, content in PAGES.items():
        _put(folder / f'{name}.md', f'{content()}\n')
    for picture in (*TOP.glob('resource/*.png'), *TOP.glob('resource/*.gif')):
        shutil.copyfile(picture, folder / picture.name)
    contributing = TOP / 'CONTRIBUTING.md'
    _put(folder / contributing.name, contributing.read_text(encoding='utf-8').replace('](doc/', ']('))


def _put(path: Path, text: str) -> None:
    """Write a file, unless it is so already: Sphinx then need not read again what includes it."""
    if not path.is_file() or path.read_text(encoding='utf-8') != text:
        path.write_text(text, encoding='utf-8')


def _parameter(spec: Specification) -> tuple[str, ...]:
    default = str(spec.default).lower() if spec.type is bool else str(spec.default) or "''"
    allowed = f'string: {", ".join(f"`{each}`" for each in spec.choices)}' if spec.choices else spec.allowed()
    return f'`{spec.name}`', f'`{default}`', allowed, f'{_code(spec.text)}{LIVE if spec.live else ""}'


def _code(text: str) -> str:
    """Set off the names of parameters and options in a sentence."""
    names = {each.name for each in specifications()} | {each.name.partition('.')[2] for each in specifications()}
    return ' '.join(_worded(word, names) for word in text.split(' '))


def _worded(word: str, names: set[str]) -> str:
    head, bare, tail = re.fullmatch(r'(\(?)(.*?)([,;:)]*)', word).groups()  # type: ignore[union-attr]
    is_name = bare in names and ('_' in bare or '.' in bare)
    return f'{head}`{bare}`{tail}' if is_name or bare.startswith(('--', '~/')) else word


def _help(name: str, *arguments: str) -> str:
    """Return a command's help as a block, as it is printed."""
    environment = {**os.environ, 'COLUMNS': _COLUMNS, 'PYTHONPATH': os.pathsep.join((str(TOP), *sys.path))}
    told = subprocess.run([sys.executable, '-m', f'polymap_ros.commands.{name}', *arguments, '--help'], check=True,
                          capture_output=True, text=True, encoding='utf-8', env=environment)
    return f'```text\n{told.stdout.rstrip()}\n```'


def _table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """Return a table of Markdown."""
    return '\n'.join(f'| {" | ".join(cells)} |' for cells in (header, ('---',) * len(header), *rows))
