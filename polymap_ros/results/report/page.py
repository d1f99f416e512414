"""report.html: one recording's answer, for people who look."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from polymap_ros.cautions import Caution
from polymap_ros.parameters import specifications
from polymap_ros.results.report.beam_picture import Marked, beam_map_svg
from polymap_ros.results.report.heard import Survey
from polymap_ros.results.report.numbers import digits_for, fixed, spread
from polymap_ros.results.report.outline import LETTERS, candidates_svg, hole_svg, outline_svg, walls_svg
from polymap_ros.results.report.templating import rendered

Document = Mapping[str, Any]
"""The content of polygon.json."""

_VERDICTS = {
    'closed': 'The walls close to one polygon.',
    'ambiguous': 'More than one polygon fits the echoes. Each candidate is drawn and measured below.',
    'open': 'No polygon closes. Below is what is certain, and what to do next.',
}


class Measured(NamedTuple):
    """A number and its deviation, as shown."""

    value: str
    spread: str = ''


class Fact(NamedTuple):
    """A line of the answer in short."""

    name: str
    value: str
    spread: str = ''


Cell: TypeAlias = str | int | Measured


class Table(NamedTuple):
    """Cells by row; the first of each row is its header."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    kind: str = ''


class Part(NamedTuple):
    """A polygon, or the walls, in detail."""

    heading: str
    svg: str
    tables: Sequence[Table]


def report_html(document: Document, cautions: Sequence[Caution], heard: Survey) -> bytes:
    """Return the page.

    Parameters
    ----------
    document : mapping
        The content of polygon.json, whose numbers are shown.
    cautions : sequence of Caution
        Its warnings.
    heard : Survey
        What is drawn beside them.
    """
    status, shapes = document['status'], _shapes(document)
    return rendered('report.html', {
        'wide_table': False,
        'name': document.get('recording') or 'Unnamed recording', 'status': status, 'verdict': _VERDICTS[status],
        'sections': [('answer', 'Answer'), ('warnings', 'Warnings'), ('walls', _heading(status)),
                     ('beam-map-heading', 'Beamforming map'), ('pings', 'Pings'), ('parameters', 'Parameters')],
        'facts': [*_facts(document, len(cautions))],
        'overview': _overview(document, shapes, heard), 'legend': _legend(document, heard), 'drawn': _drawn(document),
        'warnings': cautions, 'walls_heading': _heading(status), 'parts': [*_parts(document, shapes, heard)],
        'beam_map': beam_map_svg('beam-map', heard, _marked(document, shapes)) if heard.start else '',
        'beam_map_caption': (
            'How well a wall at each distance r and direction θ explains the echoes, eq. (4). Both are seen from the '
            'start: where the sensor was at the first ping, θ from its heading there. Frames mark the '
            f'{"walls" if status == "open" else "edges"} found.'),
        'pings': _pings(document['pings'], heard), 'parameters': _changed(document['parameters']),
        'version': document['software']['polymap_ros'],
    })


def _shapes(document: Document) -> list[tuple[str, Mapping[str, Any]]]:
    """The polygons of an answer, each with the letter that stands before its numbers."""
    if document['status'] == 'closed':
        return [('', document)]
    return [(LETTERS[k % len(LETTERS)], shape) for k, shape in enumerate(document['alternatives'])]


def _heading(status: str) -> str:
    return {'closed': 'Edges and corners', 'ambiguous': 'Candidates', 'open': 'Certain walls'}[status]


def _facts(document: Document, warnings: int) -> Iterator[Fact]:
    """The answer in short."""
    if document['status'] == 'closed':
        extent = np.ptp(np.asarray(document['vertices']), axis=0)
        holes, walls = document.get('holes', ()), document.get('inner_walls', ())
        yield Fact('Edges', str(len(document['edges'])))
        yield from (Fact(name, str(len(found))) for name, found in (('Holes', holes), ('Inner walls', walls)) if found)
        yield Fact('Area without the holes' if holes else 'Area', *area(document))
        yield Fact('Extent', f'{extent[0]:.4g} × {extent[1]:.4g} m')
        yield Fact('Least likelihood', fixed(min(edge['likelihood'] for edge in _edges_of(document)), 3))
    elif document['status'] == 'ambiguous':
        yield Fact('Candidates', str(len(document['alternatives'])))
    else:
        yield Fact('Certain walls', str(len(document['walls'])))
    for name in ('floor', 'ceiling'):
        if f'{name}_m' in document.get('height', {}):
            yield Fact(f'{name.capitalize()}, from the device', f'{document["height"][f"{name}_m"]:.3f} m')
    if document['iou_free_area'] is not None:
        yield Fact('Overlap with the free area', fixed(document['iou_free_area'], 4))
    counts = document['pings']
    yield Fact('Pings used', f'{counts["used"]} of {counts["received"]}')
    yield Fact('Warnings', str(warnings))
    yield Fact('Method', document['method'])
    yield Fact('Frame', document['frame_id'] or 'none')


def area(shape: Mapping[str, Any]) -> Measured:
    """Return the area of a polygon as shown."""
    area_std, small = shape['area_std'], (shape['area_std'] or 0.0) < 0.01
    return Measured(f'{fixed(shape["area"], digits_for(area_std, 1, 5))} m²',
                    spread(area_std, 1e4 if small else 1.0, 'cm²' if small else 'm²'))


def _overview(document: Document, shapes: Sequence[tuple[str, Mapping[str, Any]]], heard: Survey) -> str:
    if document['status'] == 'closed':
        return outline_svg('outline', document, heard)
    if shapes:
        return candidates_svg('outline', [shape for _, shape in shapes], heard)
    return walls_svg('outline', document['walls'], heard) if document['walls'] or len(heard.path) else ''


def _legend(document: Document, heard: Survey) -> list[tuple[str, str]]:
    kinds = {
        'closed': [('outline style0', 'outline and holes' if document.get('holes') else 'outline'),
                   *([('inner-wall', 'inner wall')] if document.get('inner_walls') else [])],
        'ambiguous': [(f'outline style{k % 3}', f'candidate {LETTERS[k % len(LETTERS)]}')
                      for k in range(len(document['alternatives']))],
        'open': [('wall', 'certain wall')] if document['walls'] else [],
    }[document['status']]
    mirrored = any(wall.get('mirror') for wall in document['walls'])
    return [*kinds, *([('mirror', 'mirror image of a wall')] if mirrored else []),
            *([('truth', 'truth')] if heard.truth is not None else []),
            *([('path', 'path and pings'), ('start', 'start and heading')] if heard.start else [])]


def _drawn(document: Document) -> str:
    """What the drawing needs to be said of it."""
    where = f'the plane of the first pose in {document["frame_id"]}' if 'plane' in document else document['frame_id']
    sizes = ' Lengths stand outside the edges, inner angles at the corners.' if document['status'] == 'closed' else ''
    afar = max((abs(edge['r']) for edge in _edges_of(document)), default=0.0)
    near = max((edge.get('length') or 0.0 for edge in _edges_of(document)), default=0.0)
    about = f' r and its deviation are about the frame’s origin, {afar:.0f} m away.' if 0.0 < 10.0 * near < afar else ''
    return (f'To scale, x of {where or "the odometry’s frame"} to the right and y up.{sizes} ± is one standard '
            f'deviation.{about}')


def _edges_of(document: Document) -> list[Mapping[str, Any]]:
    shapes = [document, *document.get('holes', []), *document.get('alternatives', [])]
    return [*(edge for shape in shapes for edge in shape.get('edges') or []), *document.get('inner_walls', [])]


def _parts(
    document: Document, shapes: Sequence[tuple[str, Mapping[str, Any]]], heard: Survey
) -> Iterator[Part]:
    for k, (letter, shape) in enumerate(shapes):
        svg = outline_svg(f'candidate-{k}', shape, heard, letter, k) if letter else ''
        heading = f'Candidate {letter}: {len(shape["edges"])} edges, {" ".join(area(shape))}'.rstrip()
        yield Part(heading if letter else '', svg,
                   [_edges(shape['edges'], letter), _corners(shape, letter)])
    for k, hole in enumerate(document.get('holes', ())):
        yield Part(f'Hole H{k}: {len(hole["edges"])} edges, {" ".join(area(hole))}'.rstrip(),
                   hole_svg(f'hole-{k}', hole, heard, f'H{k}.'),
                   [_edges(hole['edges'], f'H{k}.', 'clockwise'),
                    _corners(hole, f'H{k}.', '; angles are within the material')])
    if walls := document.get('inner_walls'):
        yield Part('Inner walls', '', _inner_walls(walls))
    if document['status'] == 'open' and document['walls']:
        yield Part('', '', [_walls(document['walls'])])


def _edges(edges: Sequence[Mapping[str, Any]], letter: str, way: str = 'counter-clockwise') -> Table:
    rows = [[f'{letter}{i}', Measured(f'{fixed(edge["length"], 5)} m', spread(edge['length_std'], 1e3, 'mm')),
             *_line(edge)] for i, edge in enumerate(edges)]
    return Table(f'Edges, {way}; each lies on the line x cos θ + y sin θ = r',
                 ('Edge', 'Length', 'r', 'θ', 'Likelihood', 'Pings'), rows)


def _walls(walls: Sequence[Mapping[str, Any]]) -> Table:
    mirrored = any(wall.get('mirror') for wall in walls)
    columns = ('Wall', 'r', 'θ', 'Likelihood', 'Pings', *(['Or its mirror image'] if mirrored else []))
    rows = [[str(i), *_line(wall), *([_mirror(wall.get('mirror'))] if mirrored else [])]
            for i, wall in enumerate(walls)]
    return Table('Walls, each on the line x cos θ + y sin θ = r; how far they reach is not known', columns, rows)


def _inner_walls(walls: Sequence[Mapping[str, Any]]) -> list[Table]:
    """What they do to an echo, and their lines."""
    ends = [[f'W{i}', *(f'{fixed(value, 3)} m' for value in (*wall['start'], *wall['end'])),
             fixed(wall['reflection'], 3), fixed(wall['transmission'], 3)] for i, wall in enumerate(walls)]
    return [Table('Where they are heard to start and to end, known less well than the lines, and what they reflect and '
                  'let through of the amplitude',
                  ('Wall', 'From x', 'From y', 'To x', 'To y', 'Reflects', 'Lets through'), ends),
            Table('Lines, x cos θ + y sin θ = r', ('Wall', 'r', 'θ', 'Likelihood', 'Pings'),
                  [[f'W{i}', *_line(wall)] for i, wall in enumerate(walls)])]


def _mirror(image: Mapping[str, Any] | None) -> str:
    if not image:
        return fixed(None, 0)
    return (f'r {fixed(image["r"], 5)} m, θ {fixed(math.degrees(image["theta"]), 3)}°, '
            f'likelihood {fixed(image["likelihood"], 3)}')


def _line(edge: Mapping[str, Any]) -> list[Cell]:
    theta_std = None if edge['theta_std'] is None else math.degrees(edge['theta_std'])
    return [Measured(f'{fixed(edge["r"], 5)} m', spread(edge['r_std'], 1e3, 'mm')),
            Measured(f'{fixed(math.degrees(edge["theta"]), 3)}°', spread(theta_std, 1.0, '°')),
            fixed(edge['likelihood'], 3), edge['pings']]


def _corners(shape: Mapping[str, Any], letter: str, more: str = '') -> Table:
    rows = []
    for i, ((x, y), edge) in enumerate(zip(shape['vertices'], shape['edges'], strict=True)):
        angle_std = None if edge['angle_std'] is None else math.degrees(edge['angle_std'])
        angle = Measured(f'{fixed(math.degrees(edge["angle"]), 3)}°', spread(angle_std, 1.0, '°'))
        rows.append((f'{letter}{i}', f'{fixed(x, 5)} m', f'{fixed(y, 5)} m', angle))
    return Table(f'Corners; each edge begins at the corner of its number{more}',
                 ('Corner', 'x', 'y', 'Inner angle'), rows)


def _marked(document: Document, shapes: Sequence[tuple[str, Mapping[str, Any]]]) -> list[Marked]:
    lines = [(f'{letter}{i}', edge, k) for k, (letter, shape) in enumerate(shapes)
             for i, edge in enumerate(shape['edges'])]
    lines += [(str(i), wall, 0) for i, wall in enumerate(document['walls'])] if document['status'] == 'open' else []
    lines += [(f'H{k}.{i}', edge, 0) for k, hole in enumerate(document.get('holes', ()))
              for i, edge in enumerate(hole['edges'])]
    inner = [Marked(f'W{k}', wall['r'], wall['theta'], both_sides=True)
             for k, wall in enumerate(document.get('inner_walls', ()))]
    return [*(Marked(name, line['r'], line['theta'], style) for name, line, style in lines), *inner]


def _pings(counts: Mapping[str, Any], heard: Survey) -> Table:
    """What became of every ping; those dropped by reason, the most frequent first."""
    dropped = sorted(counts['dropped'].items(), key=lambda each: (-each[1], each[0]))
    waiting = counts['received'] - counts['used'] - sum(counts['dropped'].values())
    rows = [('used', counts['used'], ''),
            *((f'dropped: {reason}', number, heard.drop_texts.get(reason, '')) for reason, number in dropped if number),
            *([('waiting for odometry', waiting, '')] if waiting else []), ('received', counts['received'], '')]
    return Table('What became of the pings', ('Pings', 'Number', 'The last of them'), rows, 'remarks')


def _changed(parameters: Mapping[str, Any]) -> Table:
    rows = [(spec.name, _setting(parameters[spec.name], spec.unit), _setting(spec.default, spec.unit), spec.text)
            for spec in specifications() if spec.name in parameters and parameters[spec.name] != spec.default]
    return Table('Parameters that differ from their defaults', ('Parameter', 'Value', 'Default', 'What it is'), rows,
                 'wide')


def _setting(value: Any, unit: str) -> str:
    text = str(value).lower() if isinstance(value, bool) else repr(value) if value == '' else str(value)
    return f'{text} {unit}'.strip() if not isinstance(value, (bool, str)) else text
