"""The power likelihood against the formula of its docstring in plain numpy, differences, and synthesised waveforms."""

import dataclasses

import numpy as np
import pytest
from heard_scenes import hear, some
from references import away_from_ends, inside, unfold

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.likelihood import information_of
from polymap_ros.solvers.evidence.power import Power, PowerLikelihood
from polymap_ros.solvers.evidence.power_sums import cells_near
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.walls import LOSS_DEVIATION, Walls


@pytest.fixture(scope='module')
def mean_power():
    """T of the docstring; paths of equal length, which are reverses of one another, add up in phase."""

    def power_of(data, power, order):
        ranges = data.cell_m * np.arange(data.power.shape[1])
        lags = data.pulse.step_m * np.arange(len(data.pulse.power))
        paths = unfold(power.walls.lines, data.positions, order, data.soft_m)
        losses = np.abs(power.walls.reflection)
        half = np.array([path.half for path in paths])
        amplitude = np.array([np.prod(losses[list(path.walls)]) * path.weight for path in paths])
        expected = np.tile(1.0 + power.background, (len(data.positions), 1))
        for i, row in enumerate(expected):
            heard = (amplitude[:, i] > 0.0) & (half[:, i] <= data.range_max_m)
            for d in np.unique(np.round(half[heard, i], 9)):
                together = np.sum(amplitude[heard & (np.abs(half[:, i] - d) < 1e-8), i]) ** 2
                shape = np.interp(np.abs(ranges - d), lags, data.pulse.power, right=0.0)
                row += power.strength * data.gain[i] * together * d ** (-2.0 * data.spreading) * shape
        return expected

    return power_of


@pytest.fixture(scope='module')
def log_likelihood(mean_power):
    """F of each ping."""

    def ratios(data, power, order):
        expected = mean_power(data, power, order)[:, data.first_cell:]
        energy = data.power[:, data.first_cell:]
        weight = data.cell_m / data.pulse.width_m
        return weight * np.sum(energy * (1.0 - 1.0 / expected) - np.log(expected), axis=1)

    return ratios


@pytest.fixture(scope='module')
def cut():
    """The first pings only, or those chosen, with gains that differ."""

    def those(heard, pings):
        pings = np.arange(pings) if isinstance(pings, int) else pings
        return dataclasses.replace(some(heard.data, pings), gain=np.geomspace(0.5, 2.0, len(pings)))

    return those


def displaced(heard, generator, scale=1.0):
    """Walls near the truth, with losses, a strength and a background that falls with range."""
    n = len(heard.lines)
    lines = heard.lines + scale * generator.normal(size=(n, 2)) * (2e-3, 5e-3)
    background = 0.3 * np.exp(-np.arange(heard.data.power.shape[1]) / 200.0)
    return power_of(Walls(lines, np.exp(-0.5 * generator.uniform(0.0, 1.0, n))), 3.0, background)


def power_of(walls, strength, background):
    return Power(walls, strength, background, np.nan, np.empty(0))


def at(likelihood, power, order, derive=False):
    """The likelihood at the walls, strength and background of a power."""
    return likelihood.evaluate(power.walls, power, order, derive)


def without_prior(power):
    return power.value + 0.5 * np.sum(np.log(power.walls.reflection) ** 2) / LOSS_DEVIATION**2


@pytest.mark.parametrize('order', [1, 2, 3, 5])
def test_equals_brute_force(in_pentagon, order, cut, mean_power, log_likelihood):
    data, generator = cut(in_pentagon, 4), np.random.default_rng(order)
    likelihood = PowerLikelihood(data)
    for _ in range(3):
        given = displaced(in_pentagon, generator)
        each, power = log_likelihood(data, given, order), at(likelihood, given, order)
        assert without_prior(power) == pytest.approx(each.sum(), rel=1e-4)
        np.testing.assert_allclose(likelihood.shares(power), each, rtol=1e-3)
        np.testing.assert_allclose(power.expected, mean_power(data, given, order), rtol=1e-3)


def test_equals_brute_force_in_a_triangle_full_of_reverses(triangle, log_likelihood):
    heard = hear(triangle, inside(triangle, 4), order=3)
    given = displaced(heard, np.random.default_rng(2))
    lines = given.walls.lines
    _, which = half_plane_polygon(lines)
    assert len(which) == 3
    half = np.sort([path.half[0] for path in unfold(lines, heard.data.positions[:1], 3, heard.data.soft_m)])
    assert np.sum(np.diff(half) < 1e-9) >= 3  # pairs of equal length
    power = at(PowerLikelihood(heard.data), given, 3)
    assert without_prior(power) == pytest.approx(log_likelihood(heard.data, given, 3).sum(), rel=1e-4)


def test_equals_brute_force_where_the_product_of_all_cells_overflows(in_pentagon, cut, log_likelihood):
    data = cut(in_pentagon, 2)
    given = dataclasses.replace(displaced(in_pentagon, np.random.default_rng(2)), strength=1e9)
    power = at(PowerLikelihood(data), given, 2)
    assert without_prior(power) == pytest.approx(log_likelihood(data, given, 2).sum(), rel=1e-4)


def test_the_cells_near_an_echo_are_all_and_no_others():
    generator = np.random.default_rng(1)
    for half, reach in generator.uniform(0.0, 1.0, (200, 2)):
        low, high = cells_near(half, reach, 0.1, 3, 9)
        assert list(range(low, high)) == [cell for cell in range(3, 9) if abs(0.1 * cell - half) <= reach]


def test_what_bounds_no_polygon_has_no_likelihood(in_pentagon, cut):
    likelihood = PowerLikelihood(cut(in_pentagon, 2))
    walls, like = Walls.convex(in_pentagon.lines[:2]), likelihood.initial(1.0)
    assert likelihood.value(walls, like, 2) == -np.inf
    assert likelihood.evaluate(walls, like, 2) is None
    assert likelihood.fitted(walls, like, 2) is None
    assert likelihood.refine(walls, like, 2) is None


def differences(likelihood, power, order):
    """Central differences of F without the prior by r of all walls, then theta, then ln |rho|, shape (3 n,)."""
    n, slopes = len(power.walls), []
    for number in range(3 * n):
        step = (1e-7, 1e-7, 5e-6)[number // n]
        moved = [power.walls.moved(sign * step * (np.arange(3 * n) == number)) for sign in (-1.0, 1.0)]
        values = [without_prior(likelihood.evaluate(walls, power, order)) for walls in moved]
        slopes.append((values[1] - values[0]) / (2.0 * step))
    return np.array(slopes)


@pytest.mark.parametrize('order', [1, 3, 5])
def test_gradients_are_those_of_differences(in_pentagon, order, cut):
    """Of pings that hear no path near the end of a wall: what ends leave is not derived."""
    given = displaced(in_pentagon, np.random.default_rng(3))
    away = away_from_ends(given.walls.lines, in_pentagon.data.positions, order, in_pentagon.data.soft_m + 1e-5)
    data = dataclasses.replace(cut(in_pentagon, np.flatnonzero(away)[:12]), spreading=0.0)
    assert len(data.positions) == 12
    likelihood = PowerLikelihood(data)
    power = at(likelihood, given, order, derive=True)
    assert power.value == pytest.approx(at(likelihood, given, order).value, rel=1e-12)
    errors = power.slopes.scores.sum(axis=0) - differences(likelihood, given, order)
    assert np.abs(errors / np.sqrt(np.diag(information_of(power)))).max() < 1e-3


def test_each_ping_has_a_gradient_of_its_own(in_pentagon, cut):
    data = cut(in_pentagon, 5)
    given = displaced(in_pentagon, np.random.default_rng(3))
    together = at(PowerLikelihood(data), given, 3, derive=True).slopes
    for i in range(5):
        alone = at(PowerLikelihood(some(data, [i])), given, 3, derive=True).slopes
        np.testing.assert_allclose(together.scores[i], alone.scores[0], rtol=1e-9)
        np.testing.assert_allclose(together.information[i], alone.information[0], rtol=1e-9)


def test_leaving_out_the_decay_with_range_does_no_harm_at_the_right_model(in_pentagon, cut, mean_power):
    """The gradient of a model with the decay differs by what the model leaves of the power, over the range."""
    away = away_from_ends(in_pentagon.lines, in_pentagon.data.positions, 3, in_pentagon.data.soft_m + 1e-5)
    data = cut(in_pentagon, np.flatnonzero(away)[:12])
    given = displaced(in_pentagon, np.random.default_rng(3), 0.0)
    given = dataclasses.replace(given, background=0.0 * given.background)
    data = dataclasses.replace(data, power=mean_power(data, given, 3))
    likelihood = PowerLikelihood(data)
    power = at(likelihood, given, 3, derive=True)
    error = differences(likelihood, given, 3) - power.slopes.scores.sum(axis=0)
    assert np.abs(error / np.sqrt(np.diag(information_of(power)))).max() < 0.01


def test_information_is_the_spread_of_the_gradients(pentagon, mean_power):
    """Over draws of exponential cells that count as a share `weight` of an independent one; echoes do not overlap."""
    places = inside(pentagon, 300)
    gaps = [np.diff(visible_images(pentagon, place, 1).distance_m / 2.0) for place in places]
    apart = [place for place, gap in zip(places, gaps, strict=True) if np.min(gap, initial=1.0) > 0.04]
    heard = hear(pentagon, np.array(apart[:12]), order=1)
    given = displaced(heard, np.random.default_rng(3), 0.0)
    given = given.with_walls(Walls(given.walls.lines, np.ones(5)))
    expected = mean_power(heard.data, given, 1)
    generator = np.random.default_rng(9)
    gradients = []
    for _ in range(800):
        drawn = dataclasses.replace(heard.data, power=expected * generator.exponential(size=expected.shape))
        slopes = at(PowerLikelihood(drawn), given, 1, derive=True).slopes
        gradients.append(slopes.scores.sum(axis=0))
    information = slopes.information.sum(axis=0)
    spread = np.cov(np.array(gradients).T) / heard.data.weight
    scale = np.sqrt(np.diag(information))
    np.testing.assert_allclose(spread / np.outer(scale, scale), information / np.outer(scale, scale), atol=0.2)


def test_nuisances_are_found(in_pentagon, mean_power):
    """Strength and background of drawn echoes, from far off, at the maximum over the strength."""
    data = in_pentagon.data
    truth = displaced(in_pentagon, np.random.default_rng(3), 0.0)
    expected = mean_power(data, truth, 3)
    generator = np.random.default_rng(9)
    likelihood = PowerLikelihood(dataclasses.replace(data, power=expected * generator.exponential(size=expected.shape)))
    for factor in (0.3, 1.0, 4.0):
        like = dataclasses.replace(truth, strength=factor * truth.strength, background=0.0 * truth.background)
        power = likelihood.fitted(truth.walls, like, 3, rounds=4)
        assert power.value == pytest.approx(at(likelihood, power, 3).value)
        assert power.strength == pytest.approx(truth.strength, rel=0.1)
        assert np.mean(np.abs(power.background - truth.background)) < 0.08
        around = [at(likelihood, power.with_strength(share * power.strength), 3).value for share in (0.95, 1.05)]
        assert max(around) < power.value + 0.5


def test_fitting_the_nuisances_never_loses():
    """The background goes by means, which is not where F is largest: of eight edges in overlapping echoes it cost up to
    94 nats, more than an edge's price, at the strength and background that fit walls of other coefficients.
    """
    scene = random_scene(2, 8)
    mapper = filled_mapper(scene, Parameters())
    search = search_of(mapper.evidence, mapper.parameters)
    right = Walls.of_polygon(scene.vertices).seen_from(Pose(*scene.poses[0]).inverse())
    like = search.power.fitted(right, search.nothing.with_strength(100.0), 5, rounds=6)
    generator = np.random.default_rng(1)
    for _ in range(12):
        walls = dataclasses.replace(right, reflection=right.reflection * generator.uniform(0.8, 1.0, len(right)))
        before = at(search.power, like.with_walls(walls), 5)
        fitted = search.power.fitted(walls, like, 5)
        assert fitted.value >= before.value
        assert fitted.value == pytest.approx(at(search.power, fitted, 5).value)


def test_refining_climbs_to_the_walls(in_pentagon):
    likelihood = PowerLikelihood(in_pentagon.data)
    start = displaced(in_pentagon, np.random.default_rng(5))
    before = at(likelihood, start, 3).value
    power = likelihood.refine(start.walls, start, 3, 8)
    assert power.value > before
    assert power.value == pytest.approx(at(likelihood, power, 3).value, abs=1e-6)
    assert np.abs(power.walls.lines[:, 0] - in_pentagon.lines[:, 0]).max() < 1e-3
    assert np.abs(power.walls.lines[:, 1] - in_pentagon.lines[:, 1]).max() < 2e-3
    assert np.all(power.walls.reflection <= 1.0)


def test_a_path_and_its_reverse_are_heard_with_four_times_the_power(triangle):
    """Echoes of synthesised waveforms that no other comes near, against the model at one strength for all."""
    heard = hear(triangle, inside(triangle, 150), clean=True, order=2)
    data, given = heard.data, power_of(Walls.convex(heard.lines), 0.0, np.zeros(heard.data.power.shape[1]))
    explained = at(PowerLikelihood(dataclasses.replace(data, gain=np.ones(150))), given, 2).explained
    strengths = {1: [], 2: []}
    for i, position in enumerate(data.positions):
        images = visible_images(triangle, position, 2)
        half = images.distance_m / 2.0
        for d in np.unique(np.round(half, 9)):
            same = np.abs(half - d) < 1e-8
            if np.all(np.abs(half[~same] - d) > 4.0 * data.pulse.width_m) and d < data.range_max_m:
                cell = round(d / data.cell_m)
                strengths[same.sum()].append(data.power[i, cell] / explained[i, cell])
    assert min(map(len, strengths.values())) > 20
    single, double = (np.array(values) for values in strengths.values())
    np.testing.assert_allclose(single, single.mean(), rtol=0.02)
    np.testing.assert_allclose(double, single.mean(), rtol=0.02)


def test_the_power_of_many_pings_is_that_of_their_waveforms(triangle):
    """Where echoes overlap, their random phases average out."""
    heard = hear(triangle, inside(triangle, 400), clean=True, order=3)
    data = dataclasses.replace(heard.data, gain=np.ones(400))
    first = hear(triangle, inside(triangle, 400), clean=True, order=1)
    ratios = []
    for each, order in ((data, 3), (dataclasses.replace(first.data, gain=np.ones(400)), 1)):
        given = power_of(Walls.convex(heard.lines), 0.0, np.zeros(each.power.shape[1]))
        ratios.append(each.power.sum() / at(PowerLikelihood(each), given, order).explained.sum())
    assert ratios[0] * heard.sigma**2 == pytest.approx(ratios[1] * first.sigma**2, rel=0.05)
