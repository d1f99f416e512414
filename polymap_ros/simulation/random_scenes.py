"""Random convex rooms with a random path: the scenes that every method is judged on.

A room of n edges: the gaps between the directions of adjacent edges are uniform over all that sum to 360 degrees
and are 20 to 150 degrees each; the edge lengths are drawn uniform and corrected, by least squares, to close; the
largest distance between two corners is uniform over 1 to 2 m. A path that does not meet the recipe is drawn again,
and after a few paths the room too.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import SceneError
from polymap_ros.map_parameters import GridParameters
from polymap_ros.parameters import MediumParameters, PulseParameters
from polymap_ros.simulation.clearance import audible_feet
from polymap_ros.simulation.height import Height
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.trajectories import fitted, random_legs, recorded

SPEED_OF_SOUND_M_S = 343.0
_ROOM_SCALE = 4.0
_ROOM_DRAWS, _PATH_DRAWS = 1000, 8
_GAP_DRAWS = 512
_DRIVE_DRAWS = 1000


@dataclass(frozen=True)
class Recipe:
    """What a random scene has to meet; lengths in metres."""

    shape: str = 'convex'
    pings: int = 60
    step_m: float = 0.14
    clearance_m: float = 0.06
    least_extent_m: float = 1.0
    greatest_extent_m: float = 2.0
    least_edge_m: float = 0.24
    least_edge_of_octagon_m: float = 0.15
    feet_per_edge: int = 6
    least_spread: float = 0.2
    """Smaller over larger principal standard deviation of the positions."""

    def least_edge(self, edges: int) -> float:
        """Shortest edge allowed in a room of so many edges [m]."""
        return self.least_edge_m if edges < 8 else self.least_edge_of_octagon_m

    def scaled(self, factor: float) -> 'Recipe':
        """The same recipe with all lengths multiplied."""
        lengths = {entry.name: getattr(self, entry.name) * factor
                   for entry in dataclasses.fields(self) if entry.name.endswith('_m')}
        return dataclasses.replace(self, **lengths)


def random_scene(seed: int, edges: int, recipe: Recipe | None = None) -> Scene:
    """Draw the scene of this seed and number of edges; the same arguments give the same scene.

    Raises
    ------
    SceneError
        Where the recipe cannot be met, such as a needle with more than 3 edges.
    """
    recipe = recipe or Recipe()
    vertices, poses = random_room(np.random.default_rng([seed, edges]), edges, recipe)
    return Scene(name=f'{recipe.shape}-{edges}-{seed}', vertices=vertices, poses=poses, seed=seed)


def air_filled(scene: Scene, pulse: str = 'tone_burst') -> Scene:
    """The scene as a room of air, every length times 4: sound at 343 m/s, amplitude 1/d, 20 kHz burst or chirp."""
    vertices, poses = scene.vertices * _ROOM_SCALE, scene.poses * (_ROOM_SCALE, _ROOM_SCALE, 1.0)
    shape = {'tone_burst': PulseParameters(frequency_hz=20000.0),
             'chirp': PulseParameters(kind='chirp', frequency_hz=20000.0, bandwidth_hz=20000.0, duration_s=2e-3)}
    return dataclasses.replace(
        scene, vertices=vertices, poses=poses, pulse=shape[pulse],
        medium=MediumParameters(model='constant', speed_m_s=SPEED_OF_SOUND_M_S),
        grid=GridParameters(range_max_m=12.0), sample_rate_hz=200_000.0, n_samples=14336)


def storeyed(scene: Scene) -> Scene:
    """A room of air with a floor 0.15 to 0.5 m below the device and a ceiling 1.8 to 3.2 m above it.

    Walls, floor and ceiling reflect 0.7 to 0.9 each.
    """
    generator = np.random.default_rng([scene.seed, len(scene.vertices), 3])
    low, high = generator.uniform((0.15, 1.8), (0.5, 3.2)).tolist()
    below, above, *walls = generator.uniform(0.7, 0.9, 2 + len(scene.vertices)).tolist()
    return dataclasses.replace(scene, reflection=np.array(walls), height=Height(low, high, below, above))


def lossy(scene: Scene, least: float = 0.5, most: float = 1.0) -> Scene:
    """The scene with reflection coefficients of random sign and a magnitude uniform in [`least`, `most`] per edge."""
    generator = np.random.default_rng([scene.seed, len(scene.vertices), 1])
    magnitude = generator.uniform(least, most, len(scene.vertices))
    return dataclasses.replace(scene, reflection=magnitude * generator.choice((-1.0, 1.0), len(scene.vertices)))


def mistaken(scene: Scene, **wrong: float) -> Scene:
    """The scene with these values of the medium told to the mapper instead of the true ones."""
    return dataclasses.replace(scene, told_medium=dataclasses.replace(scene.medium, **wrong))  # type: ignore[arg-type]


def driven(scene: Scene, path: NDArray[np.float64], recipe: Recipe | None = None) -> Scene:
    """The scene with a stretch of a recorded path (N, 3), turned and scaled to fill the room, in the place of its own.

    Stretch (a quarter of the path or more) and turn are drawn from the scene's seed until the path covers the room as
    the recipe asks.

    Raises
    ------
    SceneError
        Where no draw does.
    """
    recipe = recipe or Recipe()
    generator = np.random.default_rng([scene.seed, len(scene.vertices), 2])
    for _ in range(_DRIVE_DRAWS):
        share, place, turn = generator.uniform((0.25, 0.0, 0.0), (1.0, 1.0, 2.0 * np.pi))
        first = int(place * (1.0 - share) * len(path))
        stretch = path[first:first + max(int(share * len(path)), 2)]
        poses = fitted(recorded(stretch, recipe.pings), scene.vertices, recipe.clearance_m, float(turn))
        if _covers(scene.vertices, poses[:, :2], recipe):
            return dataclasses.replace(scene, poses=poses)
    raise SceneError(f'{_DRIVE_DRAWS} stretches of the recorded path and none covers the room of {scene.name}')


def random_room(
    generator: np.random.Generator, edges: int, recipe: Recipe
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw vertices (n, 2) and poses (T, 3) until they meet the recipe."""
    for _ in range(_ROOM_DRAWS):
        vertices = _polygon(generator, edges, recipe)
        if vertices is None:
            continue
        for _ in range(_PATH_DRAWS):
            poses = random_legs(vertices, recipe.pings, recipe.step_m, recipe.clearance_m, generator)
            if poses is None:
                break
            if _covers(vertices, poses[:, :2], recipe):
                return vertices, poses
    raise SceneError(f'{_ROOM_DRAWS} rooms of shape {recipe.shape} with {edges} edges and none meets the recipe')


def _covers(vertices: NDArray[np.float64], positions: NDArray[np.float64], recipe: Recipe) -> bool:
    deviations = np.sqrt(np.linalg.eigvalsh(np.cov(positions.T)))
    feet = audible_feet(vertices, positions).sum(axis=0)
    return bool(deviations[0] >= recipe.least_spread * deviations[1] and feet.min() >= recipe.feet_per_edge)


def _polygon(generator: np.random.Generator, edges: int, recipe: Recipe) -> NDArray[np.float64] | None:
    """Draw a counter-clockwise polygon of the recipe's shape, size and shortest edge; None if the draw fails."""
    shape = SHAPES[recipe.shape](generator, edges)
    if shape is None:
        return None
    vertices, least_edge = shape
    extent = generator.uniform(recipe.least_extent_m, recipe.greatest_extent_m)
    turn = generator.uniform(0.0, 2.0 * np.pi)
    vertices = vertices * (extent / np.linalg.norm(vertices[:, None] - vertices[None], axis=2).max())
    lengths = np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1)
    if lengths.min() < recipe.least_edge(edges) * least_edge:
        return None
    c, s = np.cos(turn), np.sin(turn)
    return np.asarray((vertices - vertices.mean(axis=0)) @ np.array([[c, s], [-s, c]]))


def _gaps(generator: np.random.Generator, edges: int) -> NDArray[np.float64] | None:
    """Draw angles between adjacent normals [rad], uniform over those of 20 to 150 degrees that sum to 360."""
    low, high = np.deg2rad(20.0), np.deg2rad(150.0)
    total = 2.0 * np.pi - edges * low
    draws = low + total * generator.dirichlet(np.ones(edges), size=_GAP_DRAWS)
    draws = draws[(draws <= high).all(axis=1)]
    return draws[0] if len(draws) else None


def _closed(gaps: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Corners of the polygon with these angles between edges and the closest lengths, by least squares, that close."""
    directions = np.cumsum(gaps)
    along = np.vstack((np.cos(directions), np.sin(directions)))
    lengths = lengths - along.T @ np.linalg.solve(along @ along.T, along @ lengths)
    if lengths.min() <= 0.0:
        return None
    return np.asarray(np.cumsum(lengths * along, axis=1).T)


_Shape: TypeAlias = tuple[NDArray[np.float64], float] | None
"""Corners, not yet scaled, and the shortest edge allowed as a multiple of the recipe's."""


def _convex(generator: np.random.Generator, edges: int) -> _Shape:
    gaps = _gaps(generator, edges)
    vertices = None if gaps is None else _closed(gaps, generator.uniform(0.2, 1.0, edges))
    return None if vertices is None else (vertices, 1.0)


def _unequal(generator: np.random.Generator, edges: int) -> _Shape:
    """The longest edge at least six times the shortest, which may be 0.4 of what the recipe asks for."""
    gaps = _gaps(generator, edges)
    vertices = None if gaps is None else _closed(gaps, np.geomspace(0.1, 1.0, edges)[generator.permutation(edges)])
    if vertices is None:
        return None
    lengths = np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1)
    return (vertices, 0.4) if lengths.max() >= 6.0 * lengths.min() else None


def _regular(generator: np.random.Generator, edges: int) -> _Shape:
    directions = 2.0 * np.pi * np.arange(edges) / edges
    return np.column_stack((np.cos(directions), np.sin(directions))), 1.0


def _needle(generator: np.random.Generator, edges: int) -> _Shape:
    """A triangle with one corner of 10 to 20 degrees."""
    if edges != 3:
        return None
    corner, length = np.deg2rad(generator.uniform(10.0, 20.0)), generator.uniform(0.8, 1.25)
    return np.array([[0.0, 0.0], [1.0, 0.0], [length * np.cos(corner), length * np.sin(corner)]]), 0.5


def _right_angled(generator: np.random.Generator, edges: int) -> _Shape:
    """A right-angled triangle, a rectangle, or a rectangle with one to four corners cut off."""
    width, height = generator.uniform(0.5, 1.0, 2)
    if edges == 3:
        return np.array([[0.0, 0.0], [width, 0.0], [0.0, height]]), 1.0
    if not 4 <= edges <= 8:
        return None
    cut = set(generator.permutation(4)[:edges - 4].tolist())
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    vertices: list[NDArray[np.float64]] = []
    for index, corner in enumerate(corners):
        if index in cut:
            before, after = corners[index - 1], corners[(index + 1) % 4]
            shares = generator.uniform(0.2, 0.4, 2)
            vertices += [corner + shares[0] * (before - corner), corner + shares[1] * (after - corner)]
        else:
            vertices.append(corner)
    return np.array(vertices), 1.0


SHAPES: dict[str, Callable[[np.random.Generator, int], _Shape]] = {
    'convex': _convex, 'right_angled': _right_angled, 'regular': _regular, 'needle': _needle, 'unequal': _unequal,
}
