"""index.html over the pages of many recordings."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polymap_ros.commands.replaying import Outcome
from polymap_ros.errors import OutputError, UsageError, in_words

if TYPE_CHECKING:
    from polymap_ros.results.report.index import Row

INDEX = 'index.html'
_MARK = b'<meta name="generator" content="polymap_ros">'
_MARKED_BYTES = 2000
"""From the start of a page, within which it says who made it."""


def refuse_foreign_index(folder: Path) -> None:
    """Raise `UsageError` where an index is there that is not of an earlier run."""
    path = folder / INDEX
    if (path.exists() or path.is_symlink()) and not _is_ours(path):
        raise UsageError(f'{path}: is not of an earlier run, and the index would take its place; move it away, or '
                         'choose another --output')


def clear_index(folder: Path) -> bool:
    """Remove the index of an earlier run, whose pages this one may take away, and return whether there was one.

    Where it cannot be removed, that is an `OutputError`.
    """
    path = folder / INDEX
    if not _is_ours(path):
        return False
    try:
        path.unlink()
    except OSError as error:
        raise OutputError(path, f'one of an earlier run cannot be removed: {in_words(error, folder)}') from error
    return True


def _is_ours(path: Path) -> bool:
    try:
        with path.open('rb') as file:
            return _MARK in file.read(_MARKED_BYTES)
    except OSError:
        return False


def write_index(
    folder: Path, outcomes: Sequence[tuple[str, Outcome]], earlier: Sequence[tuple[str, Mapping[str, str]]] = ()
) -> str:
    """Write index.html over recordings, and return what went wrong, or nothing.

    Parameters
    ----------
    folder : Path
        In which it is written.
    outcomes : sequence of tuple of str and Outcome
        How recordings ended in this run, by name.
    earlier : sequence of tuple of str and mapping
        Rows of summary.csv of earlier runs, by the names of their folders.
    """
    from polymap_ros.atomic import move_into_place, staging
    from polymap_ros.results.report.index import index_html

    path = folder / INDEX
    try:
        content = index_html([*(_row(name, outcome) for name, outcome in outcomes),
                              *(_earlier_row(name, folder / name, cells) for name, cells in earlier)])
        with staging(path) as stage:
            (stage / INDEX).write_bytes(content)
            move_into_place(stage / INDEX, path)
    except Exception as error:  # a fault of ours, too: the answers are there
        return f'{path}: not written: {in_words(error, folder)}'
    return ''


def _row(name: str, outcome: Outcome) -> 'Row':
    """A row of this run, without polygon.json where that was not written, is of an earlier run or another machine."""
    from polymap_ros.results.report.index import Row

    document = _document(outcome.folder)
    if document is not None:
        found = document['status'], document['area'], document['pings']['used']
        document = document if found == (outcome.answer, outcome.area_m2, outcome.pings_used) else None
    remark = _without_paths(name, outcome) or _doubt(document)
    return Row(name, outcome.answer or 'failed', document, remark, _has_page(outcome.folder))


def _earlier_row(name: str, folder: Path, cells: Mapping[str, str]) -> 'Row':
    from polymap_ros.results.report.index import Row

    document = None if cells['status'] == 'failed' else _document(folder)
    answer = {'done': 'closed', 'open': 'open'}.get(cells['status'], 'failed')
    return Row(name, document['status'] if document else answer, document, cells['error'] or _doubt(document),
               _has_page(folder))


def _doubt(document: Mapping[str, Any] | None) -> str:
    """Why an answer is none that closes."""
    if document is None or document['status'] == 'closed' or not document['warnings']:
        return ''
    return str(document['warnings'][0]['text'])


def _has_page(folder: Path) -> bool:
    from polymap_ros.results.folder import REPORT

    return (folder / REPORT).is_file()


def _document(folder: Path) -> Mapping[str, Any] | None:
    """The content of polygon.json."""
    from polymap_ros.results.folder import POLYGON

    try:
        document: Mapping[str, Any] = json.loads((folder / POLYGON).read_bytes())
    except (OSError, ValueError):
        return None
    return document


def _without_paths(name: str, outcome: Outcome) -> str:
    """What went wrong, with names in place of paths, so that the page may be passed on."""
    text = outcome.error
    for path in sorted({str(outcome.recording), str(outcome.folder)}, key=len, reverse=True):
        text = text.replace(path, name)
    return text
