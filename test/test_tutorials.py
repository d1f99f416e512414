"""The pages with code that runs: the blocks of each page, in order, are one program that prints what the page says."""

import re
from pathlib import Path

import numpy as np
import pytest

DOC = Path(__file__).parents[1] / 'doc'
PAGES = 'tutorials/ping.md', 'tutorials/plate.md', 'method/moves.md'
NUMBER = re.compile(r'[-+]?\d+\.?\d*')
RELATIVE, ABSOLUTE = 0.5, 0.1
"""Numbers that are printed may differ so much: what they must not, the pages assert."""


def printed(text):
    """The words of a text without its numbers, and these."""
    return NUMBER.sub('#', text).split(), [float(number) for number in NUMBER.findall(text)]


@pytest.mark.parametrize('name', PAGES)
def test_the_blocks_of_a_page_run_in_order_and_print_what_it_says(name, capsys):
    text = (DOC / name).read_text(encoding='utf-8')
    blocks = list(re.finditer(r'^```python\n(.*?)^```$(?:\n\n```text\n(.*?)^```$)?', text, re.MULTILINE | re.DOTALL))
    assert any('assert ' in block[1] for block in blocks)
    names = {'__name__': name}
    for block in blocks:
        line = text.count('\n', 0, block.start(1))
        exec(compile('\n' * line + block[1], str(DOC / name), 'exec'), names)  # failures name the line of the page
        words, numbers = printed(capsys.readouterr().out)
        expected_words, expected_numbers = printed(block[2] or '')
        assert words == expected_words
        np.testing.assert_allclose(numbers, expected_numbers, rtol=RELATIVE, atol=ABSOLUTE)
