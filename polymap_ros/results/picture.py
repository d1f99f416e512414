"""polygon.png: the mapped room and the beamforming map side by side, as in Fig. 2 of the paper."""

import importlib
import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import UsageError, in_words
from polymap_ros.geometry.plane import XY
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.solvers.estimate import Edge, Estimate

_TRUTH = {'color': '#d62728', 'linestyle': (0, (5, 3)), 'linewidth': 1.8}
_EDGE = {'color': '#2ca02c', 'linewidth': 2.2}
_CANDIDATES: tuple[dict[str, Any], ...] = (
    {'color': '#2ca02c', 'linewidth': 2.2}, {'color': '#ff7f0e', 'linewidth': 1.8, 'linestyle': (0, (1, 1))},
    {'color': '#9467bd', 'linewidth': 1.8, 'linestyle': (0, (4, 1, 1, 1))},
)
_INNER = {'color': '#ff7f0e', 'linewidth': 2.2}
_PATH = {'color': 'black', 'linewidth': 0.7, 'marker': 'o', 'markersize': 2.4}
_OTHERS: dict[str, dict[str, Any]] = {
    'reported path': {'color': '0.6', 'linewidth': 1.0}, 'true path': {'color': '#d62728', 'linewidth': 0.8}}
_ARROW = {'arrowstyle': '-|>', 'color': '#1f77b4', 'linewidth': 1.5, 'shrinkA': 0, 'shrinkB': 0}
_RECTANGLE_M, _RECTANGLE_DEG = 0.05, 14.0
"""Size of the red rectangles, as a share of the drawn range and in degrees."""
_HEADROOM = 2.5
"""The map is drawn up to so many times the range of the farthest edge: beyond is clutter of higher orders."""


def require_matplotlib() -> None:
    """Raise `UsageError` where pictures cannot be drawn."""
    try:
        importlib.import_module('matplotlib.figure')
    except ModuleNotFoundError:
        raise UsageError("a picture needs matplotlib: pip install 'polymap_ros[plot]'") from None
    except Exception as error:  # a configuration that it refuses, such as MPLBACKEND
        raise UsageError(f'a picture needs matplotlib, which cannot be started: {in_words(error)}') from error


def picture_png(
    mapper: PolygonMapper, estimate: Estimate, truth: NDArray[np.float64] | None = None,
    true_path: tuple[NDArray[np.int64], NDArray[np.float64]] | None = None,
) -> bytes:
    """Draw the answer.

    Left, in the odometry's frame: the truth dashed red where it is known, the estimated edges green with their numbers,
    holes green and inner walls orange with theirs, H0, H1, ... and W0, W1, ..., the sensor's path and the pings black,
    and the axes of the start frame O. Where poses were estimated, the reported path is grey, and the true one, where it
    is known, thin red. Right, in the start frame: the beamforming map L / max L of eq. (4), with a red rectangle at
    each retrieved edge.

    Parameters
    ----------
    mapper : PolygonMapper
        Holds the map and the path.
    estimate : Estimate
        In the odometry's frame.
    truth : ndarray, shape (n, 2), optional
        Corners of the true polygon [m].
    true_path : tuple of ndarray, optional
        Stamps and true poses of the robot's base.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.0), layout='constrained')
    FigureCanvasAgg(figure)
    room, image = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    start = mapper.start_pose or Pose(0.0, 0.0)
    frame = (mapper.plane or XY).named(mapper.map_frame or 'the odometry frame')
    others = _other_paths(mapper, estimate, start, true_path)
    _draw_room(room, frame, estimate, start, start.apply(mapper.surroundings.positions), truth, others)
    _draw_beam_map(figure, image, mapper, estimate.moved(start.inverse()))
    figure.suptitle(_title(estimate, mapper.places.count))
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', dpi=110)
    return buffer.getvalue()


def _title(estimate: Estimate, pings: int) -> str:
    answer = {
        'closed': estimate.shape_in_words,
        'ambiguous': f'{len(estimate.alternatives)} polygons fit',
        'open': 'no polygon closes',
    }[estimate.status]
    return f'{estimate.status}: {answer} (method {estimate.method}, pings: {pings})'


def _draw_room(
    axes: Any, frame: str, estimate: Estimate, start: Pose, path: NDArray[np.float64],
    truth: NDArray[np.float64] | None, others: dict[str, NDArray[np.float64]],
) -> None:
    for name, other in others.items():
        axes.plot(*other.T, **_OTHERS[name], label=name, zorder=3)
    if truth is not None:
        axes.plot(*_ring(truth).T, **_TRUTH, label='truth', zorder=3)
    for ring in (estimate.polygon, *estimate.holes) if estimate.polygon else ():
        axes.plot(*_ring(ring.vertices).T, **_EDGE, label='estimated edges', zorder=2)
    for wall in estimate.inner_walls:
        axes.plot(*wall.ends.T, **_INNER, label='inner walls', zorder=2)
    for k, candidate in enumerate(estimate.alternatives):
        style = _CANDIDATES[k % len(_CANDIDATES)]
        axes.plot(*_ring(candidate.vertices).T, **style, label=f'candidate {k + 1}', zorder=2)
    axes.plot(*path.T, **_PATH, label='path and pings', zorder=4)
    _fit(axes, [path, *others.values(), *([truth] if truth is not None else []),
                *(candidate.vertices for candidate in (estimate.polygon, *estimate.alternatives) if candidate)])
    for edge in estimate.walls:
        axes.axline(*_two_points(edge), **_EDGE, label='certain walls', zorder=2)
    _number_edges(axes, estimate)
    _number_inside(axes, estimate)
    _draw_start(axes, start)
    axes.set_aspect('equal')
    axes.set_xlabel(f'x in {frame} [m]')
    axes.set_ylabel('y [m]')
    axes.grid(color='0.92', linewidth=0.6)
    axes.set_axisbelow(True)
    _draw_legend(axes)


def _other_paths(
    mapper: PolygonMapper, estimate: Estimate, start: Pose,
    true_path: tuple[NDArray[np.int64], NDArray[np.float64]] | None,
) -> dict[str, NDArray[np.float64]]:
    """The reported path, and the true one, of the base; none where the reported one is the answer's."""
    if estimate.trajectory is None:
        return {}
    paths = {'reported path': start.apply(mapper.path_log.poses[:, :2])}
    return paths if true_path is None else {**paths, 'true path': true_path[1][:, :2]}


def _draw_legend(axes: Any) -> None:
    """Above the axes, each label once."""
    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(handles.values(), handles.keys(), loc='lower center', bbox_to_anchor=(0.5, 1.0), ncols=4,
                columnspacing=1.2, frameon=False, fontsize='small')


def _number_edges(axes: Any, estimate: Estimate) -> None:
    """The numbers that the edges or walls have in the tables, a little inside."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    inside = 0.035 * max(right - left, high - low)
    middle = np.array([left + right, low + high]) / 2.0
    edges: tuple[Edge, ...] = estimate.walls
    places = [middle + (edge.r - _normal(edge) @ middle) * _normal(edge) for edge in edges]
    if estimate.polygon is not None:
        corners, edges = estimate.polygon.vertices, estimate.polygon.edges
        places = list(0.5 * (corners + np.roll(corners, -1, axis=0)))
    for number, (edge, place) in enumerate(zip(edges, places, strict=True)):
        _write(axes, place - inside * _normal(edge), str(number), _EDGE['color'])


def _number_inside(axes: Any, estimate: Estimate) -> None:
    """The numbers of holes, in their middles, and of inner walls."""
    for number, hole in enumerate(estimate.holes):
        _write(axes, hole.vertices.mean(axis=0), f'H{number}', _EDGE['color'])
    for number, wall in enumerate(estimate.inner_walls):
        _write(axes, 0.5 * (wall.start + wall.end), f'W{number}', _INNER['color'])


def _write(axes: Any, place: NDArray[np.float64], text: str, color: Any) -> None:
    axes.text(*place, text, color=color, ha='center', va='center', clip_on=True, zorder=5, path_effects=_halo())


def _halo() -> list[Any]:
    """A light edge, so that a label can be read on top of anything."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=3.0, foreground='white')]


def _draw_start(axes: Any, start: Pose) -> None:
    """The axes of the start frame O, as long as a tenth of the picture."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    length = 0.1 * max(right - left, high - low)
    tips = start.apply(np.array([[length, 0.0], [0.0, length]]))
    labels = start.apply(1.35 * np.array([[length, 0.0], [0.0, length]]))
    for tip, place, name in zip(tips, labels, 'xy', strict=True):
        axes.annotate('', xy=tip, xytext=(start.x, start.y), zorder=5, arrowprops=_ARROW)
        axes.text(*place, name, color='#1f77b4', ha='center', va='center', zorder=6, path_effects=_halo())
    corner = start.apply(-0.35 * np.array([length, length]))
    axes.text(*corner, 'O', color='#1f77b4', ha='center', va='center', zorder=6, path_effects=_halo())


def _draw_beam_map(figure: Any, axes: Any, mapper: PolygonMapper, estimate: Estimate) -> None:
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import MultipleLocator

    beam_map = mapper.surroundings.beam_map
    theta_deg, r_m = np.rad2deg(beam_map.theta_rad), beam_map.r_m
    half_deg, half_m = 0.5 * (theta_deg[-1] - theta_deg[0]) / len(theta_deg), 0.5 * (r_m[1] - r_m[0])
    extent = (theta_deg[0] - half_deg, theta_deg[-1] + half_deg, r_m[0] - half_m, r_m[-1] + half_m)
    drawn = axes.imshow(beam_map.normalised().T, origin='lower', aspect='auto', extent=extent, cmap='viridis',
                        vmin=0.0, interpolation='nearest')
    edges = _named_edges(estimate)
    if edges:
        axes.set_ylim(extent[2], min(extent[3], _HEADROOM * max(edge.r for _, edge in edges)))
    span_deg = min(_RECTANGLE_DEG, 0.1 * (extent[1] - extent[0]))
    span_m = _RECTANGLE_M * (axes.get_ylim()[1] - extent[2])
    label = 'estimated edges' if estimate.polygon else 'certain walls'
    for name, edge in edges:
        turns = np.rad2deg(edge.theta) + 360.0 * np.arange(-2, 3)
        for place in turns[(turns >= extent[0]) & (turns <= extent[1])]:
            axes.add_patch(Rectangle((place - span_deg / 2, edge.r - span_m / 2), span_deg, span_m, fill=False,
                                     edgecolor='red', linewidth=1.6, clip_on=True, label=label))
            axes.text(place, edge.r + 0.6 * span_m, name, color='white', ha='center', va='bottom', clip_on=True)
    if extent[1] - extent[0] > 180.0:
        axes.xaxis.set_major_locator(MultipleLocator(45.0))
    if edges:
        _draw_legend(axes)
    axes.set_xlabel(r'$\theta$ in the start frame O [deg]')
    axes.set_ylabel('r from O [m]')
    figure.colorbar(drawn, ax=axes, label=r'$\mathcal{L}_T(r, \theta)\,/\,$max', pad=0.02)


def _named_edges(estimate: Estimate) -> list[tuple[str, Edge]]:
    """All edges and walls of an answer in the start frame, an inner wall by the side that is seen from there."""
    edges = (*(estimate.polygon.edges if estimate.polygon else ()), *estimate.walls)
    return [
        *((str(number), edge) for number, edge in enumerate(edges)),
        *((f'H{number}.{i}', edge) for number, hole in enumerate(estimate.holes) for i, edge in enumerate(hole.edges)),
        *((f'W{number}', wall.edge if wall.edge.r >= 0.0 else wall.edge.turned())
          for number, wall in enumerate(estimate.inner_walls))]


def _ring(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.vstack([vertices, vertices[:1]])


def _normal(edge: Edge) -> NDArray[np.float64]:
    return np.array([np.cos(edge.theta), np.sin(edge.theta)])


def _two_points(edge: Edge) -> tuple[tuple[float, float], tuple[float, float]]:
    c, s = _normal(edge).tolist()
    return (edge.r * c, edge.r * s), (edge.r * c - s, edge.r * s + c)


def _fit(axes: Any, clouds: list[NDArray[np.float64]]) -> None:
    """Limits around everything, of a size even where it is a line or a point."""
    points = np.vstack([*clouds, np.zeros((0, 2))])
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.ones(2))
    border = 0.06 * max(float(np.max(high - low)), 1e-6)
    thin = np.maximum(0.25 * np.max(high - low) - (high - low), 0.0) / 2.0
    (left, bottom), (right, top) = low - border - thin, high + border + thin
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
