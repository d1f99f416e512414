r"""Evidence without phase: the power of a ping's echoes, cell of range by cell.

Echoes m of an outline, the images of `geometry.image_sources`, arrive at half path lengths d_m with amplitudes
a_m = d_m^-p prod(rho). Taken with random phases, they give in a cell at range r the mean power

    T(r) = 1 + B(r) + A g_i sum_m a_m^2 \|psi(r - d_m)\|^2

in units of the noise, with A one unknown strength, g_i the ping's gain and B a background common to all pings that
stands for what is not explained (orders left out, clutter). A cell's power E is exponential with that mean, so the log
likelihood ratio against noise is

    F = w sum_cells  E (1 - 1 / T) - ln T ,

w being the independent cells per cell. The second term charges echoes that are predicted and absent. A path and its
reverse are equally long and add in phase: their power counts twice each. F is smooth over a pulse's width in every
wall's (r, theta), which makes it the objective of the search; its maximum is refined by the waveform's likelihood.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.image_sources import walls_of
from polymap_ros.geometry.outline import corners_of, is_convex
from polymap_ros.geometry.paths import Paths, falloff, room_for_paths, trace_paths
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.climb import climb
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.likelihood import Slopes
from polymap_ros.solvers.evidence.walls import Walls

_BACKGROUND_WIDTHS = 11.0
"""The background is a mean over all pings and this many pulse widths: far wider than an echo, narrower than the decay
of the echoes with range."""


@dataclass(frozen=True, eq=False)
class Power:
    """Walls under the likelihood of power.

    Parameters
    ----------
    walls : Walls
        The walls; signs of their coefficients do not count.
    strength : float
        A.
    background : ndarray, shape (n_cells,)
        B.
    value : float
        F with the log prior of the walls.
    explained : ndarray, shape (N, n_cells)
        Predicted power at strength 1.
    slopes : Slopes or None
        Derivatives, if they were asked for.
    """

    walls: Walls
    strength: float
    background: NDArray[np.float64]
    value: float
    explained: NDArray[np.float64]
    slopes: Slopes | None = None

    @property
    def expected(self) -> NDArray[np.float64]:
        """T, shape (N, n_cells)."""
        return np.asarray(1.0 + self.background + self.strength * self.explained)

    def with_strength(self, strength: float) -> 'Power':
        """Return the same with another strength, not evaluated."""
        return replace(self, strength=strength, slopes=None)

    def with_walls(self, walls: Walls) -> 'Power':
        """Return the same with other walls, not evaluated."""
        return replace(self, walls=walls, slopes=None)

    @property
    def unknowns(self) -> Walls:
        """The walls."""
        return self.walls

    def with_slopes(self, slopes: Slopes | None) -> 'Power':
        """Return the same with these derivatives."""
        return replace(self, slopes=slopes)


class PowerLikelihood:
    """F of this module for the pings of `data`.

    The derivatives leave out the decay of an echo with its range and that it fades at a wall's soft end
    (`EchoData.soft_m`), which within a tenth of a millimetre of the maximum is most of what is left of the gradient;
    the information leaves out the overlap of echoes, so that steps are damped.
    """

    damping = 1e-2
    derives_at_once = True

    def __init__(self, data: EchoData) -> None:
        self.data = data
        self._heard = _Heard(
            data.ends, data.power, data.gain, data.first_cell, data.range_max_m, data.soft_m, data.cell_m, data.weight,
            data.pulse.power, data.pulse.step_m, 2.0 * data.spreading)

    def initial(self, strength: float) -> Power:
        """Return no walls, and a background that holds all the mean power."""
        background = self._smooth(self.data.mean_power - 1.0)
        none = Walls(np.empty((0, 2)), np.empty(0))
        return Power(none, strength, background, self.quiet(background), np.zeros_like(self.data.power))

    def evaluate(self, walls: Walls, like: Power, order: int, derive: bool = False) -> Power | None:
        """Return F at the strength and background of another; None where the walls are no outline."""
        outline, corners = corners_of(walls.lines, self.data.shortest_m)
        if not outline:
            return None
        pings, size = len(self.data.power), 3 * len(walls) if derive else 0
        explained = np.empty_like(self.data.power)
        scores, information = np.zeros((pings, size)), np.zeros((pings, size, size))
        value = self.quiet(like.background) + walls.log_prior() + float(_power_likelihood(
            corners, order, self._heard, walls.reflection**2, like.strength, like.background, derive, explained, scores,
            information))
        slopes = Slopes(scores, information, np.empty((pings, size, 0)), np.empty((pings, 0, 0))) if derive else None
        return Power(walls, like.strength, like.background, value, explained, slopes)

    def value(self, walls: Walls, like: Power, order: int) -> float:
        """Return F at the strength and background of another; -inf where the walls are no outline."""
        found = self.evaluate(walls, like, order)
        return -np.inf if found is None else found.value

    def shares(self, power: Power) -> NDArray[np.float64]:
        """Return each ping's share (N,) of F without the prior."""
        heard = slice(self.data.first_cell, None)
        linear, ratio = more_power(self.data.power[:, heard], 1.0, power.expected[:, heard] - 1.0)
        return np.asarray(self.data.weight * np.sum(linear - np.log(ratio), axis=1))

    def by_ping(self, power: Power, order: int) -> tuple[NDArray[np.float64], Slopes]:
        """Return each ping's share (N,) of F without the prior, at a strength and background, and its slopes."""
        found = self.evaluate(power.walls, power, order, derive=True)
        assert found is not None, 'the walls bound a polygon'
        assert found.slopes is not None, 'derivatives were asked for'
        return self.shares(found), found.slopes

    def fitted(self, walls: Walls, like: Power, order: int, rounds: int = 2) -> Power | None:
        """Return F at the strength and background that fit the walls best, from those of another."""
        found = self.evaluate(walls, like, order)
        if found is None:
            return None
        heard, first, strength, background = self.data.power, self.data.first_cell, like.strength, like.background
        for _ in range(rounds):
            for _ in range(3):  # Newton's method, Fisher information as the curvature
                gradient, information = _strength_slope(heard, found.explained, background, strength, first)
                strength = max(strength + gradient / max(information, 1e-300), 0.3 * strength)
            background = self._smooth(self.data.mean_power - 1.0 - strength * np.mean(found.explained, axis=0))
        value = self.quiet(background) + walls.log_prior() + float(
            self.data.weight * _cells_likelihood(heard, found.explained, background, strength, first))
        return Power(walls, strength, background, value, found.explained)

    def refine(self, walls: Walls, like: Power, order: int, iterations: int = 5) -> Power | None:
        """Return the nearest maximum of F over the walls, with what fits them best before and after the climb."""
        start = self.fitted(walls, like, order)
        top = climb(self, start, order, iterations)
        return None if top is None else self.fitted(top.walls, top, order)

    def quiet(self, background: NDArray[np.float64]) -> float:
        """Return F without walls: what cells add in which no echo is predicted."""
        linear, ratio = more_power(
            self.data.mean_power[self.data.first_cell:], 1.0, background[self.data.first_cell:])
        return float(self.data.weight * len(self.data.power) * np.sum(linear - np.log(ratio)))

    def _smooth(self, mean: NDArray[np.float64]) -> NDArray[np.float64]:
        half = max(1, round(_BACKGROUND_WIDTHS * self.data.pulse.width_m / self.data.cell_m / 2.0))
        total = np.concatenate(([0.0], np.cumsum(np.maximum(mean, 0.0))))
        low = np.maximum(np.arange(len(mean)) - half, 0)
        high = np.minimum(np.arange(len(mean)) + half + 1, len(mean))
        smooth: NDArray[np.float64] = (total[high] - total[low]) / (high - low)
        return smooth


Cells = TypeVar('Cells', float, NDArray[np.float64])
"""A number for one cell or for many."""


class _Heard(NamedTuple):
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
def _power_likelihood(
    corners: NDArray[np.float64], order: int, heard: _Heard, reflected: NDArray[np.float64], strength: float,
    background: NDArray[np.float64], derive: bool, explained: NDArray[np.float64], scores: NDArray[np.float64],
    information: NDArray[np.float64],
) -> float:
    """F of the cells in which echoes are predicted, less what it is there without them."""
    paths, sides, convex = room_for_paths(order), walls_of(corners, heard.soft), is_convex(corners)
    a, quiet = np.empty(len(paths.half)), 1.0 + background
    total = 0.0
    for i in range(len(heard.power)):
        count = trace_paths(sides, convex, heard.ends[i], order, heard.range_max, heard.soft, derive, paths)
        _fill_amplitudes(paths, count, heard.gain[i], heard, reflected, a)
        row = explained[i]
        row[:] = 0.0
        for m in range(count):
            _add_echo(row, paths.half[m], a[m], heard.shape, heard.shape_step, heard.cell)
        total += _echoes_likelihood(heard.power[i], row, background, strength, heard.first)
        for m in range(count if derive else 0):
            _add_derivatives(paths, m, strength * a[m], heard, i, quiet, strength, row, scores[i], information[i])
    return heard.weight * total


@kernel
def _fill_amplitudes(
    paths: Paths, count: int, gain: float, heard: _Heard, reflected: NDArray[np.float64], a: NDArray[np.float64]
) -> None:
    """a_m^2 of each path; a path and its reverse add in phase."""
    for m in range(count):
        a[m] = gain * falloff(paths.half[m], heard.decay) * paths.weight[m] ** 2
        for level in range(paths.hits[m]):
            a[m] *= reflected[paths.walls[m, level]]
    for m in range(count):
        if paths.hits[m] > 1:
            for q in range(m):
                if paths.hits[q] == paths.hits[m] and abs(paths.half[q] - paths.half[m]) < 1e-7 * heard.range_max:
                    a[q] *= 2.0
                    a[m] *= 2.0
                    break


@kernel
def cells_near(half: float, reach: float, cell: float, first: int, end: int) -> tuple[int, int]:
    """The cells, from the first to before the second, within `reach` of an echo at range `half`."""
    low, high = int(np.ceil((half - reach) / cell)), int((half + reach) / cell)
    return max(low, first), min(high + 1, end)


@kernel
def _add_echo(
    row: NDArray[np.float64], half: float, amplitude: float, shape: NDArray[np.float64], shape_step: float, cell: float
) -> None:
    """Power of an echo at range `half`, cell by cell."""
    low, high = cells_near(half, (len(shape) - 1) * shape_step, cell, 0, len(row))
    for j in range(low, high):
        x = abs(j * cell - half) / shape_step
        k = int(x)
        if k < len(shape) - 1:
            row[j] += amplitude * (shape[k] + (x - k) * (shape[k + 1] - shape[k]))


@kernel
def _add_derivatives(
    paths: Paths, m: int, amplitude: float, heard: _Heard, i: int, quiet: NDArray[np.float64], strength: float,
    row: NDArray[np.float64], scores: NDArray[np.float64], information: NDArray[np.float64],
) -> None:
    """A path's share of its ping's scores and of the information, by its range and by its loss."""
    shape, half = heard.shape, paths.half[m]
    slope, bend, rise, spread = 0.0, 0.0, 0.0, 0.0
    reach = (len(shape) - 1) * heard.shape_step
    low, high = cells_near(half, reach, heard.cell, heard.first, len(row))
    for j in range(low, high):
        x = (j * heard.cell - half) / heard.shape_step
        k = int(abs(x))
        if k < len(shape) - 1:
            difference, certainty = by_power(heard.power[i, j], quiet[j] + strength * row[j])
            by_range = amplitude * (shape[k] - shape[k + 1]) / heard.shape_step
            if x < 0.0:
                by_range = -by_range
            by_loss = 2.0 * amplitude * (shape[k] + (abs(x) - k) * (shape[k + 1] - shape[k]))
            slope += heard.weight * difference * by_range
            bend += heard.weight * certainty * by_range**2
            rise += heard.weight * difference * by_loss
            spread += heard.weight * certainty * by_loss**2
    n = len(scores) // 3
    for level in range(paths.hits[m]):
        wall = paths.walls[m, level]
        scores[2 * n + wall] += rise
        for axis in range(2):
            scores[axis * n + wall] += slope * paths.slopes[m, level, axis]
        for other in range(paths.hits[m]):
            beside = paths.walls[m, other]
            information[2 * n + wall, 2 * n + beside] += spread
            for axis in range(2):
                by = bend * paths.slopes[m, level, axis]
                information[axis * n + wall, beside] += by * paths.slopes[m, other, 0]
                information[axis * n + wall, n + beside] += by * paths.slopes[m, other, 1]


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
def _strength_slope(
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
def _cells_likelihood(
    power: NDArray[np.float64], explained: NDArray[np.float64], background: NDArray[np.float64], strength: float,
    first: int,
) -> float:
    """The same of all pings, from power that was predicted before."""
    total = 0.0
    for i in range(len(power)):
        total += _echoes_likelihood(power[i], explained[i], background, strength, first)
    return total
