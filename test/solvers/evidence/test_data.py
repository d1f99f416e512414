"""Echoes in units of the noise: what is noise has variance 1, what is an echo keeps its place, phase and power."""

import dataclasses

import numpy as np
import pytest
from heard_scenes import hear
from references import inside

from polymap_ros.acoustics.ping import Ping
from polymap_ros.hearing.listening import Listener
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.parameters import Parameters, SensorParameters
from polymap_ros.simulation.scenes import Scene
from polymap_ros.solvers.evidence.data import EchoData

PARAMETERS = Parameters()


@pytest.fixture(scope='module')
def listener():
    return Listener(PARAMETERS, BeamformingMap(PARAMETERS.grid).r_m)


@pytest.fixture(scope='module')
def noise(listener):
    """Soundings of white noise alone, with the noise that the listener tells, at random places."""
    generator = np.random.default_rng(4)
    return [Sounding(0, *generator.uniform(0.0, 0.5, 2), *listener.hear(Ping(0, generator.normal(size=2048), 1e-6)))
            for _ in range(200)]


def data_of(soundings, listener, blanking_m=0.02):
    return EchoData.of(soundings, listener.shape, 0.5, blanking_m)


def test_noise_has_variance_one_in_each_part_and_an_exponential_power(noise, listener):
    data = data_of(noise, listener)
    middle = data.signal[:, 100:int(2.6 / data.pulse.step_m)]  # what is beyond is heard in part
    assert np.var(middle.real) == pytest.approx(1.0, abs=0.03)
    assert np.var(middle.imag) == pytest.approx(1.0, abs=0.03)
    assert abs(np.mean(middle)) < 0.03
    power = data.power[:, data.first_cell:-10]
    assert power.mean() == pytest.approx(1.0, abs=0.03)
    for level in (0.3, 1.0, 3.0):
        assert np.mean(power > level) == pytest.approx(np.exp(-level), abs=0.02)
    assert np.mean(data.filling == 0.0) > 0.98


def test_independent_cells_are_counted_right(listener):
    """The variance of a ping's mean power, in units of noise that is known, is that of so many exponentials."""
    generator = np.random.default_rng(5)
    soundings = []
    for samples in generator.normal(size=(400, 2048)):
        echo, envelope, rho, *_ = listener.hear(Ping(0, samples, 1e-6))
        soundings.append(Sounding(0, 0.0, 0.0, echo, envelope, rho, 1.0 / np.linalg.norm(samples)))
    data = data_of(soundings, listener)
    power = data.power[:, data.first_cell:-10]
    assert np.var(power.mean(axis=1)) == pytest.approx(1.0 / (data.weight * power.shape[1]), rel=0.2)


def test_power_is_that_of_the_signal_at_the_cells(in_pentagon):
    data = in_pentagon.data
    stride = round(data.cell_m / data.pulse.step_m)
    assert data.cell_m == pytest.approx(stride * data.pulse.step_m)
    assert 2.5 < data.pulse.width_m / data.cell_m < 3.6
    cells = data.signal[:, ::stride][:, :data.power.shape[1]]
    np.testing.assert_allclose(data.power, 0.5 * np.abs(cells) ** 2 + data.filling[:, None], rtol=1e-5)
    assert data.range_max_m < 3.0
    assert (data.power.shape[1] - 1) * data.cell_m <= data.range_max_m + data.cell_m
    assert data.extent_m == pytest.approx(np.hypot(*(data.positions.max(axis=0) - data.positions.min(axis=0))))


def test_the_signal_without_its_carrier_is_slow_and_keeps_the_phase(pentagon):
    heard = hear(pentagon, inside(pentagon, 3), clean=True, order=1)
    data, pulse = heard.data, heard.data.pulse
    turns = np.angle(data.signal[:, 1:] * np.conj(data.signal[:, :-1]))
    loud = np.abs(data.signal[:, 1:]) > 0.3 * np.abs(data.signal).max()
    assert np.abs(turns[loud]).max() < 0.2  # 2 k0 of the carrier would turn by 0.5 a step
    for i, (x, y) in enumerate(data.positions):
        d = (heard.lines[:, 0] - x * np.cos(heard.lines[:, 1]) - y * np.sin(heard.lines[:, 1])).min()
        cell = round(d / pulse.step_m)
        phase = np.angle(data.signal[i, cell] * np.exp(2j * pulse.carrier * d))
        assert phase == pytest.approx(0.0, abs=0.1)


def test_blurred_power_has_the_same_mean_and_an_echo_the_blurred_pulse(noise, listener, pentagon):
    quiet = data_of(noise, listener)
    blurred = quiet.blurred(0.01)
    near = slice(quiet.first_cell + 20, -30)
    np.testing.assert_allclose(blurred.power[:, near].mean(), quiet.power[:, near].mean(), rtol=5e-3)
    assert blurred.weight == quiet.weight
    heard = hear(pentagon, inside(pentagon, 1), clean=True, order=1)
    data = heard.data.blurred(0.01)
    cells = data.cell_m * np.arange(data.power.shape[1])
    d = np.sort(heard.lines[:, 0] - heard.data.positions[0] @ (np.cos(heard.lines[:, 1]), np.sin(heard.lines[:, 1])))
    power = np.zeros(len(cells))
    for distance in d:
        lags = np.abs(cells - distance) / data.pulse.step_m
        power += np.interp(lags, np.arange(len(data.pulse.power)), data.pulse.power, right=0.0) / distance
    first = np.abs(cells - d[0]) < 0.03
    shape = (data.power[0] - 1.0)[first] / power[first]
    np.testing.assert_allclose(shape, shape.mean(), rtol=0.1)


@pytest.mark.parametrize('n', [700, 1000, 2048, 8192])
def test_nothing_is_predicted_beyond_what_the_pings_can_tell(n, listener):
    """The axis ends where the slowest eighth of echoes, at 2,683 m/s, comes too late, or at 3 m; silence beyond is not
    taken for weak noise.
    """
    generator = np.random.default_rng(6)
    data = data_of([Sounding(0, 0.0, 0.0, *listener.hear(Ping(0, generator.normal(size=n), 1e-6)))
                    for _ in range(20)], listener)
    reach_m = 0.5 * 2683.0 * (n - 20) * 1e-6
    assert data.range_max_m == pytest.approx(min(reach_m, 2.98), abs=0.04)
    assert 0.0 <= data.range_max_m - data.cell_m * (data.power.shape[1] - 1) < data.cell_m
    assert np.median(data.filling) == 0.0
    near = (data.power - data.filling[:, None])[:, data.first_cell:round(0.8 * data.power.shape[1])]
    assert near.mean() == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize('blanking_m', [0.0, 0.02, 0.3])
def test_the_blanking_ends_after_a_pulse_at_least(noise, listener, blanking_m):
    data = data_of(noise[:3], listener, blanking_m)
    first_m = data.first_cell * data.cell_m
    assert max(blanking_m, data.pulse.width_m) <= first_m < max(blanking_m, data.pulse.width_m) + data.cell_m


def test_gains_are_the_echoes_powers(pentagon):
    """One place again and again, with gains over 12 dB in known noise."""
    heard = hear(pentagon, np.tile((0.5, 0.4), (30, 1)), snr_db=20.0, gain_range_db=0.0)
    factors = np.geomspace(0.5, 2.0, 30)
    echoes = heard.data.signal.astype(complex) * np.exp(2j * heard.data.pulse.carrier * heard.data.pulse.step_m
                                                        * np.arange(heard.data.signal.shape[1]))
    soundings = [Sounding(0, 0.0, 0.0, (factor * echo).astype(np.complex64), np.empty(0, np.float32), 0.0, 1.0)
                 for factor, echo in zip(factors, echoes, strict=True)]
    gain = EchoData.of(soundings, heard.data.pulse, 0.5, 0.02).gain
    np.testing.assert_allclose(gain, factors**2, rtol=0.1)
    assert np.median(gain) == pytest.approx(1.0)


def test_noise_that_counts_for_more_than_it_is_is_filled_up(noise, listener):
    quiet = [dataclasses.replace(each, noise=2.0 * each.noise) for each in noise]
    data = data_of(quiet, listener)
    np.testing.assert_allclose(data.filling, 0.75, atol=0.1)
    assert data.power[:, data.first_cell:-10].mean() == pytest.approx(1.0, abs=0.03)


def test_emitter_and_receiver_turn_with_the_sensor(noise, listener):
    """As the simulator places them on a robot of any heading."""
    sensor = SensorParameters(x_m=0.1, baseline_x_m=0.05, baseline_y_m=-0.02, baseline_z_m=0.3)
    poses = np.column_stack((np.random.default_rng(1).uniform(-0.5, 0.5, (6, 2)), np.linspace(-3.0, 3.0, 6)))
    scene = Scene('square', 2.0 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]), poses, sensor=sensor)
    soundings = [dataclasses.replace(each, x=x, y=y, yaw=yaw)
                 for each, (x, y), yaw in zip(noise, scene.positions, poses[:, 2], strict=False)]
    data = EchoData.of(soundings, listener.shape, 0.5, 0.02, (0.05, -0.02, 0.3))
    np.testing.assert_allclose(data.ends, np.column_stack((*scene.ends, np.full(6, 0.3))), atol=1e-12)


def test_the_shortest_edge_is_half_a_wavelength_or_of_magnitudes_a_pulses_width(noise, listener):
    data = data_of(noise[:3], listener)
    wavelength = 2.0 * np.pi / 315.89579  # of A0 at 100 kHz in 6 mm of aluminium
    assert data.shortest_m == pytest.approx(0.5 * wavelength, rel=0.06)  # the mean wavenumber of the burst
    assert data.soft_m == pytest.approx(0.1 * data.shortest_m)
    parameters = PARAMETERS.replaced({'echo.kind': 'envelope'})
    magnitudes = Listener(parameters, BeamformingMap(parameters.grid).r_m)
    samples = np.random.default_rng(2).rayleigh(size=(3, 2048))
    data = data_of([Sounding(0, 0.0, 0.0, *list(magnitudes.hear(Ping(0, each, 1e-6)))[:4]) for each in samples],
                   magnitudes)
    assert data.shortest_m == data.pulse.width_m
    assert 0.005 < data.shortest_m < 0.08


def test_the_loudness_cancels(noise, listener):
    generator = np.random.default_rng(8)
    samples = generator.normal(size=2048)
    one, other = (data_of([Sounding(0, 0.0, 0.0, *listener.hear(Ping(0, scale * samples, 1e-6)))], listener)
                  for scale in (1.0, 1e-6))
    np.testing.assert_allclose(one.power, other.power, rtol=1e-4)
