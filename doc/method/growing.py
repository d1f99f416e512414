"""Make resource/growing.gif: the map of eq. (4) and the polygon, ping by ping: python doc/method/growing.py."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from polymap_ros import Estimate, PolygonMapper, Pose, load_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import pings

GIF = Path(__file__).parents[2] / 'resource' / 'growing.gif'
SCENE, PINGS = 'pentagon', 40
SLOW, SLOW_S, QUICK_S, LAST_S = 12, 0.3, 0.09, 2.0
"""The first frames, in which the polygon is found, are shown longer."""

RANGE_M, BIN = 1.5, 2
"""Ranges that are drawn, and cells of the map, each way, that are drawn as one: the picture is to stay small."""

DPI, COLOURS = 72, 64
TRUTH, FOUND = '#d62728', '#2ca02c'


def draw_room(axes: Axes, scene: Scene, mapper: PolygonMapper, estimate: Estimate) -> None:
    """Draw truth, path and answer in the odometry's frame."""
    low, high = scene.vertices.min(axis=0) - 0.1, scene.vertices.max(axis=0) + 0.1
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xticks=(), yticks=())
    axes.set_aspect('equal')
    axes.plot(*np.vstack((scene.vertices, scene.vertices[:1])).T, color=TRUTH, linewidth=1.0, linestyle=(0, (5, 3)))
    for wall in estimate.walls:
        foot, along = np.array((np.cos(wall.theta), np.sin(wall.theta))), np.array(
            (-np.sin(wall.theta), np.cos(wall.theta)))
        axes.axline(wall.r * foot, wall.r * foot + along, color=FOUND, linewidth=1.6)
    polygons = estimate.alternatives if estimate.polygon is None else (estimate.polygon,)
    for style, each in zip(('-', ':'), polygons, strict=False):
        axes.plot(*np.vstack((each.vertices, each.vertices[:1])).T, color=FOUND, linewidth=2.4, linestyle=style)
    path = np.array([mapper.start_pose.apply(place) for place in mapper.places.positions])
    axes.plot(*path.T, color='black', linewidth=0.7, marker='o', ms=2.0)
    said = {'closed': f'{len(estimate.polygon.edges) if estimate.polygon else 0} edges',
            'ambiguous': f'{len(estimate.alternatives)} polygons fit', 'open': f'open, {len(estimate.walls)} walls'}
    axes.set_title(f'{mapper.places.count} of {PINGS} pings: {said[estimate.status]}')


def draw_map(axes: Axes, mapper: PolygonMapper, estimate: Estimate) -> None:
    """Draw the map in the start frame, with the edges that were found."""
    beam = mapper.beam_map
    cells = beam.normalised()[:, :round(RANGE_M / beam.r_m[1])]
    coarse = cells.reshape(cells.shape[0] // BIN, BIN, cells.shape[1] // BIN, BIN).max(axis=(1, 3))
    axes.imshow(coarse.T, origin='lower', aspect='auto', extent=(0.0, 360.0, 0.0, RANGE_M), cmap='gray', vmin=0.0,
                vmax=1.0, interpolation='nearest')
    found = estimate.moved(mapper.start_pose.inverse())
    edges = [*found.walls, *(edge for each in found.alternatives or (found.polygon,) if each for edge in each.edges)]
    axes.plot([np.degrees(edge.theta) % 360.0 for edge in edges], [edge.r for edge in edges], 'o', mfc='none',
              mec=FOUND, ms=10, mew=1.8)
    axes.set(xlim=(0.0, 360.0), ylim=(0.0, RANGE_M), xlabel=r'$\theta$ [deg]', ylabel='r [m]', xticks=range(0, 361, 90),
             title='beamforming map, eq. (4)')


def frame_of(scene: Scene, mapper: PolygonMapper, estimate: Estimate) -> Image.Image:
    """Return one picture."""
    figure = Figure(figsize=(7.4, 3.5), dpi=DPI, layout='constrained', facecolor='white')
    canvas = FigureCanvasAgg(figure)
    room, beam = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    draw_room(room, scene, mapper, estimate)
    draw_map(beam, mapper, estimate)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert('RGB')


def main() -> None:
    """Hear, solve and draw after every ping."""
    mpl.rcParams.update({'font.size': 9, 'axes.titlesize': 10})
    scene, frames = load_scene(SCENE), []
    mapper = PolygonMapper(scene.parameters())
    for ping, pose in list(zip(pings(scene), scene.reported_poses().tolist(), strict=True))[:PINGS]:
        mapper.add_pose(ping.emission_ns, Pose(*pose))
        mapper.add_ping(ping)
        estimate = mapper.solve()
        frames.append(frame_of(scene, mapper, estimate))
    ends = Image.fromarray(np.vstack([np.asarray(frames[0]), np.asarray(frames[-1])]))
    palette = ends.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in frames]
    times_ms = [round(1e3 * (SLOW_S if number < SLOW else QUICK_S)) for number in range(len(frames))]
    times_ms[-1] = round(1e3 * LAST_S)
    frames[0].save(GIF, save_all=True, append_images=frames[1:], duration=times_ms, loop=0, optimize=True)
    print(f'{GIF.name}: {GIF.stat().st_size / 1e3:.0f} kB, {1e-3 * sum(times_ms):.1f} s')


if __name__ == '__main__':
    main()
