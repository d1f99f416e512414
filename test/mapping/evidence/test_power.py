"""The power likelihood against the formula of its docstring in plain numpy, differences, and synthesised waveforms."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.acoustics.image_sources import visible_images
from polymap_ros.mapping.evidence.power import Model, PowerLikelihood, _cells_near
from polymap_ros.mapping.lines import half_plane_polygon


@pytest.fixture(scope='module')
def mean_power(unfold):
    """T of the docstring; paths of equal length, which are reverses of one another, add up in phase."""

    def power_of(data, model, order):
        ranges = data.cell_m * np.arange(data.power.shape[1])
        lags = data.pulse.step_m * np.arange(len(data.pulse.power))
        paths = unfold(model.lines, data.positions, order, data.soft_m)
        losses = np.exp(0.5 * model.loss)
        half = np.array([path.half for path in paths])
        amplitude = np.array([np.prod(losses[list(path.walls)]) * path.weight for path in paths])
        expected = np.tile(1.0 + model.background, (len(data.positions), 1))
        for i, row in enumerate(expected):
            heard = (amplitude[:, i] > 0.0) & (half[:, i] <= data.range_max_m)
            for d in np.unique(np.round(half[heard, i], 9)):
                together = np.sum(amplitude[heard & (np.abs(half[:, i] - d) < 1e-8), i]) ** 2
                shape = np.interp(np.abs(ranges - d), lags, data.pulse.power, right=0.0)
                row += model.strength * data.gain[i] * together * d ** (-2.0 * data.spreading) * shape
        return expected

    return power_of


@pytest.fixture(scope='module')
def log_likelihood(mean_power):
    """F of each ping."""

    def ratios(data, model, order):
        expected = mean_power(data, model, order)[:, data.first_cell:]
        energy = data.power[:, data.first_cell:]
        weight = data.cell_m / data.pulse.width_m
        return weight * np.sum(energy * (1.0 - 1.0 / expected) - np.log(expected), axis=1)

    return ratios


@pytest.fixture(scope='module')
def cut(some):
    """The first pings only, or those chosen, with gains that differ."""

    def those(heard, pings):
        pings = np.arange(pings) if isinstance(pings, int) else pings
        return dataclasses.replace(some(heard.data, pings), gain=np.geomspace(0.5, 2.0, len(pings)))

    return those


def displaced(heard, generator, scale=1.0):
    """A model near the truth, with losses, a strength and a background that falls with range."""
    n = len(heard.lines)
    lines = heard.lines + scale * generator.normal(size=(n, 2)) * (2e-3, 5e-3)
    background = 0.3 * np.exp(-np.arange(heard.data.power.shape[1]) / 200.0)
    return Model(lines, -generator.uniform(0.0, 1.0, n), 3.0, background)


@pytest.mark.parametrize('order', [1, 2, 3, 5])
def test_equals_brute_force(in_pentagon, order, cut, mean_power, log_likelihood):
    data, generator = cut(in_pentagon, 4), np.random.default_rng(order)
    likelihood = PowerLikelihood(data)
    for _ in range(3):
        model = displaced(in_pentagon, generator)
        each = log_likelihood(data, model, order)
        assert likelihood(model, order) == pytest.approx(each.sum(), rel=1e-4)
        np.testing.assert_allclose(likelihood.shares(model, order), each, rtol=1e-3)
        np.testing.assert_allclose(likelihood.expected(model), mean_power(data, model, order), rtol=1e-3)


def test_equals_brute_force_in_a_triangle_full_of_reverses(hear, triangle, inside, unfold, log_likelihood):
    heard = hear(triangle, inside(triangle, 4), order=3)
    model = displaced(heard, np.random.default_rng(2))
    _, which = half_plane_polygon(model.lines)
    assert len(which) == 3
    half = np.sort([path.half[0] for path in unfold(model.lines, heard.data.positions[:1], 3, heard.data.soft_m)])
    assert np.sum(np.diff(half) < 1e-9) >= 3  # pairs of equal length
    likelihood = PowerLikelihood(heard.data)
    assert likelihood(model, 3) == pytest.approx(log_likelihood(heard.data, model, 3).sum(), rel=1e-4)


def test_equals_brute_force_where_the_product_of_all_cells_overflows(in_pentagon, cut, log_likelihood):
    data = cut(in_pentagon, 2)
    model = dataclasses.replace(displaced(in_pentagon, np.random.default_rng(2)), strength=1e9)
    assert PowerLikelihood(data)(model, 2) == pytest.approx(log_likelihood(data, model, 2).sum(), rel=1e-4)


def test_the_cells_near_an_echo_are_all_and_no_others():
    generator = np.random.default_rng(1)
    for half, reach in generator.uniform(0.0, 1.0, (200, 2)):
        low, high = _cells_near(half, reach, 0.1, 3, 9)
        assert list(range(low, high)) == [cell for cell in range(3, 9) if abs(0.1 * cell - half) <= reach]


def test_what_bounds_no_polygon_has_no_likelihood(in_pentagon, cut):
    likelihood = PowerLikelihood(cut(in_pentagon, 2))
    model = likelihood.initial(1.0).with_lines(in_pentagon.lines[:2])
    assert likelihood(model, 2) == -np.inf
    assert likelihood.fit_nuisances(model, 2) == -np.inf
    assert likelihood.derivatives(model, 2) is None


def test_models_sort_their_walls_with_their_losses():
    model = Model(np.empty((0, 2)), np.empty(0), 1.0, np.zeros(3))
    given = np.array([(1.0, 2.0), (2.0, -1.0), (3.0, 0.5)])
    several = model.with_lines(given, np.array([-0.1, -0.2, -0.3]))
    np.testing.assert_array_equal(several.lines, given[[1, 2, 0]])
    np.testing.assert_array_equal(several.loss, [-0.2, -0.3, -0.1])
    np.testing.assert_array_equal(several.without(1).lines, given[[1, 0]])
    np.testing.assert_array_equal(several.without(1).loss, [-0.2, -0.1])
    np.testing.assert_array_equal(model.with_lines(given).loss, 0.0)


def differences(likelihood, model, order):
    """Central differences of F by r, theta and ln rho^2 of each wall, shape (3 n,)."""
    slopes = []
    for wall in range(len(model.lines)):
        for axis in range(3):
            step, values = (1e-7, 1e-7, 1e-5)[axis], []
            for sign in (-1.0, 1.0):
                lines, loss = model.lines.copy(), model.loss.copy()
                if axis < 2:
                    lines[wall, axis] += sign * step
                else:
                    loss[wall] += sign * step
                values.append(likelihood(dataclasses.replace(model, lines=lines, loss=loss), order))
            slopes.append((values[1] - values[0]) / (2.0 * step))
    return np.array(slopes)


@pytest.mark.parametrize('order', [1, 3, 5])
def test_gradients_are_those_of_differences(in_pentagon, order, cut, away_from_ends):
    """Of pings that hear no path near the end of a wall: what ends leave is not derived."""
    model = displaced(in_pentagon, np.random.default_rng(3))
    away = away_from_ends(model.lines, in_pentagon.data.positions, order, in_pentagon.data.soft_m + 1e-5)
    data = dataclasses.replace(cut(in_pentagon, np.flatnonzero(away)[:12]), spreading=0.0)
    assert len(data.positions) == 12
    likelihood = PowerLikelihood(data)
    value, scores, information = likelihood.derivatives(model, order)
    prior = -0.5 * np.sum(model.loss**2) / 0.7**2
    assert value == pytest.approx(likelihood(model, order) + prior)
    errors = scores.sum(axis=0) - differences(likelihood, model, order)
    assert np.abs(errors / np.sqrt(np.diag(information))).max() < 1e-3


def test_each_ping_has_a_gradient_of_its_own(in_pentagon, cut, some):
    data = cut(in_pentagon, 5)
    model = displaced(in_pentagon, np.random.default_rng(3))
    _, together, _ = PowerLikelihood(data).derivatives(model, 3)
    for i in range(5):
        alone = some(data, [i])
        np.testing.assert_allclose(together[i], PowerLikelihood(alone).derivatives(model, 3)[1][0], rtol=1e-9)


def test_leaving_out_the_decay_with_range_does_no_harm_at_the_right_model(in_pentagon, cut, mean_power, away_from_ends):
    """The gradient of a model with the decay differs by what the model leaves of the power, over the range."""
    away = away_from_ends(in_pentagon.lines, in_pentagon.data.positions, 3, in_pentagon.data.soft_m + 1e-5)
    data = cut(in_pentagon, np.flatnonzero(away)[:12])
    model = displaced(in_pentagon, np.random.default_rng(3), 0.0)
    model.strength, model.background = 3.0, 0.0 * model.background
    data = dataclasses.replace(data, power=mean_power(data, model, 3))
    likelihood = PowerLikelihood(data)
    _, scores, information = likelihood.derivatives(model, 3)
    error = differences(likelihood, model, 3) - scores.sum(axis=0)
    assert np.abs(error / np.sqrt(np.diag(information))).max() < 0.01


def test_information_is_the_spread_of_the_gradients(hear, pentagon, inside, mean_power):
    """Over draws of exponential cells that count as a share `weight` of an independent one; echoes do not overlap."""
    places = inside(pentagon, 300)
    gaps = [np.diff(visible_images(pentagon, place, 1).distance_m / 2.0) for place in places]
    apart = [place for place, gap in zip(places, gaps, strict=True) if np.min(gap, initial=1.0) > 0.04]
    heard = hear(pentagon, np.array(apart[:12]), order=1)
    model = displaced(heard, np.random.default_rng(3), 0.0)
    model.loss[:] = 0.0
    expected = mean_power(heard.data, model, 1)
    generator = np.random.default_rng(9)
    gradients = []
    for _ in range(800):
        drawn = dataclasses.replace(heard.data, power=expected * generator.exponential(size=expected.shape))
        _, scores, information = PowerLikelihood(drawn).derivatives(model, 1)
        gradients.append(scores.sum(axis=0))
    information[range(2, 15, 3), range(2, 15, 3)] -= 1.0 / 0.7**2
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
        model = dataclasses.replace(truth, strength=factor * truth.strength, background=0.0 * truth.background)
        value = likelihood.fit_nuisances(model, 3, rounds=4)
        assert value == pytest.approx(likelihood(model, 3))
        assert model.strength == pytest.approx(truth.strength, rel=0.1)
        assert np.mean(np.abs(model.background - truth.background)) < 0.08
        around = [likelihood(dataclasses.replace(model, strength=share * model.strength), 3) for share in (0.95, 1.05)]
        assert max(around) < value + 0.5


def test_refining_climbs_to_the_walls(in_pentagon):
    likelihood = PowerLikelihood(in_pentagon.data)
    start = displaced(in_pentagon, np.random.default_rng(5))
    before = likelihood(start, 3)
    model, value = likelihood.refine(start, 3, 8)
    assert value > before
    assert value == pytest.approx(likelihood(model, 3), abs=1e-6)
    assert np.abs(model.lines[:, 0] - in_pentagon.lines[:, 0]).max() < 1e-3
    assert np.abs(model.lines[:, 1] - in_pentagon.lines[:, 1]).max() < 2e-3
    assert np.all(model.loss <= 0.0)


def test_a_path_and_its_reverse_are_heard_with_four_times_the_power(hear, triangle, inside):
    """Echoes of synthesised waveforms that no other comes near, against the model at one strength for all."""
    heard = hear(triangle, inside(triangle, 150), clean=True, order=2)
    data, model = heard.data, Model(heard.lines, np.zeros(3), 0.0, np.zeros(heard.data.power.shape[1]))
    likelihood = PowerLikelihood(dataclasses.replace(data, gain=np.ones(150)))
    likelihood(model, 2)
    strengths = {1: [], 2: []}
    for i, position in enumerate(data.positions):
        images = visible_images(triangle, position, 2)
        half = images.distance_m / 2.0
        for d in np.unique(np.round(half, 9)):
            same = np.abs(half - d) < 1e-8
            if np.all(np.abs(half[~same] - d) > 4.0 * data.pulse.width_m) and d < data.range_max_m:
                cell = round(d / data.cell_m)
                strengths[same.sum()].append(data.power[i, cell] / likelihood.explained[i, cell])
    assert min(map(len, strengths.values())) > 20
    single, double = (np.array(values) for values in strengths.values())
    np.testing.assert_allclose(single, single.mean(), rtol=0.02)
    np.testing.assert_allclose(double, single.mean(), rtol=0.02)


def test_the_power_of_many_pings_is_that_of_their_waveforms(hear, triangle, inside):
    """Where echoes overlap, their random phases average out."""
    heard = hear(triangle, inside(triangle, 400), clean=True, order=3)
    data = dataclasses.replace(heard.data, gain=np.ones(400))
    first = hear(triangle, inside(triangle, 400), clean=True, order=1)
    ratios = []
    for each, order in ((data, 3), (dataclasses.replace(first.data, gain=np.ones(400)), 1)):
        model = Model(heard.lines, np.zeros(3), 0.0, np.zeros(each.power.shape[1]))
        likelihood = PowerLikelihood(each)
        likelihood(model, order)
        ratios.append(each.power.sum() / likelihood.explained.sum())
    assert ratios[0] * heard.sigma**2 == pytest.approx(ratios[1] * first.sigma**2, rel=0.05)
