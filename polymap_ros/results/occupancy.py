"""The answer as an occupancy grid: interior free, walls occupied, outside and within holes unknown."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.cautions import Caution
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.estimate import Estimate

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
MAX_CELLS = 50_000_000
"""50 MB as an image and as a message: a place of 35 x 35 m in cells of 5 mm."""
_DECADES = 12


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


class CellSize(NamedTuple):
    """How large the cells of a map are [m], None where there is no map; and a warning where that is not as expected."""

    resolution_m: float | None
    caution: Caution | None = None


def occupancy(
    vertices: ArrayLike, resolution_m: float, margin_m: float, holes: Sequence[ArrayLike] = (),
    inner_walls: Sequence[ArrayLike] = (),
) -> Occupancy:
    """Draw a polygon into a grid.

    A cell is occupied where the boundary or an inner wall passes through it, so that no path of neighbouring free
    cells, not even a diagonal one, leaves the polygon or crosses a wall; free where its centre is inside, and in no
    hole.

    Parameters
    ----------
    vertices : array_like, shape (n, 2)
        Corners [m].
    resolution_m : float
        Cell size [m].
    margin_m : float
        Unknown border kept around the polygon [m].
    holes : sequence of array_like, shape (m, 2)
        Corners of each [m].
    inner_walls : sequence of array_like, shape (2, 2)
        Both ends of each [m].

    Raises
    ------
    ValueError
        Where the grid would have more than `MAX_CELLS` cells; `cell_size` finds a size that fits.
    """
    corners = np.asarray(vertices, dtype=float)
    if not cells_of(corners, resolution_m, margin_m) <= MAX_CELLS:
        raise ValueError(f'{resolution_m:g} m: more than {MAX_CELLS:.0e} cells')
    low, (columns, rows) = _frame(corners, resolution_m, margin_m)
    cells = np.full((int(rows), int(columns)), UNKNOWN, dtype=np.int8)
    rings = [np.asarray(ring, dtype=float) for ring in (corners, *holes)]
    boundary = np.concatenate([np.stack((ring, np.roll(ring, -1, axis=0)), axis=1) for ring in rings])
    scaled, inner = (np.asarray(each, dtype=float).reshape(-1, 2, 2) / resolution_m - low
                     for each in (boundary, inner_walls))
    cells[_inside(scaled, cells.shape)] = FREE
    for start, end in (*scaled, *inner):
        crossed = _crossed(start, end)
        column, row = crossed[np.all((crossed >= 0) & (crossed < (columns, rows)), axis=1)].T
        cells[row, column] = OCCUPIED
    return Occupancy(cells, (float(low[0] * resolution_m), float(low[1] * resolution_m)), resolution_m)


def occupancy_of(estimate: Estimate, parameters: Parameters) -> Occupancy | None:
    """Draw the grid of an answer that the ``map`` parameters ask for; None without a polygon, or where too large."""
    if estimate.polygon is None:
        return None
    vertices = estimate.polygon.vertices
    resolution_m = cell_size(vertices, parameters).resolution_m
    return None if resolution_m is None else occupancy(
        vertices, resolution_m, parameters.map.margin_m, [hole.vertices for hole in estimate.holes],
        [tuple(wall.ends) for wall in estimate.inner_walls])


def cell_size(vertices: ArrayLike, parameters: Parameters) -> CellSize:
    """Return the size of the cells that the ``map`` parameters ask for, for a polygon.

    By itself it is ``grid.range_step_m``, or 2, 5, 10, 20, ... times that where the map would have more than
    `MAX_CELLS` cells.
    """
    corners = np.asarray(vertices, dtype=float)
    given_m, usual_m, margin_m = parameters.map.resolution_m, parameters.grid.range_step_m, parameters.map.margin_m
    wanted_m = given_m or usual_m
    sizes_m = (usual_m * digit * 10.0**power for power in range(_DECADES) for digit in (1.0, 2.0, 5.0))
    fits = (size_m for size_m in sizes_m if cells_of(corners, size_m, margin_m) <= MAX_CELLS)
    cells = cells_of(corners, wanted_m, margin_m)
    if cells <= MAX_CELLS:
        return CellSize(wanted_m)
    chosen_m = next(fits, None)
    width_m, height_m = np.ptp(corners, axis=0)
    place, most = f'a place of {width_m:.4g} x {height_m:.4g} m', f'a map has {MAX_CELLS:.0e} at most'
    if given_m or chosen_m is None:
        remedy = 'judge by the vertices whether that is a place' if chosen_m is None else (
            f'set map.resolution_m to {chosen_m:g}, or to 0, which chooses it by itself')
        return CellSize(None, Caution(
            'map_too_large', f'there is no map: {place} has {cells:.2g} cells of {wanted_m:g} m, and {most}', remedy))
    return CellSize(chosen_m, Caution('map_coarse', (
        f'the cells of the map are {chosen_m:g} m wide, not {usual_m:g} m (grid.range_step_m), as {place} has '
        f'{cells:.2g} of those, and {most}')))


def cells_of(corners: NDArray[np.float64], resolution_m: float, margin_m: float) -> float:
    """Return the number of cells of a grid around corners; infinite or not a number where they are."""
    with np.errstate(over='ignore', invalid='ignore'):
        _, (columns, rows) = _frame(corners, resolution_m, margin_m)
        return float(columns * rows)


def _frame(
    corners: NDArray[np.float64], resolution_m: float, margin_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest cell, and the number of columns and rows."""
    low = np.floor((corners.min(axis=0) - margin_m) / resolution_m)
    high = np.ceil((corners.max(axis=0) + margin_m) / resolution_m)
    return low, high - low + 1.0


def _inside(edges: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Cells whose centre is inside: those with an odd number of edges (n, 2, 2) left of it, in units of cells."""
    inside = np.zeros(shape, dtype=bool)
    x = np.arange(shape[1]) + 0.5
    for start, end in edges:
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
