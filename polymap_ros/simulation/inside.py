"""What stands inside a scene's outline: holes, and walls that let some of the wave through; nothing by default."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from polymap_ros.errors import SceneError
from polymap_ros.simulation.corners import clockwise

_ROUNDING_M = 1e-9
"""As near as this is the same place [m]."""

_ROUND_CORNERS = 64
"""Corners of the polygon in the place of a circle: it is within 0.08 % of the radius."""


@dataclass(frozen=True, eq=False)
class Hole:
    """A hole in a plate, or a column in a room.

    Parameters
    ----------
    vertices : array_like, shape (n, 2)
        Corners of a simple polygon [m], in either direction; kept clockwise, so that the room is on the left of its
        edges.
    reflection : array_like, shape (n,), or float
        Reflection coefficient of each edge, signed.

    Raises
    ------
    SceneError
        As `corners.counter_clockwise`.
    """

    vertices: NDArray[np.float64]
    reflection: ArrayLike = 1.0

    def __post_init__(self) -> None:
        for name, value in zip(('vertices', 'reflection'), clockwise(self.vertices, self.reflection), strict=True):
            object.__setattr__(self, name, value)


@dataclass(frozen=True, eq=False)
class RoundHole:
    """A round hole in a plate, or a pillar in a room.

    Parameters
    ----------
    centre : array_like, shape (2,)
        Its middle [m].
    radius_m : float
        Radius [m].
    reflection : float
        Reflection coefficient of its edge, signed.

    Raises
    ------
    SceneError
        For a centre that is no finite pair, a radius that is not above 0, and a coefficient beyond -1 to 1.
    """

    centre: NDArray[np.float64]
    radius_m: float
    reflection: float = 1.0

    def __post_init__(self) -> None:
        centre = np.asarray(self.centre, dtype=float)
        if centre.shape != (2,) or not np.isfinite(centre).all():
            raise SceneError('centre must be a finite pair [x, y]')
        if not _ROUNDING_M < self.radius_m < np.inf:
            raise SceneError(f'radius_m must be above 0, found {self.radius_m!r}')
        if np.ndim(self.reflection) or not abs(self.reflection) <= 1.0:
            raise SceneError(f'reflection of a round hole must be one number from -1 to 1, found {self.reflection!r}')
        object.__setattr__(self, 'centre', centre)

    @property
    def vertices(self) -> NDArray[np.float64]:
        """Corners (n, 2) of a regular polygon of the same area, clockwise [m]: for pictures and ways, no echoes."""
        turns = -2.0 * np.pi * np.arange(_ROUND_CORNERS) / _ROUND_CORNERS
        reach = self.radius_m * np.sqrt(-turns[1] / np.sin(-turns[1]))
        return np.asarray(self.centre + reach * np.column_stack((np.cos(turns), np.sin(turns))))


@dataclass(frozen=True, eq=False)
class Partition:
    """A straight wall that reflects on both sides and lets some of the wave through: a stiffener, a weld seam.

    Parameters
    ----------
    start, end : array_like, shape (2,)
        Its ends [m].
    reflection : float
        What it reflects of the amplitude, signed, with a magnitude of 1 at most.
    transmission : float, optional
        What crosses it of the amplitude, from 0 to 1: sqrt(1 - reflection^2) unless given, so that no energy is lost.

    Raises
    ------
    SceneError
        For ends that are one place or no finite pairs, and for coefficients beyond these.
    """

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    reflection: float
    transmission: float | None = None

    def __post_init__(self) -> None:
        for name in ('start', 'end'):
            place = np.asarray(getattr(self, name), dtype=float)
            if place.shape != (2,) or not np.isfinite(place).all():
                raise SceneError(f'{name} must be a finite pair [x, y]')
            object.__setattr__(self, name, place)
        if np.hypot(*(self.end - self.start)) <= _ROUNDING_M:
            raise SceneError('start and end are one place; give it a length')
        if not abs(self.reflection) <= 1.0:
            raise SceneError(f'reflection must be from -1 to 1, found {self.reflection!r}')
        if self.transmission is None:
            object.__setattr__(self, 'transmission', math.sqrt(1.0 - self.reflection**2))
        elif not 0.0 <= self.transmission <= 1.0:
            raise SceneError(f'transmission must be from 0 to 1, found {self.transmission!r}')


def holes_of(
    vertices: NDArray[np.float64], holes: Sequence[Hole | RoundHole | ArrayLike]
) -> tuple[Hole | RoundHole, ...]:
    """Return the holes in an outline (n, 2), each given as such or by its corners.

    Raises
    ------
    SceneError
        For one that is no simple polygon, is not inside, or meets the outline or another.
    """
    outline, found, shapes = shapely.Polygon(vertices), list[Hole | RoundHole](), list[shapely.Polygon]()
    for index, given in enumerate(holes):
        with named(f'holes[{index}]'):
            hole = given if isinstance(given, Hole | RoundHole) else Hole(np.asarray(given, dtype=float))
            shape = shapely.Polygon(hole.vertices)
            if not outline.contains(shape) or shape.distance(outline.exterior) <= _ROUNDING_M:
                raise SceneError('is not inside the outline, or meets it; move it, or make it a part of vertices')
            for other, known in enumerate(shapes):
                if shape.distance(known) <= _ROUNDING_M:
                    raise SceneError(f'meets holes[{other}]; move one of them, or make them one')
        found.append(hole)
        shapes.append(shape)
    return tuple(found)


def partitions_of(
    vertices: NDArray[np.float64], holes: Sequence[Hole | RoundHole], partitions: Sequence[Partition]
) -> tuple[Partition, ...]:
    """Return walls cut off where they leave an outline (n, 2) with these holes.

    Raises
    ------
    SceneError
        For one that is not inside, is there in several parts, or lies on an edge.
    """
    room = shapely.Polygon(vertices, [hole.vertices for hole in holes])
    within, found = room.buffer(_ROUNDING_M), []
    for index, wall in enumerate(partitions):
        line = shapely.LineString((wall.start, wall.end))
        with named(f'inner_walls[{index}]'):
            if line.intersection(room.boundary.buffer(_ROUNDING_M)).length > 0.5 * line.length:
                raise SceneError('lies on an edge of the outline or of a hole; give that another reflection instead')
            if not within.covers(line):
                part = room.intersection(line)
                if part.geom_type != 'LineString' or part.length <= _ROUNDING_M:
                    raise SceneError('is not inside in one piece; give the parts that are, one by one')
                ends = np.array(part.coords)
                order = np.argsort(ends @ (wall.end - wall.start))  # along the wall as it was given
                wall = Partition(ends[order[0]], ends[order[-1]], wall.reflection, wall.transmission)
        found.append(wall)
    return tuple(found)


def check_apart(
    positions: NDArray[np.float64], holes: Sequence[Hole | RoundHole], partitions: Sequence[Partition]
) -> None:
    """Raise `SceneError` where a place of a sensor (T, 2) is in a hole or on an inner wall."""
    places = shapely.points(positions)
    for name, shapes in (('holes', [shapely.Polygon(hole.vertices) for hole in holes]),
                         ('inner_walls', [shapely.LineString((wall.start, wall.end)) for wall in partitions])):
        for index, shape in enumerate(shapes):
            met = np.flatnonzero(shapely.distance(places, shape) <= _ROUNDING_M)
            if len(met):
                where = 'in' if name == 'holes' else 'on'
                raise SceneError(f'the sensor is {where} {name}[{index}] at pose {met[0]}; move one of the two')


@contextmanager
def named(key: str) -> Iterator[None]:
    """Let errors of a scene name the key that they are about."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f'{key}: {error}') from error
