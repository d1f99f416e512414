"""Draw the figures of the method's pages from the package itself: python doc/method/figures.py [NAME...]."""

import dataclasses
import io
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from against_truth import against_the_truth, true_lines
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from polymap_ros import Parameters, PolygonMapper, load_scene, map_polygon, simulate
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.alignment import alignment
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.geometry.poses import in_frame
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import noise_free
from polymap_ros.simulation.waves import wave_echoes
from polymap_ros.solvers.evidence.moves.start import starts
from polymap_ros.solvers.evidence.search import Found, Search, search_of
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
from polymap_ros.solvers.evidence.waveform import WaveformLikelihood

FOLDER = Path(__file__).parent / 'figures'
SCENE, PING, WALL = 'pentagon', 26, 2
"""The plate of most figures, the ping of those about one, and the wall of the one about half a cycle."""

SEEDS, EDGES = (2, 4, 6, 8), range(3, 9)
"""The random plates of the figure about the published cost."""

TRUTH, HEARD, FOUND, LEFT, GREY = '#d62728', '#1f77b4', '#2ca02c', '#9467bd', '0.6'
ORDERS = '#1f77b4', '#ff7f0e', '#2ca02c', '#9467bd', '#8c564b'


class Plate(NamedTuple):
    """A scene that was heard, its true lines in the start frame, and what the search makes of them."""

    scene: Scene
    mapper: PolygonMapper
    lines: NDArray[np.float64]
    search: Search
    found: Found


@cache
def plate() -> Plate:
    """Return the plate of most figures, its walls found."""
    scene = load_scene(SCENE)
    mapper = filled_mapper(scene, Parameters())
    search = search_of(mapper.evidence, mapper.parameters)
    found = next(each for each in search.polygons() if each is not None)
    return Plate(scene, mapper, true_lines(scene, mapper), search, found)


def ping() -> Figure:
    """A ping as it is received, and as eq. (3) compresses it."""
    scene, mapper, *_ = plate()
    figure, (above, below) = figure_of(2, 1, (7.0, 4.4))
    time_ms = 1e3 * scene.period_s * np.arange(scene.n_samples)
    above.plot(time_ms, simulate(scene)[PING], color=HEARD, linewidth=0.6, label='received, 0 dB')
    above.plot(time_ms, noise_free(scene)[PING], color='black', linewidth=0.7, label='without its noise')
    above.set(xlabel='time after emission [ms]', ylabel='sample', xlim=(0, time_ms[-1]))
    above.legend(loc='upper right', ncols=2)
    sounding = mapper.soundings[PING]
    below.plot(mapper.beam_map.r_m, sounding.envelope, color=HEARD, linewidth=1.0)
    top = 1.12 * float(sounding.envelope.max())
    images = visible_images(scene.vertices, scene.positions[PING], 3)
    for order in (1, 2, 3):
        ranges = 0.5 * images.distance_m[images.order == order]
        below.vlines(ranges, 0.0, (0.32 - 0.07 * order) * top, color=ORDERS[order], linewidth=1.4, zorder=6 - order,
                     label=f'images of order {order}')
    below.axvline(sounding.rho, color='black', linewidth=0.8, linestyle=':')
    below.annotate(r'$\rho_i$', (sounding.rho, 0.95 * top), (4, 0), textcoords='offset points', va='top')
    below.set(xlabel='range r [m]', ylabel='envelope $e_i(r)$', xlim=(0, 2.5), ylim=(0, top))
    below.legend(loc='upper right')
    return figure


def beamforming() -> Figure:
    """The map of eq. (4) with the true walls."""
    _, mapper, lines, *_ = plate()
    figure, (axes,) = figure_of(1, 1, (6.4, 3.6))
    beam = mapper.beam_map
    image = axes.pcolormesh(np.degrees(beam.theta_rad), beam.r_m, beam.normalised().T, cmap='viridis', vmin=0.0,
                            rasterized=True)
    r, theta = lines.T
    axes.plot(np.degrees(np.mod(theta, 2.0 * np.pi)), r, 'o', mfc='none', mec=TRUTH, ms=11, mew=1.6, label='true walls')
    axes.set(xlabel=r'$\theta$ [deg]', ylabel='r [m]', ylim=(0, 2.0), xticks=range(0, 361, 60))
    axes.legend(loc='upper right')
    figure.colorbar(image, ax=axes, label=r'$L_T / \max L_T$')
    return figure


def images() -> Figure:
    """Image sources, and a path of second order with its image."""
    scene = plate().scene
    figure, (axes,) = figure_of(1, 1, (6.2, 4.2))
    place = scene.positions[PING]
    all_images = visible_images(scene.vertices, place, 3)
    axes.fill(*scene.vertices.T, facecolor='0.93', edgecolor='black', linewidth=1.6)
    for order in (1, 2, 3):
        of = all_images.order == order
        axes.plot(*all_images.position_m[of].T, 'o', color=ORDERS[order], ms=8 - 1.6 * order, label=f'order {order}')
    axes.plot(*place, 'k*', ms=11, label='the device')
    second = np.flatnonzero(all_images.order == 2)[0]
    walls, image = all_images.walls[second, :2], all_images.position_m[second]
    first_image = mirrored(place, polygon_lines(scene.vertices)[walls[0]])
    last = meet(place, image, polygon_lines(scene.vertices)[walls[1]])
    first = meet(last, first_image, polygon_lines(scene.vertices)[walls[0]])
    path = np.array([place, first, last, place])
    axes.plot(*path.T, color=ORDERS[2], linewidth=1.5, label='a path of order 2')
    axes.plot(*np.array([last, image]).T, color=ORDERS[2], linewidth=1.0, linestyle=':', label='as long as this')
    for wall, (a, b) in enumerate(zip(scene.vertices, np.roll(scene.vertices, -1, axis=0), strict=True)):
        outward = np.array((b - a)[1::-1] * (1, -1)) / np.linalg.norm(b - a)
        axes.annotate(str(wall), 0.5 * (a + b) + 0.18 * outward, ha='center', va='center', color='0.35')
    axes.set_aspect('equal')
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.legend(loc='upper left', bbox_to_anchor=(1.0, 1.0))
    return figure


def published() -> Figure:
    """The published cost of other states less that of the truth, over random plates."""
    figure, (axes,) = figure_of(1, 1, (6.4, 3.6))
    table = {(edges, seed): against_the_truth(random_scene(seed, edges)) for edges in EDGES for seed in SEEDS}
    for (edges, seed), row in table.items():
        at = edges + 0.12 * (SEEDS.index(seed) - 1.5)
        axes.plot(at, row.replaced, 'o', color=TRUTH, ms=5, label='an edge replaced by a copy of the strongest')
        axes.plot(at, row.annealed, 'x', color=HEARD, ms=5, mew=1.5, label='after 300 iterations')
        print(edges, seed, row)
    rows, many = list(table.values()), [row for (edges, _), row in table.items() if edges >= 5]
    for text, count in (
            ('plates', len(rows)), ('of five edges or more', len(many)),
            ('cheaper with a true edge replaced', sum(row.replaced < 0.0 for row in rows)),
            ('such of five edges or more', sum(row.replaced < 0.0 for row in many)),
            ('annealed below the truth', sum(row.annealed < 0.0 for row in rows)),
            ('right', sum(row.right for row in rows)),
            ('eq. (10) drops true edges', sum(row.kept < edges for (edges, _), row in table.items())),
            ('a range is too long', sum(row.too_long > 0 for row in rows)),
            ('IoU of the truth below 0.6', sum(row.iou < 0.6 for row in rows))):
        print(f'{text}: {count}')
    weakest = [row.weakest for row in many]
    print(f'weakest wall of five edges or more: {min(weakest):.2f} to {max(weakest):.2f}')
    axes.axhline(0.0, color='black', linewidth=0.8)
    axes.set(xlabel='true edges', ylabel='eq. (5), less that of the truth')
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[:2], labels[:2], loc='upper right')
    return figure


def power() -> Figure:
    """Power of one ping, heard and predicted."""
    *_, search, found = plate()
    figure, axes_of_orders = figure_of(2, 1, (7.0, 4.4), sharex=True)
    data, range_m = search.data, np.arange(search.data.power.shape[1]) * search.data.cell_m
    for axes, order in zip(axes_of_orders, (1, FULL_ORDER), strict=True):
        fitted = search.power.fitted(found.walls, found.power, order)
        axes.plot(range_m, data.power[PING], color=HEARD, linewidth=0.8, label='heard, E')
        axes.plot(range_m, fitted.expected[PING], color=TRUTH, linewidth=1.2, label='predicted, T')
        axes.plot(range_m, 1.0 + fitted.background, color='black', linewidth=0.9, linestyle='--', label='1 + B')
        axes.set(yscale='log', ylim=(0.1, 1e3), ylabel='power in noise', xlim=(0, 1.8))
        axes.annotate(f'orders up to {order}' if order > 1 else 'order 1', (0.02, 0.95), xycoords='axes fraction',
                      va='top')
        axes.legend(loc='upper right', ncols=3)
    axes.set_xlabel('range r [m]')
    return figure


def waveform() -> Figure:
    """The compressed signal of one ping, heard and predicted, and what is left."""
    *_, search, found = plate()
    wave, data = found.wave, search.data
    step = data.pulse.step_m
    range_m = step * np.arange(data.signal.shape[1])
    each_step = WaveformLikelihood(dataclasses.replace(data, cell_m=step, power=np.ones(data.signal.shape)))
    signal, predicted = (waveform[PING] * np.exp(2j * data.pulse.carrier * range_m) for waveform in (
        each_step.without_carrier(), each_step.without_carrier(wave)))
    figure, (above, below) = figure_of(2, 1, (7.0, 4.4), sharex=True, sharey=True)
    above.plot(range_m, signal.real, color=HEARD, linewidth=1.3, label='heard')
    above.plot(range_m, predicted.real, color=TRUTH, linewidth=0.9, linestyle='--', label='predicted')
    below.plot(range_m, (signal - predicted).real, color=LEFT, linewidth=0.9, label='left')
    below.axhspan(-2.0, 2.0, color='0.9', label='two deviations of the noise')
    below.set(xlabel='range r [m]', xlim=(0.0, 1.3))
    for axes in (above, below):
        axes.set_ylabel('eq. (3), in noise')
        axes.legend(loc='upper right', ncols=2)
    return figure


def cycles() -> Figure:
    """Both likelihoods over r of one wall, the others where they were found."""
    *_, search, found = plate()
    figure, (above, below) = figure_of(2, 1, (7.0, 4.8), sharex=True)
    offsets = np.linspace(-0.02, 0.02, 401)
    value = [search.power.value(found.walls.shifted(WALL, by), found.power, FULL_ORDER) for by in offsets]
    above.plot(1e3 * offsets, 1e-3 * np.array(value), color=HEARD)
    above.set_ylabel('power, F\n[1000 nats]')
    for turned, style in ((False, {'color': FOUND}), (True, {'color': TRUTH, 'linestyle': '--'})):
        value = []
        for by in offsets:
            wave = search.wave.evaluate(found.walls.shifted(WALL, by, turned), found.wave, FULL_ORDER)
            value.append(wave.value)
        below.plot(1e3 * offsets, 1e-3 * np.array(value), **style,
                   label='its sign turned' if turned else 'with the sign that was found')
    below.set(xlabel=f'r of wall {WALL}, from where it is [mm]', ylabel='waveform, L\n[1000 nats]')
    for axes in (above, below):
        for half in np.arange(-3, 4):
            axes.axvline(500.0 * half * search.cycle_m, color='0.85', linewidth=0.8, zorder=0)
    below.legend(loc='upper right')
    return figure


def search() -> Figure:
    """From lines that are proposed to the answer."""
    _, _, lines, over, found = plate()
    figure, panels = figure_of(2, 2, (7.0, 6.4), sharex=True, sharey=True)
    start = next(each for each in starts(over) if each is not None)
    by_power = over.by_power(start)
    off_mm = [1e3 * float(np.abs(np.sort(each[:, 0]) - np.sort(lines[:, 0])).max())
              for each in (by_power.walls.lines, found.lines)]
    titles = (f'{len(start.pool)} candidate lines', f'start: {len(start.power.walls)} of them, annealed',
              f'changed by power: r within {off_mm[0]:.1f} mm', f'settled by the waveform: within {off_mm[1]:.2f} mm')
    for axes, title, shown in zip(panels, titles, (None, start.power.walls.lines, by_power.walls.lines, found.lines),
                                  strict=True):
        corners = half_plane_polygon(lines)[0]
        axes.plot(*closed(corners).T, color=TRUTH, linewidth=1.3, linestyle=(0, (5, 3)), label='truth')
        axes.plot(*over.data.positions.T, 'k.', ms=2.5, label='pings')
        if shown is None:
            for r, theta in start.pool:
                along = np.array((-np.sin(theta), np.cos(theta)))
                foot = r * np.array((np.cos(theta), np.sin(theta)))
                axes.plot(*np.array((foot - 4 * along, foot + 4 * along)).T, color=HEARD, linewidth=0.35, zorder=0)
        else:
            axes.plot(*closed(half_plane_polygon(shown)[0]).T, color=FOUND, linewidth=1.6, zorder=0, label='polygon')
        low, high = corners.min(axis=0) - 0.3, corners.max(axis=0) + 0.3
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), title=title)
        axes.set_aspect('equal')
    panels[1].legend(loc='upper left')
    figure.supxlabel('x [m]')
    figure.supylabel('y [m]')
    return figure


def drift() -> Figure:
    """Estimated, reported and true path under odometry that drifts."""
    scene = dataclasses.replace(load_scene(SCENE), faults=Faults(drift='bad'))
    estimate = map_polygon(scene.reported_poses(), simulate(scene), period_s=scene.period_s,
                           parameters=scene.parameters())
    path = estimate.trajectory
    assert path is not None
    assert estimate.polygon is not None
    true = scene.poses[:, :2]
    aligned = in_frame(path.poses, alignment(path.poses[:, :2], true))
    paths = {'reported': path.reported, 'estimated': path.poses, 'estimated, moved as a whole': aligned}
    off_mm = {name: 1e3 * np.hypot(*(each[:, :2] - true).T) for name, each in paths.items()}
    figure, (room, errors) = figure_of(1, 2, (8.4, 3.9), width_ratios=(1.25, 1.0))
    room.plot(*closed(scene.vertices).T, color=TRUTH, linewidth=1.3, linestyle=(0, (5, 3)), label='true walls')
    room.plot(*closed(estimate.polygon.vertices).T, color=FOUND, linewidth=1.6, zorder=0, label='estimated walls')
    room.plot(*path.reported[:, :2].T, color=GREY, linewidth=1.0, marker='.', ms=3, label='reported path')
    room.plot(*path.poses[:, :2].T, color='black', linewidth=1.0, marker='.', ms=3, label='estimated path')
    room.set_aspect('equal')
    room.set(xlabel='x [m]', ylabel='y [m]')
    room.legend(loc='upper left', bbox_to_anchor=(0.0, 1.2), ncols=2)
    for (name, error), color in zip(off_mm.items(), (GREY, 'black', FOUND), strict=True):
        errors.semilogy(np.maximum(error, 1e-3), color=color, marker='.', ms=3, linewidth=0.9, label=name)
        print(f'drift: {name} up to {error.max():.2f} mm')
    errors.set(xlabel='ping', ylabel='error of the position [mm]', ylim=(5e-3, 3e3))
    errors.legend(loc='upper left')
    return figure


def corners() -> Figure:
    """What a ping hears round an L's inner corner: by the wave equation, by images, and with what corners return."""
    outline = 0.6 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [0.45, 0.5], [0.45, 1.1], [0.0, 1.1]])
    place = 0.6 * np.array([0.43, 0.28])
    scene = Scene(name='corner', vertices=outline, poses=np.array([[*place, 0.0]]), n_samples=640)
    waves, plain, faded = wave_echoes(scene)[0], noise_free(scene)[0], noise_free(
        dataclasses.replace(scene, edge_fading='fresnel'))[0]
    time_us = 1e6 * scene.period_s * np.arange(scene.n_samples)
    figure, (room, echoes) = figure_of(1, 2, (7.2, 2.6), width_ratios=(1, 3))
    room.plot(*closed(outline).T, color='black')
    room.plot(*place, 'o', color=HEARD, ms=4)
    room.set(aspect='equal', xticks=[], yticks=[])
    room.axis('off')
    loud = np.abs(waves).max()
    curves = (('wave equation', waves, 'black'), ('images to order 5', plain, TRUTH),
              ('with what corners return', faded, FOUND))
    for shift, (name, samples, color) in enumerate(curves):
        left = np.sum((samples - waves) ** 2) / np.sum(waves**2)
        echoes.plot(time_us, samples / loud - 1.5 * shift, color=color, linewidth=0.8, label=name)
        if shift:
            echoes.plot(time_us, (samples - waves) / loud - 1.5 * shift, color=GREY, linewidth=0.6)
            print(f'corners: {name} leaves {left:.3f} of the power')
    echoes.set(xlabel='time after emission [us]', yticks=[], xlim=(80.0, 640.0), ylim=(-4.2, 2.2))
    echoes.legend(loc='upper right', ncols=3)
    return figure


def mirrored(point: NDArray[np.float64], line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a point's image in a line."""
    normal = np.array((np.cos(line[1]), np.sin(line[1])))
    return point + 2.0 * (line[0] - point @ normal) * normal


def meet(start: NDArray[np.float64], end: NDArray[np.float64], line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the way from start to end meets a line."""
    normal = np.array((np.cos(line[1]), np.sin(line[1])))
    return start + (line[0] - start @ normal) / ((end - start) @ normal) * (end - start)


def closed(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a polygon's vertices with the first one again at the end."""
    return np.vstack((vertices, vertices[:1]))


def figure_of(rows: int, columns: int, size: tuple[float, float], **options: object) -> tuple[Figure, list[Axes]]:
    """Return a figure with its axes."""
    figure = Figure(figsize=size, layout='constrained', facecolor='white')
    FigureCanvasAgg(figure)
    return figure, list(np.ravel(figure.subplots(rows, columns, **options)))


FIGURES: dict[str, Callable[[], Figure]] = {
    'ping': ping, 'map': beamforming, 'images': images, 'published': published, 'power': power, 'waveform': waveform,
    'cycles': cycles, 'search': search, 'drift': drift, 'corners': corners,
}

if __name__ == '__main__':
    mpl.rcParams.update({'font.size': 9, 'legend.fontsize': 8, 'legend.framealpha': 0.9, 'axes.titlesize': 9,
                         'axes.grid': False})
    for name in sys.argv[1:] or FIGURES:
        whole, path = io.BytesIO(), FOLDER / f'{name}.png'
        is_map = name == 'map'  # whose colours are too many for a palette
        FIGURES[name]().savefig(whole, dpi=84 if is_map else 110)
        image = Image.open(whole).convert('RGB')
        (image if is_map else image.quantize(128, method=Image.Quantize.MAXCOVERAGE)).save(path, optimize=True)
        print(f'{name}.png: {path.stat().st_size / 1e3:.0f} kB')
