"""The outline drawn to scale, with lengths, inner angles and deviations."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import Pose
from polymap_ros.results.report.heard import Survey
from polymap_ros.results.report.labels import Box, Place, best
from polymap_ros.results.report.numbers import digits_for, fixed, spread
from polymap_ros.results.report.svg import add, drawing, markup, path_data

Shape = Mapping[str, Any]
"""A polygon of polygon.json: its `vertices` and `edges`, `holes` and `inner_walls`; or one of the holes."""

LETTERS = 'ABCDEFGHIJKLMNOPQRSTUVWXYZ'
"""Names of candidates."""
STYLES = 3
"""Ways in which candidates are drawn."""

_WIDTH, _INNER_WIDTH, _INNER_HEIGHT, _MARGIN = 640.0, 390.0, 390.0, 32.0
_DOTS = 400
"""With more pings than this the path is a line without dots."""
_ASIDE = ((14.0, (0.0,)), (26.0, (0.0,)), (20.0, (-40.0, 40.0)), (-9.0, (0.0, -40.0, 40.0)), (40.0, (0.0, -30.0, 30.0)),
          (-24.0, (0.0,)), (60.0, (0.0, -20.0, 20.0)))
"""How far from its corner an angle may stand, outside where that is negative, and by how many degrees aside."""
_CLOSE = 0.7
"""Points of the path nearer than this are drawn as one."""
_THIN = 0.02
"""A drawing is at least this share of its larger side wide."""
_SMALLEST_M = 0.01
"""What a drawing shows at least: a robot that stood still has no size of its own."""


def outline_svg(name: str, shape: Shape, heard: Survey, prefix: str = '', style: int = 0) -> str:
    """Draw one polygon with its sizes.

    Parameters
    ----------
    name : str
        Identifies the picture within its page.
    shape : mapping
        Of polygon.json.
    heard : Survey
        Path, start and truth, drawn beneath.
    prefix : str
        Of the edges' numbers, a candidate's letter.
    style : int
        How it is drawn, below `STYLES`.
    """
    rings, walls = _rings(shape), shape.get('inner_walls', ())
    canvas = _Canvas(name, rings, heard, f'Outline {prefix}'.strip(), _in_words(shape, prefix))
    canvas.rings(rings, f'outline style{style % STYLES}')
    for wall in walls:
        canvas.stretch(_ends(wall), 'inner-wall')
    canvas.surroundings(heard)
    canvas.sizes(rings[0], shape['edges'], prefix)
    for k, hole in enumerate(rings[1:]):
        canvas.name_hole(hole, f'H{k}')
    for k, wall in enumerate(walls):
        canvas.name_stretch(_ends(wall), f'W{k}')
    return canvas.finished(heard)


def hole_svg(name: str, hole: Shape, heard: Survey, prefix: str) -> str:
    """Draw one hole by itself with its sizes, of which the angles stand in the material around it."""
    corners = _points(hole['vertices'])
    alone = dataclasses.replace(heard, path=np.zeros((0, 2)), start=None, truth=None)
    canvas = _Canvas(name, [corners], alone, f'Hole {prefix}'.rstrip('.'), _in_words(hole, prefix, 'Hole', 'clockwise'))
    canvas.rings([corners], 'outline hole')
    canvas.sizes(corners, hole['edges'], prefix)
    return canvas.finished(alone)


def candidates_svg(name: str, shapes: Sequence[Shape], heard: Survey) -> str:
    """Draw polygons that all fit on top of each other, each with its letter at its first edge."""
    rings = [_points(shape['vertices']) for shape in shapes]
    canvas = _Canvas(name, rings, heard, 'All candidates', f'{len(rings)} outlines that fit the echoes, on top of each '
                     'other in different strokes; each is measured below.')
    for k, ring in enumerate(rings):
        canvas.rings([ring], f'outline style{k % STYLES}')
    canvas.surroundings(heard)
    for k, ring in enumerate(rings):
        canvas.letter(ring, LETTERS[k % len(LETTERS)], k)
    return canvas.finished(heard)


def walls_svg(name: str, walls: Sequence[Mapping[str, Any]], heard: Survey) -> str:
    """Draw the walls that are certain where no polygon closes; how far they reach is not known."""
    middle = heard.path.mean(axis=0) if len(heard.path) else np.zeros(2)
    feet = [_foot(wall, middle) for wall in walls]
    found = ', '.join(f'wall {i} at {np.linalg.norm(foot - middle):.3g} m from the middle of the path'
                      for i, foot in enumerate(feet))
    mirrors = [wall['mirror'] for wall in walls if wall.get('mirror')]
    images = [_foot(mirror, middle) for mirror in mirrors]
    canvas = _Canvas(name, [_points([*feet, *images])], heard, 'Path and walls',
                     found or 'The path; no wall is certain.')
    for kind, lines, places in (('mirror', mirrors, images), ('wall', walls, feet)):
        for line, place in zip(lines, places, strict=True):
            canvas.line(place, _normal(line), kind)
    canvas.surroundings(heard)
    for i, (wall, foot) in enumerate(zip(walls, feet, strict=True)):
        canvas.label([_along(canvas.place(foot), _turned(_normal(wall)), gap) for gap in (10.0, -10.0)], [f'wall {i}'])
    return canvas.finished(heard)


def thumbnail_svg(name: str, title: str, shapes: Sequence[Shape]) -> str:
    """Draw outlines as small as an icon."""
    points = np.vstack([_points(shape['vertices']) for shape in shapes])
    low, size = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), 1e-9)
    middle = low + 0.5 * np.ptp(points, axis=0)
    root = drawing(48.0, 48.0, name, title, 'Outline, drawn to fit.')
    for k, shape in enumerate(shapes):
        add(root, 'path', class_=f'outline style{k % STYLES}', d=''.join(
            path_data(24.0 + 42.0 / size * (ring - middle) * (1.0, -1.0), closed=True) for ring in _rings(shape)))
    return markup(root)


def _rings(shape: Shape) -> list[NDArray[np.float64]]:
    """Corners of the outline and of its holes; drawn together they leave the holes unfilled."""
    return [_points(ring['vertices']) for ring in (shape, *shape.get('holes', ()))]


def _ends(wall: Shape) -> NDArray[np.float64]:
    return _points([wall['start'], wall['end']])


def _in_words(shape: Shape, prefix: str, kind: str = 'Polygon', way: str = 'counter-clockwise') -> str:
    """The picture for those who do not see it."""
    edges = shape['edges']
    sides = '; '.join(f'edge {prefix}{i}: {fixed(edge["length"], 4)} m long, inner angle at its start '
                      f'{fixed(np.rad2deg(edge["angle"]), 1)} degrees' for i, edge in enumerate(edges))
    inside = [f'{what} {letter}{k}' for what, letter, found in (
        ('hole', 'H', shape.get('holes', ())), ('inner wall', 'W', shape.get('inner_walls', ())))
        for k in range(len(found))]
    told = f' Inside: {", ".join(inside)}.' if inside else ''
    return f'{kind} of {len(edges)} edges, {way}. {sides}.{told} The tables below have all numbers.'


class _Canvas:
    """A picture of some extent, to which lines and then labels are added."""

    def __init__(self, name: str, rings: Sequence[NDArray[np.float64]], heard: Survey, title: str, words: str) -> None:
        clouds = [*rings, heard.path, *([heard.truth] if heard.truth is not None else []), np.zeros((0, 2))]
        points = np.vstack(clouds)
        low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.ones(2))
        extent = np.maximum(high - low, max(_THIN * float(np.max(high - low)), _SMALLEST_M))
        self._middle = 0.5 * (low + high)
        self._scale = min(_INNER_WIDTH / extent[0], _INNER_HEIGHT / extent[1])
        self._height = float(extent[1] * self._scale) + 2.0 * _MARGIN
        self._root = drawing(_WIDTH, self._height, name, title, words)
        self._taken: list[Box] = []
        self._ink = [np.zeros((0, 2))]

    def place(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions [m] in units of the drawing; subtracting first keeps the millimetres of a far origin."""
        half = 0.5 * np.array([_WIDTH, self._height])
        return np.asarray(half + self._scale * (points - self._middle) * (1.0, -1.0), dtype=float)

    def rings(self, rings: Sequence[NDArray[np.float64]], kind: str) -> None:
        """A closed outline and its holes."""
        placed = [self.place(ring) for ring in rings]
        add(self._root, 'path', class_=kind, d=''.join(path_data(ring, closed=True) for ring in placed))
        self._ink += [_dense(ring, np.roll(ring, -1, axis=0)) for ring in placed]

    def stretch(self, ends: NDArray[np.float64], kind: str) -> None:
        """A line from one place to another."""
        placed = self.place(ends)
        add(self._root, 'path', class_=kind, d=path_data(placed))
        self._ink += [_dense(placed[:1], placed[1:])]

    def line(self, foot: NDArray[np.float64], normal: NDArray[np.float64], kind: str) -> None:
        """An endless line, as far as it is within the drawing."""
        ends = _clipped(self.place(foot), _turned(normal) * (1.0, -1.0), self._height)
        if ends is not None:
            add(self._root, 'path', class_=kind, d=path_data(ends))
            self._ink += [_dense(ends[:1], ends[1:])]

    def surroundings(self, heard: Survey) -> None:
        """Truth, path and start."""
        if heard.truth is not None:
            self.rings([heard.truth], 'truth')
        path = _thinned(self.place(heard.path))
        add(self._root, 'path', class_='path', d=path_data(path))
        self._ink.append(path)
        if len(heard.path) <= _DOTS:
            dots = add(self._root, 'g', class_='dots')
            for x, y in path:
                add(dots, 'circle', cx=x, cy=y, r=2.2)
        if heard.start is not None:
            self._start(heard.start)

    def _start(self, start: Pose) -> None:
        """A ring with an arrow to where the robot looked."""
        x, y = self.place(np.array([start.x, start.y]))
        along = np.array([math.cos(start.yaw), -math.sin(start.yaw)])
        tip, side = (x, y) + 30.0 * along, 5.0 * _turned(along)
        add(self._root, 'path', class_='arrow', d=path_data([(x, y) + 6.0 * along, tip - 8.0 * along]))
        add(self._root, 'path', class_='tip', d=path_data(
            [tip, tip - 10.0 * along + side, tip - 10.0 * along - side], closed=True))
        add(self._root, 'circle', class_='start', cx=x, cy=y, r=6.0)
        self._taken.append(Box(x - 8.0, y - 8.0, x + 8.0, y + 8.0))

    def sizes(self, corners: NDArray[np.float64], edges: Sequence[Mapping[str, Any]], prefix: str) -> None:
        """Lengths outside along the edges of a ring, inner angles in the corners: around a hole, which is clockwise."""
        placed = self.place(corners)
        ahead = _units(np.roll(placed, -1, axis=0) - placed)
        side = _side(placed)
        outward = np.column_stack((-ahead[:, 1], ahead[:, 0])) * side
        for i, edge in enumerate(edges):
            start, end = placed[i], placed[(i + 1) % len(placed)]
            spots = [Place(*(start + share * (end - start) + gap * outward[i]), *outward[i])
                     for gap in (9.0, 34.0, 60.0) for share in (0.5, 0.4, 0.6, 0.28, 0.72)]
            length = fixed(edge['length'], digits_for(edge['length_std'], 2, 5, figures=1))
            self.label(spots, [f'{length} m', *_second(spread(edge['length_std'], 1e3, 'mm'))], f'{prefix}{i}')
        inward = side * _units(-outward - np.roll(outward, 1, axis=0))
        for i, edge in enumerate(edges):
            spots = [Place(*(placed[i] + abs(gap) * way), *way) for gap, turns in _ASIDE for turn in turns
                     for way in [math.copysign(1.0, gap) * _rotated(inward[i], turn)]]
            angle_std = None if edge['angle_std'] is None else math.degrees(edge['angle_std'])
            angle = fixed(math.degrees(edge['angle']), digits_for(angle_std, 0, 2, figures=1))
            self.label(spots, [f'{angle}°', *_second(spread(angle_std, 1.0, '°'))])

    def letter(self, ring: NDArray[np.float64], letter: str, k: int) -> None:
        """A candidate's letter outside one of its edges, of each candidate another one."""
        placed = self.place(ring)
        ahead = _units(np.roll(placed, -1, axis=0) - placed)
        outward = np.column_stack((-ahead[:, 1], ahead[:, 0])) * _side(placed)
        middles = 0.5 * (placed + np.roll(placed, -1, axis=0)) + 9.0 * outward
        order = np.roll(np.arange(len(ring)), -k)
        self.label([Place(*middles[i], *outward[i]) for i in order], [''], letter, f' letter{k % STYLES}')

    def name_hole(self, ring: NDArray[np.float64], mark: str) -> None:
        """A hole's name in its middle, or beside it."""
        placed = self.place(ring)
        (x, y), half = placed.mean(axis=0), 0.5 * np.ptp(placed, axis=0) + 8.0
        self.label([Place(x, y, 0.0, 0.0), *(Place(x + half[0] * dx, y + half[1] * dy, dx, dy) for dx, dy in (
            (1.0, 0.0), (-1.0, 0.0), (0.0, -1.0), (0.0, 1.0)))], [''], mark)

    def name_stretch(self, ends: NDArray[np.float64], mark: str) -> None:
        """A name beside a line from one place to another."""
        ((along,),) = np.diff(ends, axis=0)[None] / max(float(np.hypot(*np.diff(ends, axis=0)[0])), 1e-12)
        self.label([_along(self.place(ends[0] + share * (ends[1] - ends[0])), along, gap)
                    for share in (0.5, 0.3, 0.7, 0.15, 0.85) for gap in (10.0, -10.0)], [''], mark)

    def label(self, spots: Sequence[Place], lines: Sequence[str], mark: str = '', kind: str = '') -> None:
        """Text of some lines at the best of some places, with a number in bold before it."""
        text = [f'{mark}  {lines[0]}'.rstrip() if mark else lines[0], *lines[1:]]
        spot, box = best(spots, text, self._taken, np.vstack(self._ink))
        self._taken.append(box)
        node = add(self._root, 'text', class_=f'label{kind}', text_anchor=spot.anchor, x=spot.x, y=spot.y)
        for k, line in enumerate(text):
            dy = spot.baseline_em(len(text)) if k == 0 else 1.15
            row = add(node, 'tspan', '' if mark and k == 0 else line, x=spot.x, dy=f'{dy:.2f}em')
            if mark and k == 0:
                add(row, 'tspan', mark, class_='mark').tail = f'\N{NO-BREAK SPACE} {lines[0]}'.rstrip()

    def finished(self, heard: Survey) -> str:
        """The markup, with a scale bar, of a size that holds all labels."""
        boxes = [*self._taken, Box(0.0, 0.0, _WIDTH, self._height)]
        left, top = min(box.left for box in boxes), min(box.top for box in boxes)
        right, bottom = max(box.right for box in boxes), max(box.bottom for box in boxes) + 34.0
        metres = _round_length(0.3 * _INNER_WIDTH / self._scale)
        x, y, width = left + 24.0, bottom - 14.0, metres * self._scale
        add(self._root, 'path', class_='bar', d=f'M{x:.2f} {y - 6:.2f}v12m0 -6h{width:.2f}m0 -6v12')
        add(self._root, 'text', f'{metres:g} m', class_='label', x=x + width + 10.0, y=y, dy='0.35em')
        self._root.set('viewBox', f'{left:.0f} {top:.0f} {right - left:.0f} {bottom - top:.0f}')
        return markup(self._root)


def _points(rows: Any) -> NDArray[np.float64]:
    return np.asarray(rows, dtype=float).reshape(-1, 2)


def _second(text: str) -> list[str]:
    return [text] if text else []


def _normal(wall: Mapping[str, Any]) -> NDArray[np.float64]:
    return np.array([math.cos(wall['theta']), math.sin(wall['theta'])])


def _foot(wall: Mapping[str, Any], point: NDArray[np.float64]) -> NDArray[np.float64]:
    """The point of a wall's line that is nearest to a point."""
    return np.asarray(point + (wall['r'] - _normal(wall) @ point) * _normal(wall), dtype=float)


def _turned(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([-vector[1], vector[0]])


def _rotated(vector: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def _units(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors / np.maximum(np.hypot(*vectors.T), 1e-12)[:, None], dtype=float)


def _side(ring: NDArray[np.float64]) -> float:
    """+1 or -1, so that a quarter turn of the way around leads out of the ring."""
    onward = np.roll(ring, -1, axis=0)
    return -float(np.sign(np.sum(ring[:, 0] * onward[:, 1] - ring[:, 1] * onward[:, 0])) or 1.0)


def _along(point: NDArray[np.float64], direction: NDArray[np.float64], gap: float) -> Place:
    return Place(*(point + gap * _turned(direction * (1.0, -1.0))), *(np.sign(gap) * _turned(direction * (1.0, -1.0))))


def _dense(starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    shares = np.linspace(0.0, 1.0, 101)[:, None, None]
    return np.asarray((starts + shares * (ends - starts)).reshape(-1, 2), dtype=float)


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    kept = list(points[:1])
    for point in points[1:]:
        if np.hypot(*(point - kept[-1])) >= _CLOSE:
            kept.append(point)
    return _points(kept)


def _clipped(point: NDArray[np.float64], along: NDArray[np.float64], height: float) -> NDArray[np.float64] | None:
    """Both ends of a line within the drawing; None where it passes by."""
    low, high = -math.inf, math.inf
    for start, step, most in zip(point, along, (_WIDTH, height), strict=True):
        near, far = 0.04 * most, 0.96 * most
        if abs(step) < 1e-12:
            if not near <= start <= far:
                return None
            continue
        first, last = sorted(((near - start) / step, (far - start) / step))
        low, high = max(low, first), min(high, last)
    return np.array([point + low * along, point + high * along]) if low < high else None


def _round_length(metres: float) -> float:
    """The largest of 1, 2, 5, 10, ... that is not longer."""
    power = 10.0 ** math.floor(math.log10(metres))
    return max(digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= metres * (1.0 + 1e-9))
