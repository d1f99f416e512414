"""index.html: a line for each of many recordings."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple
from urllib.parse import quote

from polymap_ros import __version__
from polymap_ros.results.report.numbers import fixed
from polymap_ros.results.report.outline import thumbnail_svg
from polymap_ros.results.report.page import Measured, area
from polymap_ros.results.report.templating import rendered

_COLUMNS = ('Recording', 'Outline', 'Status', 'Edges', 'Area', 'Pings used', 'Warnings', 'Remark')


class Row(NamedTuple):
    """A recording and what came of it.

    Parameters
    ----------
    name : str
        Also the name of its folder, beside the index.
    status : str
        Of the answer, or ``failed``.
    document : mapping or None
        The content of its polygon.json; None where it is not there.
    remark : str
        What went wrong, or why no polygon closes.
    has_page : bool
        Whether its folder has a report.html.
    """

    name: str
    status: str
    document: Mapping[str, Any] | None
    remark: str = ''
    has_page: bool = True


def index_html(rows: Sequence[Row]) -> bytes:
    """Return the page over many recordings."""
    documents = [row.document for row in rows if row.document is not None]
    closed = [document for document in documents if document['status'] == 'closed']
    done, failed = (sum(row.status == status for row in rows) for status in ('closed', 'failed'))
    return rendered('index.html', {
        'wide_table': True, 'number': f'{len(rows)} recording{"" if len(rows) == 1 else "s"}',
        'rows': [_shown(k, row) for k, row in enumerate(rows)], 'columns': _COLUMNS, 'version': __version__,
        'totals': f'{done} done, {len(rows) - done - failed} open, {failed} failed.',
        'sums': [sum(len(document['edges']) for document in closed),
                 f'{sum(document["area"] for document in closed):.6g} m²',
                 _pings([document['pings'] for document in documents]),
                 sum(len(document['warnings']) for document in documents)],
    })


def _shown(k: int, row: Row) -> dict[str, Any]:
    """What the template asks for."""
    document = row.document
    return {
        'name': row.name, 'href': f'./{quote(row.name, safe="", errors="surrogateescape")}/report.html'
        if row.has_page and document is not None else '',
        'status': row.status, 'remark': row.remark,
        'svg': _thumbnail(k, row.name, document) if document else '', 'cells': _cells(document),
    }


def _cells(document: Mapping[str, Any] | None) -> list[Measured]:
    """Edges, area, pings and warnings."""
    if document is None:
        return [Measured(fixed(None, 0))] * 4
    return [
        Measured(str(len(document['edges']) or fixed(None, 0))),
        Measured(fixed(None, 0)) if document['area'] is None else area(document),
        Measured(_pings([document['pings']])), Measured(str(len(document['warnings'])))]


def _pings(counts: Sequence[Mapping[str, Any]]) -> str:
    return f'{sum(each["used"] for each in counts)} of {sum(each["received"] for each in counts)}'


def _thumbnail(k: int, name: str, document: Mapping[str, Any]) -> str:
    shapes = [document] if document['status'] == 'closed' else document['alternatives']
    return thumbnail_svg(f'thumbnail-{k}', f'Outline of {name}', shapes) if shapes else ''
