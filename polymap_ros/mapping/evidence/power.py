r"""Evidence without phase: the power of a ping's echoes, cell of range by cell.

Echoes m of a polygon, the images of `acoustics.image_sources`, arrive at half path lengths d_m with amplitudes
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

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.image_sources import walls_of
from polymap_ros.jit import kernel
from polymap_ros.mapping.evidence.data import EchoData
from polymap_ros.mapping.evidence.paths import Paths, corners_of, falloff, room_for_paths, trace_paths

_BACKGROUND_WIDTHS = 11.0
"""The background is a mean over all pings and this many pulse widths: far wider than an echo, narrower than the decay
of the echoes with range."""

_LOSS_DEVIATION = 0.7
"""Prior standard deviation of ln rho^2 about 0: covers reflection coefficients from 0.5 to 1 within two."""


@dataclass
class Model:
    """Walls and nuisances: lines (n, 2) sorted by theta, ln rho^2 (n,), strength A, background B (n_cells,)."""

    lines: NDArray[np.float64]
    loss: NDArray[np.float64]
    strength: float
    background: NDArray[np.float64]

    def with_lines(self, lines: NDArray[np.float64], loss: NDArray[np.float64] | None = None) -> 'Model':
        """The same nuisances with other walls, which are sorted; new walls reflect fully."""
        order = np.argsort(lines[:, 1], kind='stable')
        loss = np.zeros(len(lines)) if loss is None else loss
        return Model(np.ascontiguousarray(lines[order]), loss[order], self.strength, self.background)

    def without(self, wall: int) -> 'Model':
        """The model without one wall."""
        return Model(np.delete(self.lines, wall, 0), np.delete(self.loss, wall), self.strength, self.background)


class PowerLikelihood:
    """F of this module for the pings of `data`.

    Attributes
    ----------
    explained : ndarray, shape (N, n_cells)
        Predicted power at strength 1 of the model evaluated last.
    """

    def __init__(self, data: EchoData) -> None:
        self.data = data
        self.explained = np.zeros_like(data.power)
        self._heard = _Heard(
            data.ends, data.power, data.gain, data.first_cell, data.range_max_m, data.soft_m, data.cell_m, data.weight,
            data.pulse.power, data.pulse.step_m, 2.0 * data.spreading)

    def initial(self, strength: float) -> Model:
        """A model without walls, whose background holds all the mean power."""
        return Model(np.empty((0, 2)), np.empty(0), strength, self._smooth(self.data.mean_power - 1.0))

    def __call__(self, model: Model, order: int) -> float:
        """F of a model; -inf where its walls bound no polygon."""
        closed, corners = corners_of(model.lines, self.data.shortest_m)
        if not closed:
            return -np.inf
        return self._evaluate(model, corners, order, False, np.empty((0, 0)), np.empty((0, 0)))

    def shares(self, model: Model, order: int) -> NDArray[np.float64]:
        """Each ping's share (N,) of F."""
        self(model, order)
        heard = slice(self.data.first_cell, None)
        expected = self.expected(model)[:, heard]
        return np.asarray(self.data.weight * np.sum(
            self.data.power[:, heard] * (1.0 - 1.0 / expected) - np.log(expected), axis=1))

    def expected(self, model: Model) -> NDArray[np.float64]:
        """T of the model evaluated last, shape (N, n_cells)."""
        return 1.0 + model.background + model.strength * self.explained

    def fit_nuisances(self, model: Model, order: int, rounds: int = 2) -> float:
        """Fit strength and background to the walls, in place; returns F, or -inf where no polygon is bounded."""
        if self(model, order) == -np.inf:
            return -np.inf
        for _ in range(rounds):
            for _ in range(3):  # Newton's method, Fisher information as the curvature
                gradient, information = _strength_slope(
                    self.data.power, self.explained, model.background, model.strength, self.data.first_cell)
                model.strength = max(model.strength + gradient / max(information, 1e-300), 0.3 * model.strength)
            model.background = self._smooth(
                self.data.mean_power - 1.0 - model.strength * np.mean(self.explained, axis=0))
        return self.quiet(model) + float(self.data.weight * _cells_likelihood(
            self.data.power, self.explained, model.background, model.strength, self.data.first_cell))

    def refine(self, model: Model, order: int, iterations: int = 5) -> tuple[Model, float]:
        """Climb to the nearest maximum of F over lines and losses (Levenberg-Marquardt on Fisher's information)."""
        score = self.fit_nuisances(model, order)
        damping = 1e-2
        limit = np.array([self.data.pulse.width_m, 2.0 * self.data.pulse.width_m / self.data.extent_m, 0.5])
        state = self.derivatives(model, order)
        for _ in range(iterations):
            if state is None:
                break
            value, scores, information = state
            gradient = scores.sum(axis=0)
            gradient[2::3] -= model.loss / _LOSS_DEVIATION**2
            step = np.linalg.solve(information + damping * np.diag(np.diag(information)), gradient)
            step = np.clip(step.reshape(-1, 3), -limit, limit)
            trial = model.with_lines(model.lines + step[:, :2], np.minimum(model.loss + step[:, 2], 0.0))
            after = self.derivatives(trial, order)
            if after is not None and after[0] > value:
                model, state, damping = trial, after, max(damping / 4.0, 1e-4)
                if after[0] - value < 0.1:
                    break
            else:
                damping *= 8.0
                if damping > 1e3:
                    break
        return model, max(score, self.fit_nuisances(model, order))

    def derivatives(
        self, model: Model, order: int
    ) -> tuple[float, NDArray[np.float64], NDArray[np.float64]] | None:
        """F with the prior of the losses, each ping's gradient (N, 3 n) of F, and the Fisher information (3 n, 3 n).

        The parameters are r, theta and ln rho^2 of each wall; None where the walls bound no polygon. The gradient
        leaves out the decay of an echo with its range and that it fades at a wall's soft end (`EchoData.soft_m`), which
        within a tenth of a millimetre of the maximum is most of what is left of it; the information leaves out the
        overlap of echoes. A step counts only if F grows.
        """
        closed, corners = corners_of(model.lines, self.data.shortest_m)
        if not closed:
            return None
        size = 3 * len(model.lines)
        scores, information = np.zeros((len(self.data.positions), size)), np.zeros((size, size))
        value = self._evaluate(model, corners, order, True, scores, information)
        information[range(2, size, 3), range(2, size, 3)] += 1.0 / _LOSS_DEVIATION**2
        # A wall that is heard nowhere has no information: let it rest.
        quiet = np.diag(information) <= 0.0
        information[quiet, quiet] = 1.0
        value -= 0.5 * float(np.sum(model.loss**2)) / _LOSS_DEVIATION**2
        return value, scores, information

    def _evaluate(self, model: Model, corners: NDArray[np.float64], order: int, derive: bool,
                  scores: NDArray[np.float64], information: NDArray[np.float64]) -> float:
        return self.quiet(model) + float(_power_likelihood(
            corners, order, self._heard, np.exp(model.loss), model.strength, model.background, derive, self.explained,
            scores, information))

    def quiet(self, model: Model) -> float:
        """F of a model without walls: what cells add in which no echo is predicted."""
        heard = 1.0 + model.background[self.data.first_cell:]
        mean = self.data.mean_power[self.data.first_cell:]
        return float(self.data.weight * len(self.data.power) * np.sum(mean * (1.0 - 1.0 / heard) - np.log(heard)))

    def _smooth(self, mean: NDArray[np.float64]) -> NDArray[np.float64]:
        half = max(1, round(_BACKGROUND_WIDTHS * self.data.pulse.width_m / self.data.cell_m / 2.0))
        total = np.concatenate(([0.0], np.cumsum(np.maximum(mean, 0.0))))
        low = np.maximum(np.arange(len(mean)) - half, 0)
        high = np.minimum(np.arange(len(mean)) + half + 1, len(mean))
        smooth: NDArray[np.float64] = (total[high] - total[low]) / (high - low)
        return smooth


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
def _power_likelihood(
    corners: NDArray[np.float64], order: int, heard: _Heard, reflected: NDArray[np.float64], strength: float,
    background: NDArray[np.float64], derive: bool, explained: NDArray[np.float64], scores: NDArray[np.float64],
    information: NDArray[np.float64],
) -> float:
    """F of the cells in which echoes are predicted, less what it is there without them."""
    paths, sides = room_for_paths(order), walls_of(corners, heard.soft)
    a, quiet = np.empty(len(paths.half)), 1.0 + background
    total = 0.0
    for i in range(len(heard.power)):
        count = trace_paths(sides, heard.ends[i], order, heard.range_max, heard.soft, derive, paths)
        _fill_amplitudes(paths, count, heard.gain[i], heard, reflected, a)
        row = explained[i]
        row[:] = 0.0
        for m in range(count):
            _add_echo(row, paths.half[m], a[m], heard.shape, heard.shape_step, heard.cell)
        total += _echoes_likelihood(heard.power[i], row, background, strength, heard.first)
        for m in range(count if derive else 0):
            _add_derivatives(paths, m, strength * a[m], heard, i, quiet, strength, row, scores[i], information)
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
def _cells_near(half: float, reach: float, cell: float, first: int, end: int) -> tuple[int, int]:
    """The cells, from the first to before the second, within `reach` of an echo at range `half`."""
    low, high = int(np.ceil((half - reach) / cell)), int((half + reach) / cell)
    return max(low, first), min(high + 1, end)


@kernel
def _add_echo(
    row: NDArray[np.float64], half: float, amplitude: float, shape: NDArray[np.float64], shape_step: float, cell: float
) -> None:
    """Power of an echo at range `half`, cell by cell."""
    low, high = _cells_near(half, (len(shape) - 1) * shape_step, cell, 0, len(row))
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
    low, high = _cells_near(half, reach, heard.cell, heard.first, len(row))
    for j in range(low, high):
        x = (j * heard.cell - half) / heard.shape_step
        k = int(abs(x))
        if k < len(shape) - 1:
            t = quiet[j] + strength * row[j]
            difference = heard.weight * (heard.power[i, j] / t - 1.0) / t
            by_range = amplitude * (shape[k] - shape[k + 1]) / heard.shape_step
            if x < 0.0:
                by_range = -by_range
            by_loss = amplitude * (shape[k] + (abs(x) - k) * (shape[k + 1] - shape[k]))
            slope += difference * by_range
            bend += heard.weight * (by_range / t) ** 2
            rise += difference * by_loss
            spread += heard.weight * (by_loss / t) ** 2
    for level in range(paths.hits[m]):
        wall = 3 * paths.walls[m, level]
        scores[wall + 2] += rise
        for axis in range(2):
            scores[wall + axis] += slope * paths.slopes[m, level, axis]
        for other in range(paths.hits[m]):
            beside = 3 * paths.walls[m, other]
            information[wall + 2, beside + 2] += spread
            for axis in range(2):
                by = bend * paths.slopes[m, level, axis]
                information[wall + axis, beside] += by * paths.slopes[m, other, 0]
                information[wall + axis, beside + 1] += by * paths.slopes[m, other, 1]


@kernel
def _echoes_likelihood(
    power: NDArray[np.float64], explained: NDArray[np.float64], background: NDArray[np.float64], strength: float,
    first: int,
) -> float:
    """F over the weight of a ping's cells in which echoes are predicted, less what it is there without them."""
    total, product = 0.0, 1.0  # a logarithm of many factors at once
    for j in range(first, len(power)):
        if explained[j] > 0.0:
            quiet = 1.0 / (1.0 + background[j])
            t = 1.0 + strength * explained[j] * quiet
            total += power[j] * quiet * (1.0 - 1.0 / t)
            product *= t
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
                inverse = 1.0 / (1.0 + background[j] + strength * explained[i, j])
                share = explained[i, j] * inverse
                gradient += share * (power[i, j] * inverse - 1.0)
                information += share * share
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
