"""The maximum of a smooth function of a few parameters, and how sharp it is."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar('T')

_CLIMBS = 20
_SMALLER = 3.0
"""Factor by which the stencil shrinks once the maximum is inside of it."""

_SHRINKS = 1

_FLAT = 1e-6
"""What a function falls at least over a step to either side of a maximum: less is rounding."""


@dataclass(frozen=True, eq=False)
class Peak(Generic[T]):
    """Where the function is largest, its value and what it answered with there.

    `curvature` (n, n) is the matrix of its second derivatives, from the last stencil on which it was that of a maximum;
    zero if it never was.
    """

    at: NDArray[np.float64]
    value: float
    found: T
    curvature: NDArray[np.float64]

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Inverse of the negative curvature of a log likelihood; None where there is none."""
        if not np.any(self.curvature):
            return None
        scale = 1.0 / np.sqrt(-np.diag(self.curvature))
        scaled = -self.curvature * np.outer(scale, scale)
        return np.asarray(np.linalg.inv(scaled) * np.outer(scale, scale))


def ascend(
    function: Callable[[NDArray[np.float64]], float], start: NDArray[np.float64], step: NDArray[np.float64],
    finest: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The maximum of a function that need not be smooth: steps along the axes, halved where none leads up."""
    at, step, value = np.array(start, float), np.array(step, float), function(start)
    while np.any(step > finest):
        moved = False
        for axis in range(len(at)):
            for side in (-1.0, 1.0):
                there = at + side * step * (np.arange(len(at)) == axis)
                if (other := function(there)) > value:
                    at, value, moved = there, other, True
                    break
        if not moved:
            step = step / 2.0
    return at


def highest(
    function: Callable[[NDArray[np.float64], T], tuple[float, T]], start: NDArray[np.float64], found: T,
    step: NDArray[np.float64],
) -> Peak[T]:
    """Newton's method on differences, which shrink as the maximum is closed in.

    Parameters
    ----------
    function : callable
        Value at a point and what was found there, from what was found nearby.
    start : ndarray, shape (n,)
        Where to begin.
    found : T
        What the first call starts from.
    step : ndarray, shape (n,)
        Step of the differences: a share of the maximum's width.
    """
    at, step = np.array(start, float), np.array(step, float)
    size = len(at)
    value, found = function(at, found)
    curvature = np.zeros((size, size))
    shrinks = 0
    for _ in range(_CLIMBS):
        best = value, at, found
        sides = np.empty((size, 2))
        for i in range(size):
            for side in (0, 1):
                there = at + (2 * side - 1) * step * (np.arange(size) == i)
                sides[i, side], other = function(there, found)
                best = max(best, (float(sides[i, side]), there, other), key=lambda entry: entry[0])
        slope = 0.5 * (sides[:, 1] - sides[:, 0])
        bend = np.diag(sides.sum(axis=1) - 2.0 * value)
        for i in range(size):
            for j in range(i):
                there = at + step * ((np.arange(size) == i) | (np.arange(size) == j))
                corner, other = function(there, found)
                best = max(best, (corner, there, other), key=lambda entry: entry[0])
                bend[i, j] = bend[j, i] = corner - sides[i, 1] - sides[j, 1] + value
        if np.linalg.eigvalsh(bend)[-1] < -_FLAT:
            curvature = bend / np.outer(step, step)
            there = at - step * np.clip(np.linalg.solve(bend, slope), -2.0, 2.0)
            top, other = function(there, found)
            best = max(best, (top, there, other), key=lambda entry: entry[0])
        moved = float(np.max(np.abs((best[1] - at) / step)))
        value, at, found = best
        if moved < 0.75:
            if shrinks == _SHRINKS:
                break
            shrinks += 1
            step = step / _SMALLER
    return Peak(at, value, found, curvature)
