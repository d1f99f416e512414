"""A_T as a grid of probabilities, in the spirit of [11] of the paper: a few wrong ranges do not spoil it."""

import copy
from math import hypot

import numpy as np
import scipy.ndimage
import shapely
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.maps.free_area import FreeArea

_PRIOR = float(np.log(9.0))
"""A cell that nothing is known of counts as free with a probability of one in ten, ..."""

_RING = 0.5
"""... and the closest range is the cell's own by so much in log odds: somewhere on that circle the wall begins."""

_SPARE_CELLS = 64
"""Cells by which the grid grows beyond what is needed."""

_MAX_CELLS = 4_000_000
"""A larger grid gets cells of twice the size."""


class FreeGrid(FreeArea):
    """Log odds that a wall is in a cell, in the start frame.

    A ping of closest range rho says of every cell nearer than that, that either it is free or its echo was missed. So
    the log odds fall by log(1 / missed) there, and rise a little on the circle itself. Free is what is free with more
    than even odds, and connected with the sensor's path. Pings from one and the same cell count once: what is not heard
    from there is not heard again.

    Parameters
    ----------
    cell_m : float
        Size of a cell [m]; it doubles as often as it has to.
    missed : float
        Probability that a first echo is missed.
    """

    def __init__(self, cell_m: float, missed: float) -> None:
        super().__init__()
        self._cell, self._vote = cell_m, float(np.log(missed))
        self._odds = np.zeros((0, 0), np.float32)
        self._corner = np.zeros(2, np.int64)
        self._visited = np.zeros((0, 0), np.bool_)
        self._last = (np.nan, np.nan)

    def copy(self) -> 'FreeGrid':
        """A grid of its own with the same cells."""
        twin = copy.copy(self)
        twin._odds, twin._visited = self._odds.copy(), self._visited.copy()
        return twin

    def add(self, x: float, y: float, rho: float, confidence: float = 1.0) -> None:
        """Take the closest range of one ping [m] in; nan says nothing."""
        if not rho > 0.0 or hypot(x - self._last[0], y - self._last[1]) < self._cell:
            return
        self._last, self._region = (x, y), None
        place = np.array((x, y))
        self._make_room(place - rho, place + rho)
        column, row = self._cells(place) - self._corner
        self._visited[row, column] = True
        low, high = self._cells(place - rho) - self._corner, self._cells(place + rho) + 1 - self._corner
        along, across = ((np.arange(low[k], high[k]) + self._corner[k] + 0.5) * self._cell - place[k] for k in (0, 1))
        away = np.hypot(along, across[:, None]) - rho
        part = self._odds[low[1]:high[1], low[0]:high[0]]
        part[away < -0.5 * self._cell] += self._vote
        part[np.abs(away) <= 0.5 * self._cell] += _RING * confidence

    @property
    def probability(self) -> tuple[NDArray[np.float64], tuple[float, float], float]:
        """Probability that a cell is free (ny, nx), lower left corner and size of a cell [m]."""
        x, y = (self._corner * self._cell).tolist()
        return 1.0 / (1.0 + np.exp(self._odds.astype(float) + _PRIOR)), (x, y), self._cell

    def _cells(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Cells that points are in, counted from the start frame's origin."""
        return np.asarray(np.floor(points / self._cell), dtype=np.int64)

    def _make_room(self, low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> None:
        """Grow to hold what is between two corners, with coarser cells where there would be too many."""
        first, last = self._cells(low_m), self._cells(high_m) + 1
        before = np.array(self._odds.shape[::-1], np.int64)
        if self._odds.size:
            first, last = np.minimum(first, self._corner), np.maximum(last, self._corner + before)
            if np.all(first == self._corner) and np.all(last == self._corner + before):
                return
        first = (first - _SPARE_CELLS) // 2 * 2
        size = (last + _SPARE_CELLS - first + 1) // 2 * 2
        odds = np.zeros((int(size[1]), int(size[0])), np.float32)
        visited = np.zeros(odds.shape, np.bool_)
        x, y = self._corner - first
        odds[y:y + before[1], x:x + before[0]] = self._odds
        visited[y:y + before[1], x:x + before[0]] = self._visited
        self._odds, self._visited, self._corner = odds, visited, first
        if odds.size > _MAX_CELLS:
            fours = size[1] // 2, 2, size[0] // 2, 2
            self._odds = odds.reshape(fours).mean(axis=(1, 3))
            self._visited = visited.reshape(fours).max(axis=(1, 3))
            self._corner, self._cell = first // 2, 2.0 * self._cell
            self._make_room(low_m, high_m)

    def _with_discs(self) -> shapely.Geometry:
        """The free cells that are connected with the path."""
        if not self._visited.any():
            return shapely.Polygon()
        labels, _ = scipy.ndimage.label(self._odds + _PRIOR < 0.0)
        visited = np.unique(labels[self._visited])
        free = np.isin(labels, visited[visited > 0])
        edge = np.diff(np.pad(free, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        (row, left), (_, right) = np.nonzero(edge == 1), np.nonzero(edge == -1)
        x0, y0 = self._corner
        runs = shapely.box(*(self._cell * side for side in (x0 + left, y0 + row, x0 + right, y0 + row + 1)))
        united = shapely.union_all(runs).simplify(0.6 * self._cell)
        return united if united.geom_type in ('Polygon', 'MultiPolygon') else shapely.Polygon()

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {'odds': self._odds, 'corner': self._corner, 'cell': np.array(self._cell),
                'visited': self._visited, 'last': np.array(self._last)}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        odds, corner = np.asarray(state['odds'], np.float32), np.asarray(state['corner'], np.int64)
        visited, last, cell = np.asarray(state['visited'], np.bool_), np.asarray(state['last']), float(state['cell'])
        if odds.ndim != 2 or corner.shape != (2,) or visited.shape != odds.shape or last.shape != (2,):
            raise StateError('the free area is no grid')
        if not (np.all(np.isfinite(odds)) and 0.0 < cell < np.inf):
            raise StateError('the free area is no grid of finite numbers')
        self._odds, self._visited, self._corner, self._cell = odds.copy(), visited.copy(), corner, cell
        self._last, self._region = (float(last[0]), float(last[1])), None


def make_free_area(model: str, cell_m: float, missed: float) -> FreeArea:
    """The free area of the model that `free_area.model` names."""
    return FreeGrid(cell_m, missed) if model == 'grid' else FreeArea()
