"""How Sphinx builds this documentation, alone or by rosdoc2: sphinx-build -W --keep-going -b html doc doc/_build."""

import sys
from pathlib import Path

from numpydoc.xref import DEFAULT_LINKS
from sphinx.application import Sphinx

import polymap_ros

project = 'polymap_ros'
author = 'The polymap_ros maintainers'
copyright = '2026, The polymap_ros maintainers'
version = release = polymap_ros.__version__

extensions = ['myst_parser', 'numpydoc', 'sphinx.ext.autodoc', 'sphinx.ext.mathjax', 'sphinx.ext.viewcode']
# What rosdoc2 lays beside these pages is left alone: an index and a page of every module as .rst, and copies.
source_suffix = {'.md': 'markdown'}
exclude_patterns = ['_build', '_generated', 'standard_docs', 'user_docs']
default_role = 'py:obj'
smartquotes = False  # would make a dash of the two before an option

myst_enable_extensions = ['amsmath', 'colon_fence', 'deflist', 'dollarmath']
myst_heading_anchors = 3

autodoc_member_order = 'bysource'
autodoc_typehints = 'none'  # numpydoc's sections say them, with shapes and units
autodoc_preserve_defaults = True
autosummary_generate = False
numpydoc_show_class_members = False
numpydoc_xref_param_type = True
numpydoc_xref_ignore = 'all'
numpydoc_xref_aliases = {**{word: word for word in DEFAULT_LINKS},  # others' pages are not looked up
                         **{name: f'polymap_ros.{name}' for name in polymap_ros.__all__}}

html_theme = 'furo'
html_title = f'polymap_ros {release}'
html_static_path = ['_static']
html_css_files = ['tables.css']
html_show_sourcelink = False


def write_tables(app: Sphinx) -> None:
    """Make the reference of the sources, before any page is read."""
    sys.path.insert(0, str(app.srcdir))
    from generated import write

    write(Path(app.srcdir, '_generated'))


def setup(app: Sphinx) -> None:
    """Take part in the build."""
    app.connect('builder-inited', write_tables)
