"""The pages with code that runs: the blocks of each page, in order, are one program, and its asserts hold."""

import re
from pathlib import Path

import pytest

DOC = Path(__file__).parents[1] / 'doc'
PAGES = 'tutorials/ping.md', 'tutorials/plate.md', 'method/moves.md'


@pytest.mark.parametrize('name', PAGES)
def test_the_blocks_of_a_page_run_in_order(name):
    text = (DOC / name).read_text(encoding='utf-8')
    blocks = list(re.finditer(r'^```python\n(.*?)^```$', text, re.MULTILINE | re.DOTALL))
    assert any('assert ' in block[1] for block in blocks)
    names = {'__name__': name}
    for block in blocks:
        line = text.count('\n', 0, block.start(1))
        exec(compile('\n' * line + block[1], str(DOC / name), 'exec'), names)  # failures name the line of the page
