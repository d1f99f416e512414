"""The beamforming map as a picture with axes: a PNG within an SVG."""

import base64
import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import Pose
from polymap_ros.results.report.heard import Survey
from polymap_ros.results.report.labels import Box, Place, best
from polymap_ros.results.report.outline import STYLES
from polymap_ros.results.report.svg import Node, add, drawing, markup
from polymap_ros.solvers.estimate import Edge

_COLOURS = ('440154', '472c7a', '3b518b', '2c718e', '21908d', '27ad81', '5cc863', 'aadc32', 'fde725')
"""Nine points of the colour map viridis, which keeps its order in grey and for the colour-blind."""
_MOST = 640
"""Rows and columns of the picture at most; of those that share one, the loudest is shown."""
_HEADROOM = 2.5
"""The map is drawn up to so many times the range of the farthest edge: beyond is clutter of higher orders."""
_WIDTH, _LEFT, _TOP, _RIGHT, _PLOT_HEIGHT, _HEIGHT = 640.0, 84.0, 44.0, 616.0, 400.0, 508.0
_HALF_DEG, _HALF_SHARE = 8.0, 0.025
"""Half the size of the marks, in degrees and as a share of the range."""


class Marked(NamedTuple):
    """An edge in the frame of the answer, and what it is called; an inner wall is seen from both sides."""

    name: str
    r: float
    theta: float
    style: int = 0
    both_sides: bool = False


def beam_map_svg(name: str, heard: Survey, edges: Sequence[Marked]) -> str:
    """Draw the map, theta upwards and r to the right, with a frame about each edge.

    Parameters
    ----------
    name : str
        Identifies the picture within its page.
    heard : Survey
        With the map.
    edges : sequence of Marked
        In the frame of the answer.
    """
    back = (heard.start or Pose(0.0, 0.0)).inverse()
    local = [(mark, _facing(Edge(mark.r, mark.theta, 1.0).moved(back), mark.both_sides)) for mark in edges]
    end = len(heard.r_m)
    if local:
        end = min(end, int(np.searchsorted(heard.r_m, _HEADROOM * max(edge.r for _, edge in local))) + 1)
    axes = _Axes.of(heard, max(end, 2))
    words = '; '.join(f'{mark.name} at {edge.r:.3f} m and {math.degrees(edge.theta) % 360.0:.1f} degrees'
                      for mark, edge in local)
    root = drawing(_WIDTH, _HEIGHT, name, 'Beamforming map',
                   f'Likelihood of a wall by its distance r and its direction theta. Marked: {words or "nothing"}.')
    picture = png(_reduced(heard.likelihood[:, :max(end, 2)]))
    add(root, 'image', x=_LEFT, y=_TOP, width=_RIGHT - _LEFT, height=_PLOT_HEIGHT, preserveAspectRatio='none',
        href=f'data:image/png;base64,{base64.b64encode(picture).decode()}')
    _draw_axes(root, axes)
    _draw_colours(root)
    frames = [(mark, box) for mark, edge in local for box in _frames(axes, edge)]
    for mark, box in frames:
        for kind in ('mark-back', f'mark-front style{mark.style % STYLES}'):
            add(root, 'rect', class_=kind, x=box.left, y=box.top, width=box.right - box.left,
                height=box.bottom - box.top)
    _name_frames(root, frames)
    return markup(root)


def _facing(edge: Edge, both_sides: bool) -> Edge:
    """An edge by the side that is seen from the start."""
    return edge.turned() if both_sides and edge.r < 0.0 else edge


def png(shares: NDArray[np.float32]) -> bytes:
    """Return a PNG of values from 0 to 1, the first row at the bottom."""
    levels = np.clip(np.nan_to_num(shares[::-1]) * 255.0 + 0.5, 0.0, 255.0).astype(np.uint8)
    rows = np.column_stack((np.zeros(len(levels), np.uint8), levels))  # each after its filter, which is none
    chunks = (
        (b'IHDR', struct.pack('>IIBBBBB', levels.shape[1], levels.shape[0], 8, 3, 0, 0, 0)), (b'PLTE', _palette()),
        (b'IDAT', zlib.compress(rows.tobytes(), 9)), (b'IEND', b''))
    return b'\x89PNG\r\n\x1a\n' + b''.join(
        struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))
        for kind, data in chunks)


def _palette() -> bytes:
    points = np.array([list(bytes.fromhex(colour)) for colour in _COLOURS], dtype=float)
    places = np.linspace(0.0, 1.0, len(points))
    channels = [np.interp(np.linspace(0.0, 1.0, 256), places, channel) for channel in points.T]
    return np.column_stack(channels).round().astype(np.uint8).tobytes()


def _reduced(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The loudest of each block of rows and columns, so that no narrow peak is lost."""
    for axis in (0, 1):
        n = values.shape[axis]
        if n > _MOST:
            starts = np.unique(np.linspace(0, n, _MOST, endpoint=False).astype(int))
            values = np.maximum.reduceat(values, starts, axis=axis)
    return values


class _Axes(NamedTuple):
    """Ends of both axes, at the outer borders of the cells."""

    r_low: float
    r_high: float
    low_deg: float
    high_deg: float

    @classmethod
    def of(cls, heard: Survey, columns: int) -> '_Axes':
        theta_deg, r_m = np.rad2deg(heard.theta_rad), heard.r_m[:columns]
        half_deg = 0.5 * float(theta_deg[1] - theta_deg[0]) if len(theta_deg) > 1 else 0.5
        half_m = 0.5 * float(r_m[1] - r_m[0])
        return cls(float(r_m[0]) - half_m, float(r_m[-1]) + half_m,
                   float(theta_deg[0]) - half_deg, float(theta_deg[-1]) + half_deg)

    def x(self, r_m: float) -> float:
        return _LEFT + (_RIGHT - _LEFT) * (r_m - self.r_low) / (self.r_high - self.r_low)

    def y(self, theta_deg: float) -> float:
        return _TOP + _PLOT_HEIGHT * (self.high_deg - theta_deg) / (self.high_deg - self.low_deg)


def _draw_axes(root: Node, axes: _Axes) -> None:
    bottom = _TOP + _PLOT_HEIGHT
    add(root, 'rect', class_='frame', x=_LEFT, y=_TOP, width=_RIGHT - _LEFT, height=_PLOT_HEIGHT)
    for r_m in _ticks(max(axes.r_low, 0.0), axes.r_high, 5):
        x = axes.x(r_m)
        add(root, 'path', class_='tick', d=f'M{x:.2f} {bottom:.2f}v6')
        add(root, 'text', f'{r_m:g}', class_='label', text_anchor='middle', x=x, y=bottom + 8.0, dy='0.9em')
    span = axes.high_deg - axes.low_deg
    angles = np.arange(-720.0, 721.0, 45.0) if span > 180.0 else _ticks(axes.low_deg, axes.high_deg, 6)
    for degrees in angles:
        if axes.low_deg <= degrees <= axes.high_deg:
            y = axes.y(degrees)
            add(root, 'path', class_='tick', d=f'M{_LEFT:.2f} {y:.2f}h-6')
            add(root, 'text', f'{degrees:g}°', class_='label', text_anchor='end', x=_LEFT - 10.0, y=y, dy='0.35em')
    add(root, 'text', 'r [m]', class_='label', text_anchor='middle', x=0.5 * (_LEFT + _RIGHT), y=_HEIGHT - 14.0)
    add(root, 'text', 'θ', class_='label', text_anchor='middle', x=18.0, y=_TOP + 0.5 * _PLOT_HEIGHT)


def _draw_colours(root: Node) -> None:
    """The scale from nothing to the maximum."""
    gradient = add(add(root, 'defs'), 'linearGradient', id='beam-colours')
    for k, colour in enumerate(_COLOURS):
        add(gradient, 'stop', offset=f'{k / (len(_COLOURS) - 1):.3f}', stop_color=f'#{colour}')
    left, width = _RIGHT - 200.0, 160.0
    add(root, 'rect', x=left, y=14.0, width=width, height=14.0, fill='url(#beam-colours)')
    add(root, 'text', 'L / max   0', class_='label', text_anchor='end', x=left - 8.0, y=21.0, dy='0.35em')
    add(root, 'text', '1', class_='label', x=left + width + 8.0, y=21.0, dy='0.35em')


def _frames(axes: _Axes, edge: Edge) -> Iterator[Box]:
    """Frames about an edge, one for each turn at which the angle axis has it."""
    half_m = _HALF_SHARE * (axes.r_high - axes.r_low)
    half_deg = min(_HALF_DEG, 0.05 * (axes.high_deg - axes.low_deg))
    for degrees in math.degrees(edge.theta) + 360.0 * np.arange(-2, 3):
        if axes.low_deg <= degrees <= axes.high_deg and axes.r_low <= edge.r <= axes.r_high:
            yield Box(axes.x(edge.r - half_m), axes.y(degrees + half_deg),
                      axes.x(edge.r + half_m), axes.y(degrees - half_deg))


def _name_frames(root: Node, frames: Sequence[tuple[Marked, Box]]) -> None:
    """Names beside the frames, on the map and not on each other."""
    taken, nothing = [box for _, box in frames], np.zeros((0, 2))
    taken += [Box(-_WIDTH, -_HEIGHT, _LEFT, 2.0 * _HEIGHT), Box(_RIGHT, -_HEIGHT, 2.0 * _WIDTH, 2.0 * _HEIGHT),
              Box(_LEFT, -_HEIGHT, _RIGHT, _TOP), Box(_LEFT, _TOP + _PLOT_HEIGHT, _RIGHT, 2.0 * _HEIGHT)]
    for mark, box in frames:
        x, y = 0.5 * (box.left + box.right), 0.5 * (box.top + box.bottom)
        spots = [Place(box.right + 6.0, y, 1.0, 0.0), Place(box.left - 6.0, y, -1.0, 0.0),
                 Place(x, box.top - 4.0, 0.0, -1.0), Place(x, box.bottom + 4.0, 0.0, 1.0)]
        spot, covered = best(spots, [mark.name], taken, nothing)
        taken.append(covered)
        add(root, 'text', mark.name, class_='on-map', text_anchor=spot.anchor, x=spot.x, y=spot.y,
            dy=f'{spot.baseline_em(1):.2f}em')


def _ticks(low: float, high: float, count: int) -> Iterator[float]:
    """Round numbers from low to high, about so many."""
    step = (high - low) / count
    power = 10.0 ** math.floor(math.log10(step))
    step = min((digit * power for digit in (1.0, 2.0, 5.0, 10.0)), key=lambda each: abs(each - step))
    first = math.ceil(low / step - 1e-9)
    yield from (round(k * step, 12) for k in range(first, math.floor(high / step + 1e-9) + 1))
