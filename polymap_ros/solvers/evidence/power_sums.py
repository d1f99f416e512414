"""The sums over cells and paths that the likelihood of `power` is made of, and the power that walls predict."""

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.path_room import Paths, room_for_paths
from polymap_ros.geometry.paths import falloff, trace_paths
from polymap_ros.geometry.sides import Sides
from polymap_ros.jit import kernel, within_kernels

Cells = TypeVar('Cells', float, NDArray[np.float64])
"""A number for one cell or for many."""


class HeardPower(NamedTuple):
    """What the kernels need of the data: see `EchoData`; `shape` is the pulse's power at multiples of `shape_step`."""

    ends: NDArray[np.float64]
    power: NDArray[np.float64]
    gain: NDArray[np.float64]
    first: int
    range_max: float
    soft: float
    cell: float
    weight: float
    shape: NDArray[np.float64]
    shape_step: float
    decay: float


@kernel
def more_power(
    heard: Cells, expected: Cells | float, more: Cells
) -> tuple[Cells, Cells]:
    """Return x and y of x - ln y, the log likelihood ratio of `expected` + `more` power in a cell against `expected`.

    This and `by_power` are all that the likelihood knows of how a cell's power is distributed.
    """
    ratio = 1.0 + more / expected
    return heard * more / (expected * expected * ratio), ratio


@kernel
def by_power(heard: float, expected: float) -> tuple[float, float]:
    """Return the derivative of a cell's log likelihood by the expected power, and its Fisher information."""
    inverse = 1.0 / expected
    return (heard * inverse - 1.0) * inverse, inverse * inverse


@kernel
def power_likelihood(
    sides: Sides, order: int, heard: HeardPower, reflected: NDArray[np.float64],
    storey: NDArray[np.float64], strength: float, background: NDArray[np.float64], derive: bool,
    explained: NDArray[np.float64], scores: NDArray[np.float64], information: NDArray[np.float64],
) -> float:
    """F of the cells in which echoes are predicted, less what it is there without them."""
    paths = room_for_paths(order)
    half, a = paths.half, np.empty(len(paths.half))
    difference, certainty = np.empty(heard.power.shape[1]), np.empty(heard.power.shape[1])
    shape, shape_step, cell = heard.shape, heard.shape_step, heard.cell
    total = 0.0
    for i in range(len(heard.power)):
        count = trace_paths(sides, heard.ends[i], order, heard.range_max, heard.soft, derive, storey, paths)
        _fill_amplitudes(paths, count, heard.gain[i], heard, reflected, a)
        power, row = heard.power[i], explained[i]
        row[:] = 0.0
        for m in range(count):
            _add_echo(row, half[m], a[m], shape, shape_step, cell)
        total += _echoes_likelihood(power, row, background, strength, heard.first)
        if derive:
            for j in range(heard.first, len(row)):
                if row[j] > 0.0:
                    difference[j], certainty[j] = by_power(power[j], 1.0 + background[j] + strength * row[j])
            _add_derivatives(paths, count, a, strength, heard, difference, certainty, scores[i], information[i])
    return heard.weight * total


@kernel
def _fill_amplitudes(
    paths: Paths, count: int, gain: float, heard: HeardPower, reflected: NDArray[np.float64], a: NDArray[np.float64]
) -> None:
    """a_m^2 of each path; a path and its reverse add in phase."""
    half, hits, bounces, near = paths.half, paths.hits, paths.bounces, 1e-7 * heard.range_max
    for m in range(count):
        a[m] = gain * falloff(half[m], heard.decay) * paths.weight[m] ** 2
        for level in range(hits[m]):
            a[m] *= reflected[paths.walls[m, level]]
    for m in range(count):
        if hits[m] > 1:
            for q in range(m):
                if abs(half[q] - half[m]) < near and hits[q] == hits[m] and bounces[q] == bounces[m]:
                    a[q] *= 2.0
                    a[m] *= 2.0
                    break


@kernel
def cells_near(half: float, reach: float, cell: float, first: int, end: int) -> tuple[int, int]:
    """The cells, from the first to before the second, within `reach` of an echo at range `half`."""
    low, high = int(np.ceil((half - reach) / cell)), int((half + reach) / cell)
    return max(low, first), min(high + 1, end)


@within_kernels
def _add_echo(
    row: NDArray[np.float64], half: float, amplitude: float, shape: NDArray[np.float64], shape_step: float, cell: float
) -> None:
    """Power of an echo at range `half`, cell by cell."""
    low, high = cells_near(half, (len(shape) - 1) * shape_step, cell, 0, len(row))
    start, step = half / shape_step, cell / shape_step
    for j in range(low, high):
        x = abs(j * step - start)
        k = int(x)
        if k < len(shape) - 1:
            row[j] += amplitude * (shape[k] + (x - k) * (shape[k + 1] - shape[k]))


@kernel
def _add_derivatives(
    paths: Paths, count: int, a: NDArray[np.float64], strength: float, heard: HeardPower,
    difference: NDArray[np.float64], certainty: NDArray[np.float64], scores: NDArray[np.float64],
    information: NDArray[np.float64],
) -> None:
    """Add what the paths bring to their ping's scores and information, by their ranges and by their losses.

    `difference` and `certainty` are those of `by_power`, cell by cell.
    """
    half, hits, walls, slopes, shape = paths.half, paths.hits, paths.walls, paths.slopes, heard.shape
    reach, n = (len(shape) - 1) * heard.shape_step, len(scores) // 3
    for m in range(count):
        amplitude, weight = strength * a[m], heard.weight
        slope, bend, rise, spread = 0.0, 0.0, 0.0, 0.0
        low, high = cells_near(half[m], reach, heard.cell, heard.first, len(difference))
        start, step = half[m] / heard.shape_step, heard.cell / heard.shape_step
        for j in range(low, high):
            x = j * step - start
            k = int(abs(x))
            if k < len(shape) - 1:
                by_range = amplitude * (shape[k] - shape[k + 1]) / heard.shape_step
                if x < 0.0:
                    by_range = -by_range
                by_loss = 2.0 * amplitude * (shape[k] + (abs(x) - k) * (shape[k + 1] - shape[k]))
                slope += weight * difference[j] * by_range
                bend += weight * certainty[j] * by_range**2
                rise += weight * difference[j] * by_loss
                spread += weight * certainty[j] * by_loss**2
        for level in range(hits[m]):
            wall = walls[m, level]
            scores[2 * n + wall] += rise
            for axis in range(2):
                scores[axis * n + wall] += slope * slopes[m, level, axis]
            for other in range(hits[m]):
                beside = walls[m, other]
                information[2 * n + wall, 2 * n + beside] += spread
                for axis in range(2):
                    by = bend * slopes[m, level, axis]
                    information[axis * n + wall, beside] += by * slopes[m, other, 0]
                    information[axis * n + wall, n + beside] += by * slopes[m, other, 1]


@kernel
def _echoes_likelihood(
    power: NDArray[np.float64], explained: NDArray[np.float64], background: NDArray[np.float64], strength: float,
    first: int,
) -> float:
    """F over the weight of a ping's cells in which echoes are predicted, less what it is there without them."""
    total, product = 0.0, 1.0  # a logarithm of many factors at once
    for j in range(first, len(power)):
        if explained[j] > 0.0:
            linear, ratio = more_power(power[j], 1.0 + background[j], strength * explained[j])
            total += linear
            product *= ratio
            if product > 1e200:
                total -= np.log(product)
                product = 1.0
    return total - float(np.log(product))


@kernel
def strength_slope(
    power: NDArray[np.float64], explained: NDArray[np.float64], background: NDArray[np.float64], strength: float,
    first: int,
) -> tuple[float, float]:
    """Derivative of F by the strength, and its Fisher information, both over the weight."""
    gradient, information = 0.0, 0.0
    for i in range(len(power)):
        for j in range(first, power.shape[1]):
            if explained[i, j] > 0.0:
                slope, certainty = by_power(power[i, j], 1.0 + background[j] + strength * explained[i, j])
                gradient += explained[i, j] * slope
                information += explained[i, j] ** 2 * certainty
    return gradient, information


@kernel
def cells_likelihood(
    power: NDArray[np.float64], explained: NDArray[np.float64], background: NDArray[np.float64], strength: float,
    first: int,
) -> float:
    """The same of all pings, from power that was predicted before."""
    total = 0.0
    for i in range(len(power)):
        total += _echoes_likelihood(power[i], explained[i], background, strength, first)
    return total
