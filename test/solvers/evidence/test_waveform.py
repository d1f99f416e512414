"""The waveform likelihood against matched filters in the time domain, on samples of the full synthesis."""

import dataclasses

import numpy as np
import pytest
from heard_scenes import hear, listen, some
from references import away_from_ends, inside, unfold
from scipy.interpolate import KroghInterpolator
from scipy.signal import hilbert

from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.hearing.listening import Listener
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.parameters import Parameters, SensorParameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import Synthesis
from polymap_ros.solvers.evidence.likelihood import gradient_of, information_of
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.walls import LOSS_DEVIATION, Walls
from polymap_ros.solvers.evidence.wave_sums import cubic
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

N = 4096
"""Samples of a ping: even the third order is over before they end."""


@pytest.fixture(scope='module')
def synthesise(in_pentagon):
    """Analytic samples (N,) of the echoes within walls, one of 1 m being of norm 1."""
    scene, soft = in_pentagon.scene, in_pentagon.data.soft_m
    synthesis = Synthesis(make_medium(scene.medium), make_pulse(scene.pulse), 2 * N, scene.period_s)
    norm = np.linalg.norm(synthesis(np.array([2.0]), np.array([np.sqrt(2.0)])))

    def templates(lines, reflection, positions, order, baseline=(0.0, 0.0, 0.0)):
        half_way = 0.5 * np.array(baseline[:2])
        paths = unfold(lines, positions - half_way, order, soft, positions + half_way, baseline[2])
        half = np.array([path.half for path in paths])
        amplitude = np.array([np.prod(np.asarray(reflection)[list(path.walls)]) * path.weight for path in paths])
        rows = []
        for i in range(len(positions)):
            heard = amplitude[:, i] != 0.0
            echoes = synthesis(2.0 * half[heard, i], np.sqrt(2.0) * amplitude[heard, i])  # of half the path's length
            rows.append(hilbert(echoes / norm)[:N])
        return np.array(rows)

    return templates


@pytest.fixture(scope='module')
def pentagon_heard(pentagon):
    reflection = np.array([1.0, -0.8, 0.7, 1.0, 0.9])
    return hear(pentagon, inside(pentagon, 12), order=3, reflection=reflection, n_samples=N, seed=5)


@pytest.fixture(scope='module')
def overlapping(pentagon):
    """Pings that hear two walls a quarter of a cycle of range, 2.5 mm, apart, always the same one first."""
    places = inside(pentagon, 4000)
    first = unfold(polygon_lines(pentagon), places, 1, 0.0)
    half = np.array([np.where(path.weight > 0.0, path.half, np.nan) for path in first])
    behind = half[1] - half[0]
    return hear(pentagon, places[(behind > 1.5e-3) & (behind < 4e-3)][:12], order=1, n_samples=N, seed=9)


@pytest.fixture(scope='module')
def triangle_heard(triangle):
    return hear(triangle, inside(triangle, 12), order=2, n_samples=N, seed=7)


@pytest.fixture(scope='module')
def steady():
    """Of what was heard, the pings that hear no path near the end of a wall: what ends leave is not derived."""

    def chosen(heard, order, lines=None):
        lines = heard.lines if lines is None else lines
        away = away_from_ends(lines, heard.data.positions, order, heard.data.soft_m + 1e-5)
        assert away.sum() > 5
        return dataclasses.replace(heard, data=some(heard.data, away), samples=heard.samples[away])

    return chosen


def ratio(heard, templates, phase):
    """Amplitudes and log likelihood ratio max(z.T, 0)^2 / (2 sigma^2 T.T) of each ping, from the samples."""
    waves = np.real(templates * np.exp(1j * phase))
    both, energy = np.sum(heard.samples * waves, axis=1), np.sum(waves**2, axis=1)
    both = np.maximum(both, 0.0)
    return both / energy / heard.sigma, both**2 / (2.0 * heard.sigma**2 * energy)


def at(likelihood, lines, reflection, phase, order, derive=True):
    """The likelihood at walls, from a phase of the device."""
    walls = Walls(lines, np.asarray(reflection, float))
    return likelihood.evaluate(walls, Wave(walls, phase, np.nan, np.empty(0)), order, derive)


def refined(likelihood, lines, reflection, phase, order, iterations=6):
    """The nearest maximum from walls and a phase of the device."""
    start = Wave(Walls(lines, np.asarray(reflection, float)), phase, np.nan, np.empty(0))
    return likelihood.refine(start, order, iterations)


def prior(reflection):
    return 0.5 * np.sum(np.log(np.abs(reflection)) ** 2) / LOSS_DEVIATION**2


@pytest.mark.parametrize('room', ['pentagon_heard', 'triangle_heard'])
@pytest.mark.parametrize('order', [1, 2, 3])
@pytest.mark.parametrize('scale', [0.0, 1e-4, 1e-3, 1e-2])
def test_equals_the_matched_filter_on_samples(room, order, scale, request, synthesise):
    heard = request.getfixturevalue(room)
    generator = np.random.default_rng(order)
    lines = heard.lines + scale * generator.normal(size=heard.lines.shape)
    reflection = heard.reflection * generator.uniform(0.5, 1.0, len(lines))
    wave = at(WaveformLikelihood(heard.data), lines, reflection, 0.0, order)
    templates = synthesise(lines, reflection, heard.data.positions, order)
    amplitudes, ratios = ratio(heard, templates, wave.phase)
    assert wave.value + prior(reflection) == pytest.approx(ratios.sum(), rel=0.005, abs=2.0)
    np.testing.assert_allclose(wave.amplitudes, amplitudes, rtol=0.01, atol=0.02 * amplitudes.max())
    if scale < 1e-3:
        phases = np.linspace(-0.5, 0.5, 201)
        values = [ratio(heard, templates, phase)[1].sum() for phase in phases]
        assert wave.phase == pytest.approx(phases[np.argmax(values)], abs=0.01)


@pytest.mark.parametrize('baseline', [(0.05, 0.0, 0.0), (-0.02, 0.04, 0.15)])
def test_equals_the_matched_filter_for_a_receiver_apart(baseline, pentagon, synthesise):
    """Beside and above the emitter; as if both were half way between them, far less would be explained."""
    sensor = SensorParameters(baseline_x_m=baseline[0], baseline_y_m=baseline[1], baseline_z_m=baseline[2])
    heard = hear(pentagon, inside(pentagon, 12), order=3, n_samples=N, seed=5, sensor=sensor)
    wave = at(WaveformLikelihood(heard.data), heard.lines, heard.reflection, 0.0, 3)
    templates = synthesise(heard.lines, heard.reflection, heard.data.positions, 3, baseline)
    amplitudes, ratios = ratio(heard, templates, wave.phase)
    assert wave.value == pytest.approx(ratios.sum(), rel=0.005, abs=2.0)
    np.testing.assert_allclose(wave.amplitudes, amplitudes, rtol=0.01, atol=0.02 * amplitudes.max())
    together = dataclasses.replace(heard.data, baselines=np.zeros((12, 3)))
    assert at(WaveformLikelihood(together), heard.lines, heard.reflection, 0.0, 3).value < 0.8 * wave.value


def test_a_device_that_turns_the_phase_changes_nothing_else(pentagon_heard):
    heard, turn = pentagon_heard, np.exp(0.7j)
    turned = dataclasses.replace(heard.data, signal=(heard.data.signal * turn).astype(np.complex64))
    one = at(WaveformLikelihood(heard.data), heard.lines, heard.reflection, 0.0, 3)
    other = at(WaveformLikelihood(turned), heard.lines, heard.reflection, 0.7, 3)
    assert other.phase == pytest.approx(one.phase + 0.7, abs=1e-5)
    assert other.value == pytest.approx(one.value, rel=1e-5)
    scores = one.slopes.scores
    np.testing.assert_allclose(other.slopes.scores, scores, atol=1e-3 * np.abs(scores).max())


def differences(value, lines, reflection, steps=(1e-7, 1e-7, 1e-6)):
    """Central differences of value(lines, reflection) by r of all walls, then theta, then ln |rho|."""
    slopes = []
    for axis, step in enumerate(steps):
        for wall in range(len(lines)):
            moved = []
            for sign in (-1.0, 1.0):
                near, rho = lines.copy(), reflection.copy()
                if axis < 2:
                    near[wall, axis] += sign * step
                else:
                    rho[wall] *= np.exp(sign * step)
                moved.append(value(near, rho))
            slopes.append((moved[1] - moved[0]) / (2.0 * step))
    return np.array(slopes)


@pytest.mark.parametrize('room', ['pentagon_heard', 'triangle_heard'])
@pytest.mark.parametrize('order', [1, 3])
def test_gradients_are_those_of_differences(room, order, request, steady):
    heard = request.getfixturevalue(room)
    lines = heard.lines + np.random.default_rng(order).normal(size=heard.lines.shape) * (2e-4, 5e-4)
    heard = steady(heard, order, lines)
    likelihood = WaveformLikelihood(heard.data)
    wave = at(likelihood, lines, heard.reflection, 0.0, order)

    def value(lines, reflection):
        return at(likelihood, lines, reflection, wave.phase, order, derive=False).value + prior(reflection)

    slope, expected = wave.slopes.scores.sum(axis=0), differences(value, lines, heard.reflection)
    scale = np.sqrt(np.diag(information_of(wave)))
    assert np.abs(slope / scale).max() > 3.0
    np.testing.assert_allclose(slope / scale, expected / scale, rtol=0.01, atol=0.05)
    penalised = slope.reshape(3, -1) - np.outer((0.0, 0.0, 1.0), np.log(np.abs(heard.reflection)) / 0.35**2)
    np.testing.assert_allclose(gradient_of(wave), penalised.ravel(), rtol=1e-9)


def test_each_pings_gradient_is_that_of_its_samples(triangle_heard, synthesise, steady):
    lines = triangle_heard.lines + np.random.default_rng(1).normal(size=(3, 2)) * (2e-4, 5e-4)
    heard = steady(triangle_heard, 2, lines)
    wave = at(WaveformLikelihood(heard.data), lines, heard.reflection, 0.0, 2)

    def shares(lines, reflection):
        return ratio(heard, synthesise(lines, reflection, heard.data.positions, 2), wave.phase)[1]

    expected = differences(shares, lines, heard.reflection, (1e-6, 1e-6, 1e-4))
    scale = np.sqrt(np.diag(information_of(wave)))
    np.testing.assert_allclose(wave.slopes.scores / scale, expected.T / scale, rtol=0.05, atol=0.1)


def test_each_pings_share_is_that_of_its_samples(pentagon_heard, synthesise):
    likelihood = WaveformLikelihood(pentagon_heard.data)
    wave = at(likelihood, pentagon_heard.lines, pentagon_heard.reflection, 0.0, 3)
    shares = likelihood.shares(wave, 3)
    templates = synthesise(wave.walls.lines, wave.walls.reflection, pentagon_heard.data.positions, 3)
    _, expected = ratio(pentagon_heard, templates, wave.phase)
    np.testing.assert_allclose(shares, expected, rtol=0.02, atol=0.5)
    assert shares.sum() == pytest.approx(wave.value + prior(wave.walls.reflection), rel=1e-9)


def left_of(slopes, nuisances):
    """What a basis of nuisances leaves of each row of derivatives."""
    basis = nuisances.reshape(len(nuisances), -1).T
    return slopes - (basis @ np.linalg.lstsq(basis, slopes.T, rcond=None)[0]).T


def nuisances_of(mean, turn):
    """Derivatives of the mean samples, shape (N, n_samples), by the device's phase and by each ping's amplitude."""
    rows = np.zeros((1 + len(mean), *mean.shape))
    rows[0] = turn
    rows[range(1, 1 + len(mean)), range(len(mean))] = mean
    return rows


@pytest.mark.parametrize(('room', 'order'), [
    ('pentagon_heard', 1), ('pentagon_heard', 3), ('triangle_heard', 2), ('overlapping', 1)])
def test_information_is_that_of_the_samples(room, order, request, synthesise, steady):
    """Fisher's information of Gaussian samples, from differences of their mean, with phase and amplitudes unknown."""
    heard = steady(request.getfixturevalue(room), order)
    wave = at(WaveformLikelihood(heard.data), heard.lines, heard.reflection, 0.0, order)
    assert np.all(wave.amplitudes > 0.0)

    def templates(lines, reflection):
        return synthesise(lines, reflection, heard.data.positions, order) * np.exp(1j * wave.phase)

    def mean(lines, reflection):
        return (wave.amplitudes[:, None] * templates(lines, reflection).real).ravel()

    slopes = differences(mean, heard.lines, heard.reflection, (1e-6, 1e-6, 1e-4))
    at_truth = wave.amplitudes[:, None] * templates(heard.lines, heard.reflection)
    left = left_of(slopes, nuisances_of(at_truth.real, -at_truth.imag))
    expected = left @ left.T + np.diag(np.repeat((0.0, 0.0, 1.0 / 0.35**2), len(heard.lines)))
    scale = np.linalg.norm(slopes, axis=1)
    found, expected = (each / np.outer(scale, scale) for each in (information_of(wave), expected))
    np.testing.assert_allclose(found, expected, atol=0.02)
    taken = 1.0 - np.sum(left**2, axis=1) / scale**2
    assert taken.max() > 0.2  # the nuisances matter,
    if room == 'overlapping':  # and so do ranges and losses that trade against each other
        places = np.arange(len(scale)) < 2 * len(heard.lines)
        assert np.abs((left @ left.T / np.outer(scale, scale))[np.ix_(places, ~places)]).max() > 0.1


@pytest.mark.parametrize('order', [1, 3])
def test_the_likelihood_bends_as_the_information_says(order, pentagon, synthesise, steady):
    """Without noise, along random directions from the truth, with the phase and all amplitudes at their best."""
    heard = steady(hear(pentagon, inside(pentagon, 20), order=order, clean=True), order)
    likelihood = WaveformLikelihood(heard.data)
    wave = at(likelihood, heard.lines, heard.reflection, 0.0, order)
    assert wave.phase == pytest.approx(0.0, abs=5e-3)
    slope, information = wave.slopes.scores.sum(axis=0), information_of(wave)
    assert np.abs(slope / np.sqrt(np.diag(information))).max() < 0.05 * np.sqrt(wave.value)
    generator = np.random.default_rng(order)
    for _ in range(3):
        way = generator.normal(size=(5, 2)) * (1e-5, 2e-5)

        def templates(share, way=way):
            lines = heard.lines + share * way
            return wave.amplitudes[:, None] * synthesise(lines, heard.reflection, heard.data.positions, order)

        mean = templates(0.0)
        moved = np.real(templates(0.5) - templates(-0.5)).reshape(1, -1)
        left = left_of(moved, nuisances_of(mean.real, -mean.imag))
        values = [at(likelihood, heard.lines + share * way, heard.reflection, 0.0, order, derive=False).value
                  for share in (-1.0, 0.0, 1.0)]
        bend = 2.0 * values[1] - values[0] - values[2]
        assert bend == pytest.approx(np.sum(left**2), rel=0.03)
        step = np.concatenate((way[:, 0], way[:, 1], np.zeros(5)))
        assert bend == pytest.approx(step @ information @ step, rel=0.03)


@pytest.mark.parametrize('baseline', [(0.0, 0.0, 0.0), (0.05, 0.03, 0.04)])
@pytest.mark.parametrize('seed', range(4))
def test_signs_and_phase_are_told_from_the_first_order(seed, baseline, pentagon):
    generator = np.random.default_rng(seed)
    reflection = generator.uniform(0.5, 1.0, 5) * np.where(np.arange(5) == generator.integers(5), -1.0, 1.0)
    reflection[reflection < 0.0] *= 0.3 if seed % 2 else 1.0
    sensor = SensorParameters(**dict(zip(('baseline_x_m', 'baseline_y_m', 'baseline_z_m'), baseline, strict=True)))
    heard = hear(pentagon, inside(pentagon, 30), reflection=reflection, seed=seed, sensor=sensor)
    turned = dataclasses.replace(heard.data, signal=(heard.data.signal * np.exp(2.0j)).astype(np.complex64))
    for data, phase in ((heard.data, 0.0), (turned, 2.0)):
        found = WaveformLikelihood(data).begun(Walls(heard.lines, np.abs(heard.reflection)))
        np.testing.assert_allclose(found.walls.reflection, heard.reflection, rtol=1e-6)
        assert np.angle(np.exp(1j * (found.phase - phase))) == pytest.approx(0.0, abs=0.3)


def test_refining_returns_to_the_walls(in_pentagon):
    heard, likelihood = in_pentagon, WaveformLikelihood(in_pentagon.data)
    truth = at(likelihood, heard.lines, heard.reflection, 0.0, 5)
    start = heard.lines + np.random.default_rng(2).normal(size=(5, 2)) * (1e-4, 3e-4)
    wave = refined(likelihood, start, heard.reflection, 0.0, 5)
    assert truth.value < wave.value < truth.value + 30.0  # half a chi-square of 15 parameters
    errors = np.abs(wave.walls.lines - heard.lines)
    deviations = np.sqrt(np.diag(np.linalg.inv(information_of(wave)))).reshape(3, 5)
    assert np.all(errors < 4.0 * deviations[:2].T)
    assert errors[:, 0].max() < 1e-4
    assert refined(likelihood, heard.lines[:2], heard.reflection[:2], 0.0, 5) is None


@pytest.mark.parametrize('shift_m', [-2e-4, 1e-4])
def test_refining_does_not_stop_where_range_and_phase_trade(shift_m, triangle):
    """All walls further out by the same and the phase turned to match: the first order hardly tells."""
    heard = hear(triangle, inside(triangle, 60), seed=11)
    likelihood = WaveformLikelihood(heard.data)
    best = refined(likelihood, heard.lines, heard.reflection, 0.0, 5, 30)
    phase = -2.0 * heard.data.pulse.carrier * shift_m
    wave = refined(likelihood, heard.lines + (shift_m, 0.0), heard.reflection, phase, 5, 8)
    assert wave.value == pytest.approx(best.value, abs=1.0)
    assert wave.phase == pytest.approx(best.phase, abs=2e-3)
    np.testing.assert_allclose(wave.walls.lines[:, 0], best.walls.lines[:, 0], atol=3e-6)


def test_what_is_not_heard_is_held_fast(in_pentagon):
    heard, likelihood = in_pentagon, WaveformLikelihood(in_pentagon.data)
    silent = heard.reflection.copy()
    silent[2] = 0.0
    wave = refined(likelihood, heard.lines, silent, 0.0, 5)
    np.testing.assert_array_equal(wave.walls.lines[2], heard.lines[2])
    assert wave.walls.reflection[2] == 0.0
    assert wave.value < at(likelihood, heard.lines, heard.reflection, 0.0, 5, derive=False).value - 1000.0


def test_the_residual_is_the_power_of_the_samples_less_the_prediction(pentagon_heard, synthesise):
    heard = pentagon_heard
    likelihood = WaveformLikelihood(heard.data)
    wave = at(likelihood, heard.lines, heard.reflection, 0.0, 2)
    templates = synthesise(heard.lines, heard.reflection, heard.data.positions, 2)
    predicted = heard.sigma * wave.amplitudes[:, None] * np.real(templates * np.exp(1j * wave.phase))
    parameters = heard.scene.parameters(Parameters())
    listener = Listener(parameters, BeamformingMap(parameters.grid).r_m)
    left = likelihood.residual_power(wave, 2)
    stride = round(heard.data.cell_m / heard.data.pulse.step_m)
    for ping, row in zip(heard.samples - predicted, left, strict=True):
        echo = listener.hear(Ping(0, ping, 1e-6)).echo * np.linalg.norm(ping) / heard.sigma
        expected = 0.5 * np.abs(echo[::stride][:len(row)]) ** 2
        error = np.abs(np.sqrt(row) - np.sqrt(expected))[10:]
        assert error.max() < 0.05 * np.sqrt(heard.data.power.max())  # where two tails that are cut meet
        assert np.median(error) < 0.01


def test_the_truth_leaves_noise(in_pentagon):
    heard, likelihood = in_pentagon, WaveformLikelihood(in_pentagon.data)
    wave = at(likelihood, heard.lines, heard.reflection, 0.0, 5)
    first = heard.data.first_cell
    left = likelihood.residual_power(wave, 5)[:, first:]
    assert heard.data.power[:, first:].mean() > 3.0
    assert left.mean() == pytest.approx(1.0, abs=0.05)
    for level in (0.5, 1.0, 2.0, 4.0):
        assert np.mean(left > level) == pytest.approx(np.exp(-level), abs=0.03)


@pytest.mark.parametrize(('order', 'reflection'), [(3, 1.0), (4, 1.0), (8, 0.9)])
def test_orders_that_a_simulation_leaves_out_have_no_strength(order, reflection):
    """Of those that it has, all have the same, and nothing is left but noise."""
    scene = dataclasses.replace(random_scene(202, 4), order=order, reflection=reflection, snr_db=10.0)
    mapper = listen(scene)
    search = search_of(mapper.evidence, mapper.parameters)
    walls = Walls(polygon_lines(mapper.start_pose.inverse().apply(scene.vertices)), np.full(4, reflection))
    wave = search.wave.evaluate(walls, search.wave.begun(walls), 2)
    strengths, left = search.wave.by_order(wave, 8)
    assert strengths[:order] == pytest.approx(np.full(order, strengths[0]), rel=0.1)  # of the eighth little is heard
    assert np.all(strengths[order:] < 0.02 * strengths[0])
    heard = slice(search.data.first_cell, None)
    assert left[:, heard].mean() - 1.0 < 0.01 * (search.data.power[:, heard].mean() - 1.0)


def test_between_samples_stands_the_cubic_through_four_of_them():
    """Value and slope, against scipy's polynomial through the same points."""
    generator = np.random.default_rng(1)
    samples = generator.normal(size=12) + 1j * generator.normal(size=12)
    for at in generator.uniform(1.0, 10.0, size=50):
        around = np.arange(int(at) - 1, int(at) + 3)
        through = KroghInterpolator(around, samples[around])
        value, slope = cubic(samples, at)
        assert value == pytest.approx(complex(through(at)), rel=1e-9)
        assert slope == pytest.approx(complex(through.derivative(at)), rel=1e-9)
