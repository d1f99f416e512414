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

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.sides import outline_sides
from polymap_ros.geometry.storey import Storey
from polymap_ros.solvers.evidence.climb import climb
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.likelihood import Slopes
from polymap_ros.solvers.evidence.power_sums import (
    HeardPower,
    cells_likelihood,
    more_power,
    power_likelihood,
    strength_slope,
)
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
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
    storey : Storey
        Floor and ceiling.
    """

    walls: Walls
    strength: float
    background: NDArray[np.float64]
    value: float
    explained: NDArray[np.float64]
    slopes: Slopes | None = None
    storey: Storey = field(default_factory=Storey)

    @property
    def expected(self) -> NDArray[np.float64]:
        """T, shape (N, n_cells)."""
        return np.asarray(1.0 + self.background + self.strength * self.explained)

    def with_strength(self, strength: float) -> 'Power':
        """Return the same with another strength, not evaluated."""
        return replace(self, strength=strength, slopes=None)

    def with_walls(self, walls: Walls, storey: Storey | None = None) -> 'Power':
        """Return the same with other walls, and another storey if given, not evaluated."""
        return replace(self, walls=walls, slopes=None, storey=storey or self.storey)

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
        self._heard = HeardPower(
            data.ends, data.power, data.gain, data.first_cell, data.range_max_m, data.soft_m, data.cell_m, data.weight,
            data.pulse.power, data.pulse.step_m, 2.0 * data.spreading)

    def initial(self, strength: float, storey: Storey | None = None) -> Power:
        """Return no walls but floor and ceiling, and a background that holds all the mean power that they leave."""
        none, storey = Walls(np.empty((0, 2)), np.empty(0)), storey or Storey()
        explained = np.zeros_like(self.data.power)
        if len(storey):
            scores, information = np.empty((len(explained), 0)), np.empty((len(explained), 0, 0))
            power_likelihood(
                outline_sides(np.empty((0, 2)), 0.0, True), FULL_ORDER, self._heard, np.empty(0),
                self._images(storey, FULL_ORDER), strength, np.zeros(explained.shape[1]), False, explained, scores,
                information)
        background = self._smooth(self.data.mean_power - 1.0 - strength * np.mean(explained, axis=0))
        return Power(none, strength, background, self.quiet(background), explained, storey=storey)

    def _images(self, storey: Storey, order: int) -> NDArray[np.float64]:
        return storey.images(order, self.data.level)

    def evaluate(self, walls: Walls, like: Power, order: int, derive: bool = False) -> Power | None:
        """Return F at the strength and background of another; None where the walls are no outline."""
        bound, sides = walls.sides(self.data.soft_m, self.data.shortest_m)
        if not bound:
            return None
        pings, size = len(self.data.power), 3 * len(walls) if derive else 0
        explained = np.empty_like(self.data.power)
        scores, information = np.zeros((pings, size)), np.zeros((pings, size, size))
        value = self.quiet(like.background) + walls.log_prior() + float(power_likelihood(
            sides, order, self._heard, walls.reflection**2, self._images(like.storey, order), like.strength,
            like.background, derive, explained, scores, information))
        slopes = Slopes(scores, information, np.empty((pings, size, 0)), np.empty((pings, 0, 0))) if derive else None
        return Power(walls, like.strength, like.background, value, explained, slopes, like.storey)

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
                gradient, information = strength_slope(heard, found.explained, background, strength, first)
                strength = max(strength + gradient / max(information, 1e-300), 0.3 * strength)
            background = self._smooth(self.data.mean_power - 1.0 - strength * np.mean(found.explained, axis=0))
        value = self.quiet(background) + walls.log_prior() + float(
            self.data.weight * cells_likelihood(heard, found.explained, background, strength, first))
        if value < found.value:  # the background goes by means, which is not where F is largest
            return found
        return Power(walls, strength, background, value, found.explained, storey=like.storey)

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
