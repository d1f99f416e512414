"""Where all pings were used, in bounded memory."""

import copy

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import FARTHEST_M
from polymap_ros.packing import whole_number

MOST = 4096
"""Rows kept: nearly seven minutes at 10 Hz before the first two pings share one."""

_LEAST_CELL_M = 1e-6


class Places:
    """The sensor's positions in the start frame; those in one cell of a grid share a row once there are too many.

    Of the pings in a cell, the first stands for all. The cells double as often as it takes to halve the rows.

    Attributes
    ----------
    count : int
        Pings.
    last_ns : int
        Stamp of the last of them [ns]; 0 while there is none.
    """

    def __init__(self) -> None:
        self.count = self.last_ns = 0
        self._cell_m = 0.0
        self._rows = np.empty((MOST, 3))
        self._used = 0

    def copy(self) -> 'Places':
        """The same places, to go on from apart."""
        twin = copy.copy(self)
        twin._rows = self._rows.copy()
        return twin

    def add(self, stamp_ns: int, x: float, y: float) -> None:
        """Add a ping by its stamp [ns] and position [m]."""
        if self._used == MOST:
            self._merge()
        self._rows[self._used] = x, y, 1.0
        self._used += 1
        self.count += 1
        self.last_ns = stamp_ns

    @property
    def positions(self) -> NDArray[np.float64]:
        """Positions (n, 2) [m] in the order of time, n <= `MOST`; a copy."""
        return self._rows[:self._used, :2].copy()

    @property
    def pings(self) -> NDArray[np.int64]:
        """How many pings each of the positions stands for, (n,)."""
        return self._rows[:self._used, 2].astype(np.int64)

    def _merge(self) -> None:
        rows = self._rows[:self._used]
        self._cell_m = self._cell_m or max(float(np.ptp(rows[:, :2], axis=0).max()) / MOST, _LEAST_CELL_M)
        while len(rows) > MOST // 2:
            column, row = np.floor(rows[:, :2] / self._cell_m).T
            _, first, cell = np.unique(column + 1j * row, return_index=True, return_inverse=True)
            order = np.argsort(first)
            rows = np.column_stack((rows[first, :2], np.bincount(cell.ravel(), rows[:, 2]))).astype(float)[order]
            if len(rows) > MOST // 2:
                self._cell_m *= 2.0
        self._used = len(rows)
        self._rows[:self._used] = rows

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {'rows': self._rows[:self._used].copy(), 'cell_m': np.array(self._cell_m),
                'last_ns': np.array(self.last_ns, np.int64)}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        rows, cell_m = np.asarray(state['rows'], float), float(state['cell_m'])
        if rows.ndim != 2 or rows.shape[1] != 3 or len(rows) > MOST:
            raise StateError(f'the places have shape {rows.shape}; allowed: at most {MOST} rows of 3')
        if not (np.all(np.abs(rows[:, :2]) <= 2.0 * FARTHEST_M) and np.all(rows[:, 2] >= 1.0)
                and rows[:, 2].sum() < 2.0**53 and 0.0 <= cell_m <= FARTHEST_M):
            raise StateError('the places are not those of a sensor')
        self._rows[:len(rows)], self._used, self._cell_m = rows, len(rows), cell_m
        self.count, self.last_ns = int(rows[:, 2].sum()), whole_number(state['last_ns'], -2**62)
