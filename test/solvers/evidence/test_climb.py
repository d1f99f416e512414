"""The one way up, with a likelihood and with walls that the package does not have, written here."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from heard_scenes import hear
from references import inside

from polymap_ros.geometry.outline import corners_of
from polymap_ros.geometry.paths import first_orders
from polymap_ros.solvers.evidence.climb import climb
from polymap_ros.solvers.evidence.likelihood import Slopes, information_of
from polymap_ros.solvers.evidence.power import PowerLikelihood
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import WaveformLikelihood


@dataclass(frozen=True, eq=False)
class Ranged:
    """Walls, and what their ranges are worth."""

    walls: Walls
    value: float
    slopes: Slopes | None = None

    @property
    def unknowns(self):
        return self.walls

    def with_slopes(self, slopes):
        return replace(self, slopes=slopes)


class HeavyTailed:
    """Ranges (N, n) of first echoes with errors of Student's t of three degrees of freedom and this scale [m]."""

    damping, derives_at_once = 0.0, True

    def __init__(self, data, ranges, scale_m):
        self.data, self.ranges, self.scale_m = data, ranges, scale_m

    def evaluate(self, walls, like, order, derive=False):
        if not corners_of(walls.lines)[0]:
            return None
        half, along = (np.array(column).T for column in zip(*(
            first_orders(line, self.data.positions, self.data.baselines) for line in walls.lines), strict=True))
        error = (self.ranges - half) / self.scale_m
        weight = 4.0 / (3.0 + error**2)
        value = -2.0 * np.sum(np.log1p(error**2 / 3.0)) + walls.log_prior()
        by = np.concatenate((np.ones_like(along), -along, np.zeros_like(along)), axis=1)  # range by r, theta, ln |rho|
        scores = by * np.tile(weight * error, 3) / self.scale_m
        information = np.zeros((*by.shape, by.shape[1]))
        n = len(walls)
        for wall in range(n):
            own = np.arange(3) * n + wall
            information[:, own[:, None], own[None, :]] = (
                by[:, own, None] * by[:, None, own] * weight[:, wall, None, None] / self.scale_m**2)
        slopes = Slopes(scores, information, np.zeros((*scores.shape, 0)), np.zeros((len(scores), 0, 0)))
        return Ranged(walls, value, slopes if derive else None)


class Rigid(Walls):
    """Walls that reflect fully, whatever the echoes say."""

    def held(self, gradient):
        held = super().held(gradient)
        held[2 * len(self):] = True
        return held


def test_a_likelihood_from_outside_is_climbed_and_shrugs_off_what_is_far_out(in_pentagon):
    heard, generator = in_pentagon, np.random.default_rng(4)
    true = np.array([first_orders(line, heard.data.positions, heard.data.baselines)[0] for line in heard.lines]).T
    ranges = true + 1e-3 * generator.normal(size=true.shape)
    ranges[generator.random(true.shape) < 0.1] += 0.3
    start = Walls.convex(heard.lines + generator.normal(size=(5, 2)) * (3e-3, 5e-3))
    likelihood = HeavyTailed(heard.data, ranges, 1e-3)
    top = climb(likelihood, likelihood.evaluate(start, None, 1), 1, 30)
    errors = (top.walls.lines - heard.lines).T.ravel()
    deviations = np.sqrt(np.diag(np.linalg.inv(information_of(top))))[:10]
    assert np.abs(errors / deviations).max() < 4.0
    assert np.abs(errors[:5]).max() < 2e-3
    by_least_squares = [np.polyfit(0.0 * column, column, 0) for column in (ranges - true).T]
    assert np.max(by_least_squares) > 0.01


@pytest.mark.parametrize('kind', [PowerLikelihood, WaveformLikelihood])
def test_walls_from_outside_are_climbed_with_what_they_hold(kind, pentagon):
    """Of walls that reflect 0.8, told that they reflect fully, the lines are still found."""
    heard = hear(pentagon, inside(pentagon, 40), order=3, reflection=np.full(5, 0.8), seed=3)
    likelihood = kind(heard.data)
    start = Rigid.convex(heard.lines + np.random.default_rng(2).normal(size=(5, 2)) * (1e-4, 3e-4))
    if kind is PowerLikelihood:
        begun = likelihood.fitted(start, likelihood.initial(1.0), 3)
    else:
        begun = likelihood.begun(start)
        begun = likelihood.evaluate(begun.walls, begun, 3)
    top = climb(likelihood, begun, 3, 8)
    assert isinstance(top.walls, Rigid)
    assert top.value > begun.value
    np.testing.assert_array_equal(np.abs(top.walls.reflection), 1.0)
    np.testing.assert_allclose(top.walls.lines, heard.lines, atol=2e-3)


def test_no_way_leads_up_from_walls_that_bound_nothing(in_pentagon):
    likelihood = PowerLikelihood(in_pentagon.data)
    assert climb(likelihood, None, 3, 8) is None
    assert climb(likelihood, likelihood.initial(1.0), 3, 8) is None


class Lomax(PowerLikelihood):
    """Power whose mean has a gamma distribution of so many degrees: bursts cost nats, and move no wall far."""

    degrees = 4.0

    def evaluate(self, walls, like, order, derive=False):
        found = super().evaluate(walls, like, order)
        if found is None:
            return None
        heard, power, expected = slice(self.data.first_cell, None), self.data.power, found.expected

        def of(mean):
            return -np.log(mean) - (self.degrees + 1.0) * np.log1p(power / (self.degrees * mean))

        value = self.data.weight * np.sum((of(expected) - of(np.ones_like(expected)))[:, heard]) + walls.log_prior()
        if not derive:
            return replace(found, value=value)
        weighed = power * (self.degrees + 1.0) / (self.degrees + power / expected)
        plain = PowerLikelihood(replace(self.data, power=weighed)).evaluate(walls, like, order, derive=True)
        return replace(found, value=value, slopes=plain.slopes)


def test_bursts_move_walls_less_by_a_robust_likelihood_of_power_from_outside(in_pentagon):
    data, generator = in_pentagon.data, np.random.default_rng(5)
    struck = generator.random(data.power.shape) < 0.02
    bad = replace(data, power=np.where(struck, data.power + generator.exponential(300.0, data.power.shape), data.power))
    off, worst = generator.normal(size=in_pentagon.lines.shape) * 2e-3, {}
    for kind in (PowerLikelihood, Lomax):
        likelihood, walls = kind(bad), Walls.convex(in_pentagon.lines + off)
        start = likelihood.fitted(walls, likelihood.initial(1.0), 3)
        top = climb(likelihood, likelihood.evaluate(walls, start, 3, derive=True), 3, 15)
        assert top.value > likelihood.evaluate(walls, start, 3).value
        worst[kind] = np.abs(top.walls.lines - in_pentagon.lines)[:, 0].max()
    assert worst[Lomax] < 1e-3
    assert worst[Lomax] < 0.7 * worst[PowerLikelihood]


@pytest.mark.parametrize('rest', [0.0, -1e-14])
def test_a_phase_that_the_echoes_do_not_tell_takes_nothing_from_what_walls_know(rest, pentagon):
    """Of its information and of what walls share with it rounding leaves something, of either sign."""
    heard = hear(pentagon, inside(pentagon, 40), order=3, reflection=np.full(5, 0.8), seed=3)
    likelihood = WaveformLikelihood(heard.data)
    begun = likelihood.begun(Walls.convex(heard.lines))
    wave = likelihood.evaluate(begun.walls, begun, 3, derive=True)
    phase = np.pad(wave.slopes.phase, ((0, 0), (0, 1), (0, 1)))
    phase[:, -1, -1] = rest * phase[:, 0, 0]
    by_phase = np.pad(wave.slopes.by_phase, ((0, 0), (0, 0), (0, 1)), constant_values=1e-6)
    more = replace(wave, slopes=replace(wave.slopes, phase=phase, by_phase=by_phase))
    np.testing.assert_allclose(information_of(more), information_of(wave), rtol=1e-6)
