"""Random shapes that are not just convex, with a random path that hears all of their walls."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from polymap_ros.errors import SceneError
from polymap_ros.simulation.inside_scenes import Draw, Inside, Tour, discs, inner_wall, plate, rectangles
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.trajectories import legs_inside
from polymap_ros.simulation.waveforms import among_all, noise_free
from polymap_ros.simulation.waves import wave_echoes

Points = NDArray[np.float64]

ECHOES = 'images', 'fresnel', 'waves'
"""What a scene's echoes may be: see `clean_echoes`."""

_PINGS, _STEP_M, _CLEARANCE_M = 60, 0.14, 0.06
_FEET, _LEAST_EDGE_M = 6, 0.24
_DRAWS, _PATH_DRAWS = 20_000, 4
_STREAM = 9

@dataclass(frozen=True)
class ShapeKind:
    """What a shape is like.

    Parameters
    ----------
    text : str
        In words.
    corners : callable
        Draws the corners (n, 2) of the outline, counter-clockwise [m].
    inside : callable, optional
        Draws what stands inside.
    pings : int
        Length of the path.
    """

    text: str
    corners: Callable[[np.random.Generator], Points]
    inside: Draw | None = None
    pings: int = _PINGS


def shaped_scene(kind: str, seed: int) -> Scene:
    """Draw the scene of a kind of `SHAPE_KINDS` and a seed: every wall is heard directly by six pings or more.

    The path is clear of the outline and of holes, and crosses inner walls.

    Raises
    ------
    SceneError
        Where twenty thousand outlines give none.
    """
    generator, drawn = np.random.default_rng([seed, list(SHAPE_KINDS).index(kind), _STREAM]), SHAPE_KINDS[kind]
    for _ in range(_DRAWS):
        corners, turn = drawn.corners(generator), generator.uniform(0.0, 2.0 * np.pi)
        c, s = np.cos(turn), np.sin(turn)
        corners = (corners - corners.mean(axis=0)) @ np.array([[c, s], [-s, c]])
        outline = shapely.Polygon(corners)
        free = outline.buffer(-_CLEARANCE_M)
        lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        if not outline.is_valid or free.geom_type != 'Polygon' or lengths.min() < _LEAST_EDGE_M:
            continue
        inside = drawn.inside(generator, corners) if drawn.inside else Inside()
        if inside is None or inside.room(corners).buffer(-_CLEARANCE_M).geom_type != 'Polygon':
            continue
        for _ in range(_PATH_DRAWS):
            poses = _way(drawn.pings, corners, inside, generator)
            if poses is not None and inside.feet(corners, poses[:, :2]).min() >= _FEET:
                return Scene(name=f'{kind}-{len(corners)}-{seed}', vertices=corners, poses=poses, seed=seed,
                             holes=inside.holes, inner_walls=inside.inner_walls)
    raise SceneError(f'{_DRAWS} outlines of the kind {kind} and none is heard by {_FEET} pings a wall')


def _way(pings: int, corners: Points, inside: Inside, generator: np.random.Generator) -> Points | None:
    """Draw poses (pings, 3); None for a walk that ends between a hole and a corner."""
    holes = [hole.vertices for hole in inside.holes]
    tour = Tour(corners, inside, generator, _FEET) if holes else None
    try:
        return legs_inside(corners, pings, _STEP_M, _CLEARANCE_M, generator, holes, tour)
    except SceneError:
        return None


def clean_echoes(scene: Scene, echoes: str = 'images') -> Points:
    """Return what a scene's pings hear, without noise (T, n_samples), of every sequence of its walls.

    That is another tracer than the mapper's, by which `noise_free` goes where nothing is inside the outline. `echoes`,
    of `ECHOES`, says whether to add what corners return (`diffraction`), or to solve the wave equation (`waves`).
    """
    if echoes == 'waves':
        return wave_echoes(scene)
    return noise_free(dataclasses.replace(scene, edge_fading='none' if echoes == 'images' else echoes),
                      lambda position: among_all(scene, position, position))


def l_shape(generator: np.random.Generator) -> Points:
    """Corners (6, 2) of an L, counter-clockwise [m]."""
    width, height = generator.uniform(0.9, 1.4, 2)
    x, y = generator.uniform(0.35, 0.65, 2) * (width, height)
    return np.array([[0.0, 0.0], [width, 0.0], [width, y], [x, y], [x, height], [0.0, height]])


def t_shape(generator: np.random.Generator) -> Points:
    """Corners (8, 2) of a T, counter-clockwise [m]."""
    width, height = generator.uniform(1.0, 1.5, 2)
    left, right = np.array((generator.uniform(0.2, 0.35), generator.uniform(0.65, 0.8))) * width
    y = generator.uniform(0.4, 0.6) * height
    return np.array([[left, 0.0], [right, 0.0], [right, y], [width, y], [width, height], [0.0, height], [0.0, y],
                     [left, y]])


def _u_shape(generator: np.random.Generator) -> Points:
    width, height = generator.uniform(1.1, 1.6, 2)
    left, right = np.array((generator.uniform(0.28, 0.4), generator.uniform(0.6, 0.72))) * width
    y = generator.uniform(0.3, 0.5) * height
    return np.array([[0.0, 0.0], [width, 0.0], [width, height], [right, height], [right, y], [left, y], [left, height],
                     [0.0, height]])


def _z_shape(generator: np.random.Generator) -> Points:
    """Two bars, one over the other, of which the parts beside each other are joined."""
    width, height = generator.uniform(1.2, 1.7), generator.uniform(0.9, 1.3)
    left, right = np.array((generator.uniform(0.3, 0.42), generator.uniform(0.6, 0.72))) * width
    low, high = np.sort(np.array((generator.uniform(0.35, 0.5), generator.uniform(0.5, 0.65)))) * height
    return np.array([[0.0, 0.0], [right, 0.0], [right, low], [width, low], [width, height], [left, height],
                     [left, high], [0.0, high]])


def _dart(generator: np.random.Generator) -> Points:
    """A quadrangle with one corner that points inwards."""
    size = generator.uniform(0.9, 1.4)
    low, high = generator.uniform(0.1, 0.3, 2)
    inner = generator.uniform(0.35, 0.5, 2)
    return size * np.array([[0.0, 0.0], [1.1, low], inner, [high, 1.1]])


def _dent(generator: np.random.Generator) -> Points:
    """A rectangle with a dent in one side."""
    width, height = generator.uniform(1.0, 1.5, 2)
    x, depth = generator.uniform(0.35, 0.65) * width, generator.uniform(0.2, 0.35) * height
    left, right = generator.uniform(0.1, 0.2) * width, generator.uniform(0.8, 0.9) * width
    return np.array([[0.0, 0.0], [width, 0.0], [width, height], [right, height], [x, height - depth], [left, height],
                     [0.0, height]])


def _steps(generator: np.random.Generator) -> Points:
    width, height = generator.uniform(1.2, 1.6, 2)
    x, y = ((generator.uniform(0.3, 0.4) * size, generator.uniform(0.62, 0.72) * size) for size in (width, height))
    return np.array([[0.0, 0.0], [width, 0.0], [width, y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]], [x[0], height],
                     [0.0, height]])


def _skewed(corners: Callable[[np.random.Generator], Points]) -> Callable[[np.random.Generator], Points]:
    """No right angles, no parallel walls."""
    def skewed(generator: np.random.Generator) -> Points:
        upright = corners(generator)
        sheared = upright @ (np.eye(2) + generator.uniform(-0.2, 0.2, (2, 2))).T
        return np.asarray(sheared + generator.uniform(-0.05, 0.05, upright.shape))
    return skewed


SHAPE_KINDS = {
    'l': ShapeKind('L', l_shape),
    't': ShapeKind('T', t_shape),
    'u': ShapeKind('U', _u_shape),
    'z': ShapeKind('Z', _z_shape),
    'dart': ShapeKind('quadrangle with a corner that points inwards', _dart),
    'dent': ShapeKind('rectangle with a dent', _dent),
    'skewed_l': ShapeKind('L without right angles', _skewed(l_shape)),
    'skewed_t': ShapeKind('T without right angles', _skewed(t_shape)),
    'steps': ShapeKind('two steps', _steps),
    'hole': ShapeKind('plate with a rectangular hole', plate, rectangles(1), 80),
    'two_holes': ShapeKind('plate with two rectangular holes', plate, rectangles(2), 90),
    'stiffener': ShapeKind('plate with a stiffener', plate, inner_wall(0.5, 0.8)),
    'seam': ShapeKind('plate with a weld seam', plate, inner_wall(1.0, 1.0)),
    'convex': ShapeKind('convex plate', plate),
    'round_hole': ShapeKind('plate with a round hole', plate, discs(1), 80),
    'two_round_holes': ShapeKind('plate with two round holes', plate, discs(2), 90),
}
"""By name."""
