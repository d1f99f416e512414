"""The documentation: tables made of the sources are complete, and pages name what is there. Sphinx is not needed.

That the pages build without a warning is for .ci/run to see.
"""

import re
from pathlib import Path

import generated
import pytest

import polymap_ros
from polymap_ros.cautions import CAUTIONS
from polymap_ros.commands.experiments import EXPERIMENTS
from polymap_ros.errors import DROP_REASONS
from polymap_ros.parameters import specifications

TOP = Path(__file__).parents[1]
DOC = TOP / 'doc'
PAGES = {str(path.relative_to(DOC)): path.read_text(encoding='utf-8') for path in DOC.rglob('*.md')
         if '_generated' not in path.parts and '_build' not in path.parts}
COMMANDS = 'node', 'replay', 'play', 'simulate', 'evaluate'


@pytest.fixture(scope='module')
def tables(tmp_path_factory):
    """What is written before the pages are read, by name."""
    folder = tmp_path_factory.mktemp('doc') / '_generated'
    generated.write(folder)
    return {path.stem: path.read_text(encoding='utf-8') for path in folder.glob('*.md')}


def cells(table):
    """Rows of all tables by their first cell, without the marks of code."""
    rows = [line.strip('| ').split(' | ') for line in table.splitlines() if line.startswith('| `')]
    assert len(rows) == len({row[0] for row in rows})
    return {row[0].strip('`'): [cell.replace('`', '') for cell in row[1:]] for row in rows}


def test_every_parameter_is_told_as_its_source_declares_it(tables):
    rows = cells(tables['parameters'])
    assert list(rows) == [spec.name for spec in specifications()]
    for spec in specifications():
        default, allowed, what = rows[spec.name]
        assert default == (str(spec.default).lower() if spec.type is bool else str(spec.default) or "''")
        assert allowed == (f'string: {", ".join(spec.choices)}' if spec.choices else spec.allowed())
        assert what == f'{spec.text}{" (*live*)" if spec.live else ""}'


def test_every_warning_is_told_with_its_remedy(tables):
    rows = cells(tables['warnings'])
    assert set(rows) == set(CAUTIONS)
    for code, kind in CAUTIONS.items():
        assert rows[code] == [kind.meaning.replace('`', ''), kind.remedy]


def test_every_drop_reason_is_told_with_what_to_do(tables):
    rows = cells(tables['drops'])
    assert set(rows) == set(DROP_REASONS)
    for reason, said in DROP_REASONS.items():
        assert rows[reason] == [said.meaning, said.remedy or CAUTIONS['pings_dropped'].remedy]


def test_every_command_and_experiment_is_told_with_its_help(tables):
    told = dict(zip(*[iter(re.split(r'^##+ (polymap_.+)$', tables['commands'], flags=re.MULTILINE)[1:])] * 2,
                    strict=True))
    assert set(told) == {*(f'polymap_{name}' for name in COMMANDS),
                         *(f'polymap_evaluate {name}' for name in EXPERIMENTS)}
    for name, text in told.items():
        assert text.strip().startswith(f'```text\nusage: {name.partition(" ")[0]} ')
        assert '\nexamples:\n' in text
    assert '--fit-time-zero' in told['polymap_replay']
    assert '--drive' in told['polymap_evaluate random']
    assert '--drive' not in told['polymap_evaluate speed'], 'an option that does not act there'


def test_the_library_page_has_all_that_is_offered():
    documented = re.findall(r'^\.\. auto\w+:: (\w+)$', PAGES['reference/api.md'], re.MULTILINE)
    assert sorted(documented) == sorted(polymap_ros.__all__)


def test_every_table_is_on_a_page():
    included = {name for text in PAGES.values() for name in re.findall(r'_generated/(\w+)\.md$', text, re.MULTILINE)}
    assert included >= set(generated.PAGES)


@pytest.mark.parametrize('page', PAGES)
def test_links_lead_to_pages(page):
    links = [link for link in re.findall(r'\]\(([^)#\s]+)', PAGES[page])
             if '://' not in link and not link.startswith('_generated/')]
    assert [link for link in links if not (DOC / page).parent.joinpath(link).is_file()] == []


@pytest.mark.parametrize('page', PAGES)
def test_parameters_and_warnings_that_pages_name_are_there(page):
    groups = {spec.name.partition('.')[0] for spec in specifications()}
    named = {name for name in re.findall(r'`(\w+\.\w+)(?:`|:)', PAGES[page]) if name.partition('.')[0] in groups}
    files = {name for name in named if name.endswith(('.py', '.pgm', '.yaml', '.npy'))}
    assert named - files - {spec.name for spec in specifications()} == set()


def test_recordings_named_in_commands_are_there():
    texts = [*PAGES.values(), (TOP / 'README.md').read_text(encoding='utf-8')]
    named = set(re.findall(r'bags/\w+', '\n'.join(texts)))
    assert named
    for name in named:
        assert (TOP / name).is_dir()


def test_the_quick_start_has_the_blocks_of_the_readme():
    readme = (TOP / 'README.md').read_text(encoding='utf-8')
    blocks = re.findall(r'^```(?:sh|python)\n(.*?)^```$', readme, re.MULTILINE | re.DOTALL)
    assert blocks[0] in PAGES['quickstart.md']
    assert [block for block in blocks if 'import' in block and block not in PAGES['quickstart.md']] == []
