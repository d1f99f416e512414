"""The polygon as an occupancy grid: interior free, boundary occupied, outside unknown."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.errors import ParameterError
from polymap_ros.parameters import Parameters

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
MAX_CELLS = 50_000_000


class Occupancy(NamedTuple):
    """An occupancy grid.

    Parameters
    ----------
    cells : ndarray, shape (rows, columns), int8
        0 free, 100 occupied, -1 unknown; row 0 at the smallest y.
    origin : tuple of float
        x and y of the outer corner of cell (0, 0) [m], a whole multiple of the resolution.
    resolution_m : float
        Cell size [m].
    """

    cells: NDArray[np.int8]
    origin: tuple[float, float]
    resolution_m: float


def occupancy(vertices: ArrayLike, resolution_m: float, margin_m: float) -> Occupancy:
    """Draw a polygon into a grid.

    A cell is occupied where the boundary passes through it, so that no path of neighbouring free cells, not even
    a diagonal one, leaves the polygon; free where its centre is inside.

    Parameters
    ----------
    vertices : array_like, shape (n, 2)
        Corners [m].
    resolution_m : float
        Cell size [m].
    margin_m : float
        Unknown border kept around the polygon [m].

    Raises
    ------
    ParameterError
        Where the grid would have more than `MAX_CELLS` cells.
    """
    corners = np.asarray(vertices, dtype=float)
    low = np.floor((corners.min(axis=0) - margin_m) / resolution_m)
    high = np.ceil((corners.max(axis=0) + margin_m) / resolution_m)
    columns, rows = high - low + 1.0
    if not columns * rows <= MAX_CELLS:
        raise ParameterError('map.resolution_m', f'{resolution_m!r} makes a map of {columns * rows:.3g} cells; '
                                                 f'allowed: up to {MAX_CELLS:.0e}')
    cells = np.full((int(rows), int(columns)), UNKNOWN, dtype=np.int8)
    scaled = corners / resolution_m - low
    cells[_inside(scaled, cells.shape)] = FREE
    for start, end in zip(scaled, np.roll(scaled, -1, axis=0), strict=True):
        for column, row in _crossed(start, end):
            cells[row, column] = OCCUPIED
    return Occupancy(cells, (float(low[0] * resolution_m), float(low[1] * resolution_m)), resolution_m)


def occupancy_of(vertices: ArrayLike, parameters: Parameters) -> Occupancy:
    """The grid that the ``map`` parameters ask for."""
    return occupancy(vertices, parameters.map.resolution_m or parameters.grid.range_step_m, parameters.map.margin_m)


def _inside(corners: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Cells whose centre is inside: those with an odd number of edges to the left of it, in units of cells."""
    inside = np.zeros(shape, dtype=bool)
    x = np.arange(shape[1]) + 0.5
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        first, last = (int(np.ceil(height - 0.5)) for height in sorted((start[1], end[1])))
        share = (np.arange(first, last) + 0.5 - start[1]) / (end[1] - start[1]) if last > first else np.empty(0)
        inside[first:last] ^= x > (start[0] + share * (end[0] - start[0]))[:, None]
    return inside


def _crossed(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.int64]:
    """Cells (m, 2) that a segment passes through, in units of cells; at a cell corner all that meet there."""
    along = end - start
    times = [np.array([0.0, 1.0])]
    for axis in (0, 1):
        first, last = sorted((start[axis], end[axis]))
        lines = np.arange(np.ceil(first), np.floor(last) + 1.0)
        if along[axis] != 0.0:
            times.append((lines - start[axis]) / along[axis])
    ordered = np.unique(np.clip(np.concatenate(times), 0.0, 1.0))
    middles = start + 0.5 * (ordered[:-1] + ordered[1:])[:, None] * along
    touches = start + ordered[:, None] * along
    nudge = 1e-6 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    around = (touches[:, None, :] + nudge).reshape(-1, 2)
    cells: NDArray[np.int64] = np.floor(np.concatenate([middles, around])).astype(np.int64)
    return cells
