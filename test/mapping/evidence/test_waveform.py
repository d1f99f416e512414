"""The waveform likelihood against matched filters in the time domain, on samples of the full synthesis."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import hilbert

from polymap_ros.acoustics.image_sources import visible_images
from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.mapping.beamforming import BeamformingMap
from polymap_ros.mapping.evidence.waveform import WaveformLikelihood
from polymap_ros.mapping.lines import half_plane_polygon
from polymap_ros.mapping.listening import Listener
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.waveforms import Synthesis

N = 4096
"""Samples of a ping: even the third order is over before they end."""


@pytest.fixture(scope='module')
def synthesise(in_pentagon):
    """Analytic samples (N,) of the echoes within walls, one of 1 m being of norm 1."""
    scene = in_pentagon.scene
    synthesis = Synthesis(make_medium(scene.medium), make_pulse(scene.pulse), 2 * N, scene.period_s)
    norm = np.linalg.norm(synthesis(np.array([2.0]), np.array([np.sqrt(2.0)])))

    def templates(lines, reflection, positions, order):
        vertices, which = half_plane_polygon(lines)
        rows = []
        for position in positions:
            images = visible_images(vertices, position, order, np.asarray(reflection)[which])
            amplitude = images.amplitude * np.sqrt(2.0)  # of half the path's length
            rows.append(hilbert(synthesis(images.distance_m, amplitude) / norm)[:N])
        return np.array(rows)

    return templates


@pytest.fixture(scope='module')
def pentagon_heard(hear, pentagon, inside):
    reflection = np.array([1.0, -0.8, 0.7, 1.0, 0.9])
    return hear(pentagon, inside(pentagon, 12), order=3, reflection=reflection, n_samples=N, seed=5)


@pytest.fixture(scope='module')
def triangle_heard(hear, triangle, inside):
    return hear(triangle, inside(triangle, 12), order=2, n_samples=N, seed=7)


def ratio(heard, templates, phase):
    """Amplitudes and log likelihood ratio max(z.T, 0)^2 / (2 sigma^2 T.T) of each ping, from the samples."""
    waves = np.real(templates * np.exp(1j * phase))
    both, energy = np.sum(heard.samples * waves, axis=1), np.sum(waves**2, axis=1)
    both = np.maximum(both, 0.0)
    return both / energy / heard.sigma, both**2 / (2.0 * heard.sigma**2 * energy)


def prior(reflection):
    return 0.5 * np.sum(np.log(np.abs(reflection)) ** 2) / 0.35**2


@pytest.mark.parametrize('room', ['pentagon_heard', 'triangle_heard'])
@pytest.mark.parametrize('order', [1, 2, 3])
@pytest.mark.parametrize('scale', [0.0, 1e-4, 1e-3, 1e-2])
def test_equals_the_matched_filter_on_samples(room, order, scale, request, synthesise):
    heard = request.getfixturevalue(room)
    generator = np.random.default_rng(order)
    lines = heard.lines + scale * generator.normal(size=heard.lines.shape)
    reflection = heard.reflection * generator.uniform(0.5, 1.0, len(lines))
    wave = WaveformLikelihood(heard.data).evaluate(lines, reflection, 0.0, order)
    templates = synthesise(lines, reflection, heard.data.positions, order)
    amplitudes, ratios = ratio(heard, templates, wave.phase)
    assert wave.value + prior(reflection) == pytest.approx(ratios.sum(), rel=0.005, abs=2.0)
    np.testing.assert_allclose(wave.amplitudes, amplitudes, rtol=0.01, atol=0.02 * amplitudes.max())
    if scale < 1e-3:
        phases = np.linspace(-0.5, 0.5, 201)
        values = [ratio(heard, templates, phase)[1].sum() for phase in phases]
        assert wave.phase == pytest.approx(phases[np.argmax(values)], abs=0.01)


def test_a_device_that_turns_the_phase_changes_nothing_else(pentagon_heard):
    heard, turn = pentagon_heard, np.exp(0.7j)
    turned = dataclasses.replace(heard.data, signal=(heard.data.signal * turn).astype(np.complex64))
    one = WaveformLikelihood(heard.data).evaluate(heard.lines, heard.reflection, 0.0, 3)
    other = WaveformLikelihood(turned).evaluate(heard.lines, heard.reflection, 0.7, 3)
    assert other.phase == pytest.approx(one.phase + 0.7, abs=1e-5)
    assert other.value == pytest.approx(one.value, rel=1e-5)
    np.testing.assert_allclose(other.scores, one.scores, atol=1e-3 * np.abs(one.scores).max())


def differences(value, lines, reflection, steps=(1e-7, 1e-7, 1e-6)):
    """Central differences of value(lines, reflection) by r, theta and ln |rho| of each wall, one after the other."""
    slopes = []
    for wall in range(len(lines)):
        for axis, step in enumerate(steps):
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
def test_gradients_are_those_of_differences(room, order, request):
    heard = request.getfixturevalue(room)
    likelihood = WaveformLikelihood(heard.data)
    lines = heard.lines + np.random.default_rng(order).normal(size=heard.lines.shape) * (2e-4, 5e-4)
    wave = likelihood.evaluate(lines, heard.reflection, 0.0, order)

    def value(lines, reflection):
        return likelihood.evaluate(lines, reflection, wave.phase, order, derive=False).value + prior(reflection)

    gradient, expected = wave.scores.sum(axis=0), differences(value, lines, heard.reflection)
    scale = np.sqrt(np.diag(wave.information))
    assert np.abs(gradient / scale).max() > 3.0
    np.testing.assert_allclose(gradient / scale, expected / scale, rtol=0.01, atol=0.05)
    penalised, information = likelihood.penalised(wave)
    pull = np.log(np.abs(heard.reflection)) / 0.35**2
    np.testing.assert_allclose(penalised[2::3], gradient[2::3] - pull, rtol=1e-9)
    np.testing.assert_allclose(np.diag(information)[2::3], scale[2::3] ** 2 + 1.0 / 0.35**2, rtol=1e-5)


def test_each_pings_gradient_is_that_of_its_samples(triangle_heard, synthesise):
    heard = triangle_heard
    lines = heard.lines + np.random.default_rng(1).normal(size=(3, 2)) * (2e-4, 5e-4)
    wave = WaveformLikelihood(heard.data).evaluate(lines, heard.reflection, 0.0, 2)

    def shares(lines, reflection):
        return ratio(heard, synthesise(lines, reflection, heard.data.positions, 2), wave.phase)[1]

    expected = differences(shares, lines, heard.reflection, (1e-6, 1e-6, 1e-4))
    scale = np.sqrt(np.diag(wave.information))
    np.testing.assert_allclose(wave.scores / scale, expected.T / scale, rtol=0.05, atol=0.1)


@pytest.mark.parametrize(('room', 'order'), [('pentagon_heard', 1), ('pentagon_heard', 3), ('triangle_heard', 2)])
def test_information_is_that_of_the_samples(room, order, request, synthesise):
    """Fisher's information of Gaussian samples, from differences of their mean; the phase's taken off."""
    heard = request.getfixturevalue(room)
    likelihood = WaveformLikelihood(heard.data)
    wave = likelihood.evaluate(heard.lines, heard.reflection, 0.0, order)

    def mean(lines, reflection):
        echoes = synthesise(lines, reflection, heard.data.positions, order)
        return (wave.amplitudes[:, None] * np.real(echoes * np.exp(1j * wave.phase))).ravel()

    slopes = differences(mean, heard.lines, heard.reflection, (1e-6, 1e-6, 1e-4))
    scale = np.sqrt(np.sum(slopes**2, axis=1))
    slopes /= scale[:, None]
    expected, found = slopes @ slopes.T, wave.information / np.outer(scale, scale)
    places = np.arange(len(scale)) % 3 < 2
    for kind in (places, ~places):
        np.testing.assert_allclose(found[np.ix_(kind, kind)], expected[np.ix_(kind, kind)], atol=0.02)
    assert not np.any(found[np.ix_(places, ~places)])  # taken as independent, which overlapping echoes are not quite
    assert np.abs(expected[np.ix_(places, ~places)]).max() < 0.15

    echoes = synthesise(heard.lines, heard.reflection, heard.data.positions, order)
    turn = (wave.amplitudes[:, None] * np.real(1j * echoes * np.exp(1j * wave.phase))).ravel()
    _, ridged = likelihood.penalised(wave)
    taken = (ridged - likelihood.marginal_information(wave, order)) / np.outer(scale, scale)
    cross = slopes @ turn
    np.testing.assert_allclose(taken, np.outer(cross, cross) / (turn @ turn), atol=0.02)


@pytest.mark.parametrize('order', [1, 3])
def test_the_likelihood_bends_as_the_information_says(order, hear, pentagon, inside, synthesise):
    """Without noise, along random directions from the truth, with the phase and all amplitudes at their best."""
    heard = hear(pentagon, inside(pentagon, 12), order=order, clean=True)
    likelihood = WaveformLikelihood(heard.data)
    wave = likelihood.evaluate(heard.lines, heard.reflection, 0.0, order)
    assert wave.phase == pytest.approx(0.0, abs=5e-3)
    assert np.abs(wave.scores.sum(axis=0) / np.sqrt(np.diag(wave.information))).max() < 0.05 * np.sqrt(wave.value)
    generator = np.random.default_rng(order)
    for _ in range(3):
        way = generator.normal(size=(5, 2)) * (1e-5, 2e-5)

        def templates(share, way=way):
            lines = heard.lines + share * way
            return synthesise(lines, heard.reflection, heard.data.positions, order)

        mean = wave.amplitudes[:, None] * np.real(templates(0.0))
        slope = wave.amplitudes[:, None] * np.real(templates(0.5) - templates(-0.5))
        turn = wave.amplitudes[:, None] * np.real(1j * templates(0.0))
        nuisances = np.zeros((13, *mean.shape))
        nuisances[0] = turn
        nuisances[range(1, 13), range(12)] = mean
        basis = nuisances.reshape(13, -1).T
        left = slope.ravel() - basis @ np.linalg.lstsq(basis, slope.ravel(), rcond=None)[0]
        values = [likelihood.evaluate(heard.lines + share * way, heard.reflection, 0.0, order, derive=False).value
                  for share in (-1.0, 0.0, 1.0)]
        assert 2.0 * values[1] - values[0] - values[2] == pytest.approx(left @ left, rel=0.03)


@pytest.mark.parametrize('seed', range(4))
def test_signs_and_phase_are_told_from_the_first_order(seed, hear, pentagon, inside):
    generator = np.random.default_rng(seed)
    reflection = generator.uniform(0.5, 1.0, 5) * np.where(np.arange(5) == generator.integers(5), -1.0, 1.0)
    heard = hear(pentagon, inside(pentagon, 30), reflection=reflection, seed=seed)
    turned = dataclasses.replace(heard.data, signal=(heard.data.signal * np.exp(2.0j)).astype(np.complex64))
    loss = 2.0 * np.log(np.abs(heard.reflection))
    for data, phase in ((heard.data, 0.0), (turned, 2.0)):
        found, device = WaveformLikelihood(data).signs(heard.lines, loss)
        np.testing.assert_allclose(found, heard.reflection, rtol=1e-6)
        assert np.angle(np.exp(1j * (device - phase))) == pytest.approx(0.0, abs=0.3)


def test_refining_returns_to_the_walls(in_pentagon):
    heard, likelihood = in_pentagon, WaveformLikelihood(in_pentagon.data)
    truth = likelihood.evaluate(heard.lines, heard.reflection, 0.0, 5)
    start = heard.lines + np.random.default_rng(2).normal(size=(5, 2)) * (1e-4, 3e-4)
    wave = likelihood.refine(start, heard.reflection, 0.0, 5)
    assert truth.value < wave.value < truth.value + 30.0  # half a chi-square of 15 parameters
    errors = np.abs(wave.lines - heard.lines)
    deviations = np.sqrt(np.diag(np.linalg.inv(likelihood.marginal_information(wave, 5)))).reshape(5, 3)
    assert np.all(errors < 4.0 * deviations[:, :2])
    assert errors[:, 0].max() < 1e-4
    assert likelihood.refine(heard.lines[:2], heard.reflection[:2], 0.0, 5) is None


@pytest.mark.parametrize('shift_m', [-2e-4, 1e-4])
def test_refining_does_not_stop_where_range_and_phase_trade(shift_m, hear, triangle, inside):
    """All walls further out by the same and the phase turned to match: the first order hardly tells."""
    heard = hear(triangle, inside(triangle, 60), seed=11)
    likelihood = WaveformLikelihood(heard.data)
    best = likelihood.refine(heard.lines, heard.reflection, 0.0, 5, 30)
    phase = -2.0 * heard.data.pulse.carrier * shift_m
    wave = likelihood.refine(heard.lines + (shift_m, 0.0), heard.reflection, phase, 5, 8)
    assert wave.value == pytest.approx(best.value, abs=1.0)
    assert wave.phase == pytest.approx(best.phase, abs=2e-3)
    np.testing.assert_allclose(wave.lines[:, 0], best.lines[:, 0], atol=3e-6)


def test_what_is_not_heard_is_held_fast(in_pentagon):
    heard, likelihood = in_pentagon, WaveformLikelihood(in_pentagon.data)
    silent = heard.reflection.copy()
    silent[2] = 0.0
    wave = likelihood.refine(heard.lines, silent, 0.0, 5)
    np.testing.assert_array_equal(wave.lines[2], heard.lines[2])
    assert wave.reflection[2] == 0.0
    assert wave.value < likelihood.evaluate(heard.lines, heard.reflection, 0.0, 5, derive=False).value - 1000.0


def test_the_residual_is_the_power_of_the_samples_less_the_prediction(pentagon_heard, synthesise):
    heard = pentagon_heard
    likelihood = WaveformLikelihood(heard.data)
    wave = likelihood.evaluate(heard.lines, heard.reflection, 0.0, 2)
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
    wave = likelihood.evaluate(heard.lines, heard.reflection, 0.0, 5)
    first = heard.data.first_cell
    left = likelihood.residual_power(wave, 5)[:, first:]
    assert heard.data.power[:, first:].mean() > 3.0
    assert left.mean() == pytest.approx(1.0, abs=0.05)
    for level in (0.5, 1.0, 2.0, 4.0):
        assert np.mean(left > level) == pytest.approx(np.exp(-level), abs=0.03)
