"""Eq. (4): the likelihood of a wall at every (r, theta), updated ping by ping."""

import copy

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import ParameterError, StateError
from polymap_ros.jit import kernel
from polymap_ros.map_parameters import GridParameters
from polymap_ros.packing import whole_number

_BLOCK = 64
"""Pings summed in float32 before they are moved to the float64 total: the rounding error of a sum stays below
2e-6 of it however many pings there are, at one more pass over the map in 64."""

_END_OF_AXIS = 1e-6
"""Share of a step by which an end of an axis may miss a multiple of the step."""

_WHOLE = 1e-9
"""A shift this near to a whole number of cells is one: rounding must not cut off the end of the range axis."""


class BeamformingMap:
    r"""L_T(r, theta) = sum_i e_i(d_i(r, theta)), d_i = \|x_i cos(theta) + y_i sin(theta) - r\|, of eq. (4).

    The map is stored theta by theta. With the envelope mirrored about 0, e(-d) = e(d), a ping adds at one theta a
    piece of the mirrored envelope shifted by p = x cos(theta) + y sin(theta); linear interpolation makes that the
    weighted sum of two pieces one cell apart, both contiguous. Beyond the end of the range axis a ping adds 0.

    Parameters
    ----------
    grid : GridParameters
        Ranges are 0, step, ... up to `range_max_m`; angles are multiples of `angle_step_deg` in
        [`angle_min_deg`, `angle_max_deg`).

    Attributes
    ----------
    r_m : ndarray, shape (n_r,)
        Range axis [m].
    theta_rad : ndarray, shape (n_theta,)
        Angle axis [rad].
    full_circle : bool
        Whether the angle axis closes upon itself.
    count : int
        Pings added.
    """

    def __init__(self, grid: GridParameters) -> None:
        n_r = int(grid.range_max_m / grid.range_step_m + _END_OF_AXIS) + 1
        self.r_m: NDArray[np.float64] = np.arange(n_r, dtype=float) * grid.range_step_m
        first, end = (int(np.ceil(angle / grid.angle_step_deg - _END_OF_AXIS))
                      for angle in (grid.angle_min_deg, grid.angle_max_deg))
        if first >= end:
            raise ParameterError('grid.angle_step_deg', f'{grid.angle_step_deg!r} leaves no angle from '
                                 f'grid.angle_min_deg ({grid.angle_min_deg!r}) to grid.angle_max_deg '
                                 f'({grid.angle_max_deg!r})')
        self.theta_rad: NDArray[np.float64] = np.deg2rad(np.arange(first, end, dtype=float) * grid.angle_step_deg)
        self.full_circle = grid.angle_max_deg - grid.angle_min_deg >= 360.0
        self.count = 0
        self._step = grid.range_step_m
        self._cos, self._sin = np.cos(self.theta_rad), np.sin(self.theta_rad)
        shape = len(self.theta_rad), len(self.r_m)
        self._total = np.zeros(shape)
        self._recent = np.zeros(shape, dtype=np.float32)
        self._mirrored = np.zeros(2 * shape[1], dtype=np.float32)

    def add(self, x: float, y: float, envelope: NDArray[np.float32]) -> None:
        """Add one ping: the sensor's position [m] and its envelope, shape (n_r,)."""
        n = len(self.r_m)
        self._mirrored[n:] = envelope
        self._mirrored[1:n] = envelope[:0:-1]
        _add_mirrored(self._recent, self._mirrored, (x * self._cos + y * self._sin) / self._step)
        self.count += 1
        if self.count % _BLOCK == 0:
            self._total += self._recent
            self._recent[:] = 0.0

    def copy(self) -> 'BeamformingMap':
        """A map of its own with the same pings."""
        twin = copy.copy(self)
        twin._total, twin._recent, twin._mirrored = self._total.copy(), self._recent.copy(), self._mirrored.copy()
        return twin

    @property
    def values(self) -> NDArray[np.float32]:
        """The map L_T, shape (n_theta, n_r); a copy."""
        return (self._total + self._recent).astype(np.float32)

    def normalised(self) -> NDArray[np.float32]:
        """The map divided by its maximum, as eq. (5) takes it; all zero where nothing was heard."""
        values = self.values
        peak = values.max()
        return values / peak if peak > 0.0 else values

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {'total': self._total.copy(), 'recent': self._recent.copy(), 'count': np.array(self.count)}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        total, recent = np.array(state['total'], np.float64), np.array(state['recent'], np.float32)
        if total.shape != self._total.shape or recent.shape != self._recent.shape:
            raise StateError(f'the beamforming map has {total.shape} cells; the grid has {self._total.shape}')
        if not (np.all(np.isfinite(total)) and np.all(np.isfinite(recent))):
            raise StateError('the beamforming map is not finite')
        self._total, self._recent, self.count = total, recent, whole_number(state['count'])


@kernel
def _add_mirrored(
    values: NDArray[np.float32], mirrored: NDArray[np.float32], shifts: NDArray[np.float64]
) -> None:
    """Add to every row the mirrored envelope (0, e[n-1], ..., e[1], e[0], ..., e[n-1]) shifted by `shifts` cells."""
    n = values.shape[1]
    for i in range(values.shape[0]):
        if not abs(shifts[i]) < 2 * n:
            continue
        whole = int(np.floor(shifts[i] + _WHOLE))
        share = shifts[i] - whole if shifts[i] - whole > _WHOLE else 0.0
        # Cell j lies at j - shift on the envelope's axis, between j - whole - 1 and j - whole; both must be on it.
        start = max(0, whole - n + (2 if share > 0.0 else 1))
        stop = min(n, whole + n)
        if start < stop:
            near, far = np.float32(1.0 - share), np.float32(share)
            row = values[i, start:stop]
            right = mirrored[start - whole + n:stop - whole + n]
            left = mirrored[start - whole + n - 1:stop - whole + n - 1]
            for j in range(row.size):
                row[j] += near * right[j] + far * left[j]
