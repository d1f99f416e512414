"""The compressed pulse: known shapes, and what the echoes of eq. (3) really look like."""

import numpy as np
import pytest

from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.hearing.listening import Listener
from polymap_ros.hearing.pulse_shape import PulseShape
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.waveforms import Synthesis

AIR = {'medium.model': 'constant', 'pulse.frequency_hz': 20000.0, 'grid.range_max_m': 12.0}
CHIRP = {**AIR, 'pulse.kind': 'chirp', 'pulse.bandwidth_hz': 20000.0, 'pulse.duration_s': 2e-3}


def shape_and_listener(changes):
    parameters = Parameters().replaced(changes)
    listener = Listener(parameters, BeamformingMap(parameters.grid).r_m)
    return listener.shape, listener, parameters


def test_a_gaussian_is_known_by_heart():
    step, sigma, carrier = 1e-3, 0.01, 300.0
    lags = step * np.arange(-400, 401)
    shape = PulseShape.of(np.exp(-0.5 * (lags / sigma) ** 2 + 2j * carrier * lags), step)
    near = step * np.arange(-2, len(shape.baseband) - 2)
    gauss = np.exp(-0.5 * (near / sigma) ** 2)
    second = (near**2 / sigma**4 - 1.0 / sigma**2 - 4.0 * carrier**2 - 4j * carrier * near / sigma**2) * gauss
    assert shape.step_m == step
    assert shape.carrier == pytest.approx(carrier)
    np.testing.assert_allclose(shape.baseband, gauss, atol=1e-12)
    np.testing.assert_allclose(shape.curvature, second, atol=1e-5 * abs(second[2]))
    np.testing.assert_allclose(shape.power, gauss[2:-2] ** 2, atol=1e-12)
    assert shape.width_m == pytest.approx(np.sqrt(np.pi) * sigma, rel=1e-6)
    cut = 2.0 * np.sum(np.exp(-((lags[lags > 0] / sigma) ** 2))[len(shape.power) - 1:]) * step
    assert cut < 1.5e-3 * shape.width_m


def test_a_blurred_gaussian_is_a_wider_one_of_the_same_power():
    step, sigma, blur = 1e-3, 0.01, 0.012
    lags = step * np.arange(-400, 401)
    shape = PulseShape.of(np.exp(-0.5 * (lags / sigma) ** 2 + 600j * lags), step).blurred(blur)
    before, after = sigma / np.sqrt(2.0), np.hypot(sigma / np.sqrt(2.0), blur)
    ranges = step * np.arange(len(shape.power))
    expected = before / after * np.exp(-0.5 * (ranges / after) ** 2)
    np.testing.assert_allclose(shape.power, expected, atol=2e-3)
    assert shape.power[-1] < 2e-3
    assert shape.width_m == pytest.approx(step * (2.0 * shape.power.sum() - shape.power[0]), rel=2e-3)


@pytest.mark.parametrize('changes', [{}, AIR, CHIRP, {'pulse.cycles': 5.0}])
def test_a_walls_echo_looks_like_it(changes):
    """Eq. (3) on synthesised samples, after a path of 2 m, on the fine axis about 1 m."""
    shape, listener, parameters = shape_and_listener(changes)
    period = 0.1 / parameters.pulse.frequency_hz
    synthesis = Synthesis(make_medium(parameters.medium), make_pulse(parameters.pulse), 4096, period)
    echo = listener.hear(Ping(0, synthesis(np.array([2.0]), np.ones(1)), period)).echo
    middle, n = round(1.0 / shape.step_m), len(shape.power)
    distance = 1.0 - middle * shape.step_m  # of the wall beyond the sample
    assert abs(distance) < 1e-9  # the fine axis divides that of the ranges
    lags = np.arange(-2, n + 2)
    expected = shape.baseband * np.exp(2j * shape.carrier * shape.step_m * lags)
    np.testing.assert_allclose(echo[middle + lags], expected, atol=5e-3)
    np.testing.assert_allclose(echo[middle - lags], np.conj(expected), atol=5e-3)
    energy = np.sum(np.abs(echo[middle - n + 1:middle + n]) ** 2)
    assert energy == pytest.approx(np.sum(np.abs(echo) ** 2), rel=5e-3)
    assert shape.width_m == pytest.approx(shape.step_m * energy, rel=5e-3)
    wavenumbers = 2.0 * np.pi * np.fft.fftfreq(len(echo), shape.step_m)
    second = np.fft.ifft(-(wavenumbers**2) * np.fft.fft(echo))  # exact, since the band ends below the Nyquist number
    expected = shape.curvature * np.exp(2j * shape.carrier * shape.step_m * lags)
    np.testing.assert_allclose(second[middle + lags], expected, atol=0.01 * abs(shape.curvature[2]))


def test_a_pulse_wider_than_the_axis_is_cut():
    shape = PulseShape.of(np.ones(41, complex), 1e-3)
    assert len(shape.power) == 16
    assert len(shape.baseband) == len(shape.curvature) == 20
