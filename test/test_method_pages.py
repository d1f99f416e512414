"""The pages of the method lead to the code: each file and each name that they give is there."""

import importlib
import re
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
PAGES = sorted((TOP / 'doc' / 'method').glob('*.md'))
FILES = [path.relative_to(TOP).as_posix() for path in (*TOP.glob('polymap_ros/**/*.py'), *TOP.glob('doc/method/*.py'))]
WORDS = set(re.findall(r'\w+', '\n'.join((TOP / path).read_text(encoding='utf-8') for path in FILES)))


def given(page):
    """What a page gives as code, within the line."""
    text = re.sub(r'^```.*?^```$', '', page.read_text(encoding='utf-8'), flags=re.MULTILINE | re.DOTALL)
    return set(re.findall(r'`([^`\n]+)`', text))


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_files_are_there(page):
    for name in (name for name in given(page) if re.fullmatch(r'[\w/]+\.py', name)):
        assert any(f'/{path}'.endswith(f'/{name}') for path in FILES), name


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_names_are_in_the_code(page):
    for name in (name for name in given(page) if re.fullmatch(r'\w+(\.\w+)*', name) and not name.endswith('.py')):
        assert set(name.split('.')) <= WORDS, name


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_figures_and_sections_that_are_linked_are_there(page):
    text = page.read_text(encoding='utf-8')
    for name in re.findall(r'\]\((figures/[^)]+)\)', text):
        assert (page.parent / name).is_file()
    for name, section in re.findall(r'\]\((\w+\.md)#([\w-]+)\)', text):
        titles = re.findall(r'^#+ (.+)$', (page.parent / name).read_text(encoding='utf-8'), re.MULTILINE)
        assert section in [re.sub(r'[^\w -]', '', title).lower().replace(' ', '-') for title in titles]


@pytest.mark.heavy
@pytest.mark.parametrize('name', ['ping', 'images', 'power', 'waveform', 'cycles'])
def test_figures_are_drawn_by_the_code_as_it_is(name, monkeypatch):
    """Those that take seconds."""
    pytest.importorskip('matplotlib')
    monkeypatch.syspath_prepend(str(TOP / 'doc' / 'method'))
    figures = importlib.import_module('figures')
    assert figures.FIGURES[name]().axes
