"""A_T: the area that no wall crosses, the union of the discs of radius rho_i about the sensor's positions."""

import copy

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from polymap_ros.errors import StateError
from polymap_ros.geometry.overlap import Region
from polymap_ros.geometry.pose import FARTHEST_M

QUADRANT_SEGMENTS = 16
"""A disc is an inscribed polygon of 64 corners: 0.16 % smaller in area, while eq. (10) asks for 1 %."""

_INNER = float(np.cos(np.pi / (4 * QUADRANT_SEGMENTS)))
"""Radius of the largest circle within such a polygon, as a share of the disc's."""

_LEAST_M = 1e-6
"""Radius of a disc at least: a range axis has no finer step, and GEOS makes no disc of the smallest numbers."""

_BLOCK = 64
"""Discs united at a time. The same discs in the same order give the same shape, whenever it is looked at."""


class FreeArea:
    """The union of discs, in the start frame.

    A disc whose `_INNER` circle is within those united before adds nothing but slivers, and is left out: else they
    would grow in number with every round of the same path.
    """

    def __init__(self) -> None:
        self._united: shapely.Geometry = shapely.Polygon()
        self._discs: list[tuple[float, float, float]] = []
        self._region: Region | None = None
        self._shape: shapely.Geometry = self._united

    def add(self, x: float, y: float, rho: float, confidence: float = 1.0) -> None:
        """Add the disc of one ping [m]; a ping without a closest range (nan) adds none. Confidence does not matter."""
        if not rho >= _LEAST_M:
            return
        self._discs.append((x, y, rho))
        self._region = None
        if len(self._discs) == _BLOCK:
            self._united, self._discs = self._with_discs(), []

    def copy(self) -> 'FreeArea':
        """An area of its own of the same discs."""
        twin = copy.copy(self)
        twin._discs = list(self._discs)
        return twin

    @property
    def shape(self) -> shapely.Geometry:
        """A_T as a shapely polygon or multipolygon."""
        self._update()
        return self._shape

    @property
    def region(self) -> Region:
        """A_T at this moment, for repeated overlaps; later discs do not change it."""
        return self._update()

    @property
    def area(self) -> float:
        """Area of A_T [m2]."""
        return self.region.area

    def iou(self, vertices: ArrayLike) -> float:
        """IoU of A_T with a counter-clockwise polygon (n, 2), the second term of eq. (5)."""
        return self.region.iou(vertices)

    def _update(self) -> Region:
        if self._region is None:
            self._shape = self._with_discs()
            self._region = Region(self._shape)
        return self._region

    def _with_discs(self) -> shapely.Geometry:
        if not self._discs:
            return self._united
        x, y, rho = np.array(self._discs).T
        centres, edge = shapely.points(x, y), self._united.boundary
        shapely.prepare(edge)
        new = shapely.dwithin(edge, centres, _INNER * rho) | ~shapely.contains(self._united, centres)
        discs = shapely.buffer(centres[new], rho[new], quad_segs=QUADRANT_SEGMENTS)
        return shapely.union_all([self._united, *discs]) if new.any() else self._united

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {
            'united': np.frombuffer(shapely.to_wkb(self._united), np.uint8),
            'discs': np.array(self._discs, dtype=float).reshape(-1, 3),
        }

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        discs = np.asarray(state['discs'], float)
        try:
            united = shapely.from_wkb(np.asarray(state['united'], np.uint8).tobytes())
        except (shapely.errors.ShapelyError, NotImplementedError) as error:  # the latter for arcs, which GEOS may know
            raise StateError(f'the free area cannot be read: {error}') from error
        sound = united.geom_type in ('Polygon', 'MultiPolygon') and united.is_valid
        if not sound or discs.ndim != 2 or discs.shape[1] != 3 or not np.all(np.isfinite(discs)):
            raise StateError('the free area is not made of polygons and discs')
        sizes = np.abs(np.concatenate((discs.ravel(), shapely.get_coordinates(united).ravel())))
        if np.any(discs[:, 2] < _LEAST_M) or sizes.max(initial=0.0) > 3.0 * FARTHEST_M:
            raise StateError('the free area holds discs or corners of a size that no echo has')
        self._united, self._discs, self._region = united, [tuple(row) for row in discs.tolist()], None
