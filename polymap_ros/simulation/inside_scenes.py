"""What stands inside random plates: rectangular and round holes, stiffeners, weld seams."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray

from polymap_ros.simulation.clearance import audible_feet, half_planes
from polymap_ros.simulation.inside import Hole, Partition, RoundHole
from polymap_ros.simulation.random_scenes import Recipe, random_room

Points = NDArray[np.float64]

_SIDES_M, _REFLECTIONS = (0.15, 0.4), (0.2, 0.6)
_LEAST_GAP_M, _LEAST_APART_M = 0.2, 0.2
"""From a hole, or the middle of an inner wall, to the outline, and from one hole to another: a robot gets through."""
_HOLE_DRAWS = 50
_JUST_BEFORE = 1.01
"""Radii from the middle of a round hole at which its feet are in sight: its polygon is not quite the circle."""
_BEFORE_M = 0.08, 0.4
"""How far from a wall it is listened to in turn."""


class Inside(NamedTuple):
    """Holes and inner walls of an outline."""

    holes: tuple[Hole | RoundHole, ...] = ()
    inner_walls: tuple[Partition, ...] = ()

    def room(self, corners: Points) -> shapely.Polygon:
        """What an outline (n, 2) bounds, without the holes."""
        return shapely.Polygon(corners, [hole.vertices for hole in self.holes])

    def feet(self, corners: Points, points: Points) -> Points:
        """How many of the points (m, 2) hear each wall directly: the outline's, the holes', the inner ones.

        Holes hide a wall, inner walls do not. A round hole has four walls, its quarters.
        """
        room = self.room(corners)
        counts = [audible_feet(corners, points, room).sum(axis=0)]
        counts += [_quarter_feet(hole, points, room) if isinstance(hole, RoundHole)
                   else audible_feet(hole.vertices, points, room).sum(axis=0) for hole in self.holes]
        counts += [[sum(audible_feet(ends, points, room)[:, 0].sum() for ends in (
            np.array((wall.start, wall.end)), np.array((wall.end, wall.start))))] for wall in self.inner_walls]
        return np.concatenate(counts)


def _square_round(hole: RoundHole) -> Points:
    """Corners (4, 2) of the square round a hole, clockwise; its sides are before the hole's quarters."""
    turns = (0.75 - 0.5 * np.arange(4)) * np.pi
    return np.asarray(hole.centre + np.sqrt(2.0) * hole.radius_m * np.column_stack((np.cos(turns), np.sin(turns))))


def _quarter_feet(hole: RoundHole, points: Points, room: shapely.Polygon) -> Points:
    """How many of the points (m, 2) hear each quarter of a round hole (4,), in the order of `_square_round`'s sides."""
    away = points - hole.centre
    feet = hole.centre + hole.radius_m * _JUST_BEFORE * away / np.linalg.norm(away, axis=1)[:, None]
    heard = shapely.covers(room, shapely.linestrings(np.stack((points, feet), axis=1)))
    quarter = np.floor(np.mod(0.75 - np.arctan2(away[:, 1], away[:, 0]) / np.pi, 2.0) / 0.5).astype(int)
    return np.bincount(quarter[heard], minlength=4).astype(float)


class Tour:
    """Where to go next among holes: before a wall that few pings have heard so far.

    Parameters
    ----------
    corners : ndarray, shape (n, 2)
        The outline, counter-clockwise [m].
    inside : Inside
        What stands in it.
    generator : numpy.random.Generator
        Draws the places.
    feet : int
        How many pings are to hear each wall.
    """

    def __init__(self, corners: Points, inside: Inside, generator: np.random.Generator, feet: int) -> None:
        rings = [corners, *(_square_round(hole) if isinstance(hole, RoundHole) else hole.vertices
                            for hole in inside.holes)]
        self._starts, self._ends = np.vstack(rings), np.vstack([np.roll(ring, -1, axis=0) for ring in rings])
        self._corners, self._inside, self._generator, self._feet = corners, inside, generator, feet
        self._pings, self._heard = 0, np.zeros(len(self._starts))

    def __call__(self, poses: Sequence[tuple[float, float, float]]) -> Points:
        """Draw a place (2,) after the poses so far."""
        if len(poses) > self._pings:
            new = np.array(poses[self._pings:])[:, :2]
            self._heard += self._inside.feet(self._corners, new)[:len(self._heard)]
            self._pings = len(poses)
        lacking = np.maximum(self._feet - self._heard, 0.1)
        wall = self._generator.choice(len(lacking), p=lacking / lacking.sum())
        along = self._ends[wall] - self._starts[wall]
        inwards = np.array((-along[1], along[0])) / np.hypot(*along)
        share, away = self._generator.uniform((0.1, _BEFORE_M[0]), (0.9, _BEFORE_M[1]))
        return np.asarray(self._starts[wall] + share * along + away * inwards)


Draw: TypeAlias = Callable[[np.random.Generator, Points], Inside | None]
"""What stands inside corners (n, 2), counter-clockwise; None where the draw fails."""


def plate(generator: np.random.Generator) -> Points:
    """Corners (n, 2) of a convex plate of 3 to 6 edges, counter-clockwise [m]."""
    return random_room(generator, int(generator.integers(3, 7)), Recipe())[0]


def rectangles(count: int) -> Draw:
    """So many rectangular holes with sides of 0.15 to 0.4 m."""
    def drawn(generator: np.random.Generator, corners: Points) -> Inside | None:
        within = shapely.Polygon(corners).buffer(-_LEAST_GAP_M)
        shapes: list[shapely.Polygon] = []
        for _ in range(_HOLE_DRAWS):
            half, turn = 0.5 * generator.uniform(*_SIDES_M, 2), generator.uniform(0.0, 0.5 * np.pi)
            c, s = np.cos(turn), np.sin(turn)
            middle = generator.dirichlet(np.full(len(corners), 3.0)) @ corners
            shape = shapely.Polygon(middle + half * [(-1, -1), (-1, 1), (1, 1), (1, -1)] @ np.array([[c, s], [-s, c]]))
            if within.contains(shape) and all(shape.distance(other) > _LEAST_APART_M for other in shapes):
                shapes.append(shape)
                if len(shapes) == count:
                    return Inside(tuple(Hole(np.array(shape.exterior.coords)[:-1]) for shape in shapes))
        return None
    return drawn


def discs(count: int) -> Draw:
    """So many round holes of a diameter of 0.15 to 0.4 m."""
    def drawn(generator: np.random.Generator, corners: Points) -> Inside | None:
        outline = shapely.Polygon(corners)
        holes: list[RoundHole] = []
        for _ in range(_HOLE_DRAWS):
            radius_m = 0.5 * generator.uniform(*_SIDES_M)
            middle = generator.dirichlet(np.full(len(corners), 3.0)) @ corners
            apart = [np.hypot(*(middle - hole.centre)) - hole.radius_m - radius_m for hole in holes]
            if outline.buffer(-_LEAST_GAP_M - radius_m).contains(shapely.Point(middle)) and all(
                    gap > _LEAST_APART_M for gap in apart):
                holes.append(RoundHole(middle, radius_m))
                if len(holes) == count:
                    return Inside(tuple(holes))
        return None
    return drawn


def inner_wall(low_share: float, high_share: float) -> Draw:
    """A wall over a share, uniform between these, of a chord; of all of it, from wall to wall; else with free ends."""
    def drawn(generator: np.random.Generator, corners: Points) -> Inside | None:
        normals, offsets = half_planes(corners)
        middle, angle = generator.dirichlet(np.full(len(corners), 5.0)) @ corners, generator.uniform(0.0, np.pi)
        along = np.array((np.cos(angle), np.sin(angle)))
        with np.errstate(divide='ignore'):
            reach = (offsets - normals @ middle) / (normals @ along)
        low, high = reach[reach < 0.0].max(), reach[reach > 0.0].min()
        spare = (1.0 - generator.uniform(low_share, high_share)) * (high - low)
        before = generator.uniform(0.2, 0.8) * spare
        start, end = middle + (low + before) * along, middle + (high - (spare - before)) * along
        if not shapely.Polygon(corners).buffer(-_LEAST_GAP_M).contains(shapely.Point(0.5 * (start + end))):
            return None
        return Inside(inner_walls=(Partition(start, end, generator.uniform(*_REFLECTIONS)),))
    return drawn
