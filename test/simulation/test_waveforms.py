"""The samples against independent sums over images, in the time and in the frequency domain."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.parameters import MediumParameters, PulseParameters
from polymap_ros.simulation import waveforms
from polymap_ros.simulation.clearance import half_planes
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import Synthesis, emitted, noise_free, simulate

WATER = MediumParameters(model='constant', speed_m_s=1480.0)
TONE = PulseParameters()


def burst(t):
    """Two cycles at 100 kHz under a Hann window, as a function of time [s]."""
    inside = (t >= 0.0) & (t <= 2e-5)
    return np.where(inside, np.sin(np.pi * t / 2e-5) ** 2 * np.sin(2.0 * np.pi * 1e5 * t), 0.0)


def plate_echo(distance, n=2048, t0=0.0, longer=64):
    """Echo of one path in the 6 mm plate, over the whole band and a period so long that nothing wraps."""
    n_long = n * longer
    omega = 2.0 * np.pi * np.fft.rfftfreq(n_long, 1e-6)[1:]
    medium = make_medium(MediumParameters())
    spectrum = make_pulse(TONE).spectrum(omega) * medium.excitability(omega) * distance**-0.5
    spectrum *= np.exp(1j * (omega * t0 - medium.wavenumber(omega) * distance))
    return np.fft.irfft(np.concatenate(([0.0], spectrum)), n_long)[:n] * 1e6


def images_by_pyroomacoustics(vertices, position, order, reflection):
    """Distances and amplitudes of the images that pyroomacoustics lists as audible at their own source."""
    pra = pytest.importorskip('pyroomacoustics')
    edges = [pra.Material(energy_absorption=1.0 - coefficient**2) for coefficient in reflection]
    room = pra.Room.from_corners(np.asarray(vertices).T, fs=16000, max_order=order, materials=edges)
    room.add_source(position)
    room.add_microphone(np.asarray(position))
    room.image_source_model()
    source = room.sources[0]
    heard = room.visibility[0][0].astype(bool) & (source.orders > 0)
    distance = np.linalg.norm(source.images[:, heard] - np.asarray(position)[:, None], axis=0)
    return distance, source.damping[0, heard]


def relative_error(samples, expected):
    return np.abs(samples - expected).max() / np.abs(expected).max()


def test_without_dispersion_every_echo_is_a_delayed_pulse():
    scene = Scene('water', [[0, 0], [0.7, 0], [0.9, 0.4], [0.1, 0.6]], [[0.4, 0.25, 0.0]], medium=WATER, snr_db=None,
                  order=1, reflection=[1.0, -0.5, 0.8, 0.3])
    expected = np.zeros(scene.n_samples)
    t = np.arange(scene.n_samples) * 1e-6
    corners = np.asarray(scene.vertices)
    for a, b, coefficient in zip(corners, np.roll(corners, -1, axis=0), scene.reflection, strict=True):
        unit = (b - a) / np.linalg.norm(b - a)
        path = 2.0 * abs(unit[0] * (0.25 - a[1]) - unit[1] * (0.4 - a[0]))
        expected += coefficient * burst(t - path / 1480.0) / path
    assert relative_error(noise_free(scene)[0], expected) < 3e-3


def test_magnitudes_are_those_of_the_sum_of_bursts_with_their_phases():
    """Under a Hann window of eight cycles the analytic signal is window times rotation, to a hundredth."""
    pulse = PulseParameters(cycles=8.0)
    room = Scene('water', [[0, 0], [0.7, 0], [0.9, 0.4], [0.1, 0.6]], [[0.4, 0.25, 0.0]], medium=WATER, snr_db=None,
                 order=1, reflection=[1.0, -0.5, 0.8, 0.3], pulse=pulse, echo_kind='envelope')
    normals, offsets = half_planes(room.vertices)
    distance = 2.0 * (offsets - normals @ room.poses[0, :2])
    after = np.arange(room.n_samples) * 1e-6 - distance[:, None] / 1480.0
    window = np.where((after >= 0.0) & (after <= 8e-5), np.sin(np.pi * after / 8e-5) ** 2, 0.0)
    amplitude = np.array([1.0, -0.5, 0.8, 0.3]) / distance
    expected = np.abs(amplitude @ (window * np.exp(2j * np.pi * 1e5 * after)))
    assert np.sum(window > 0.0, axis=0).max() > 1, 'echoes overlap'
    assert relative_error(simulate(room), expected) < 0.02
    assert room.parameters().echo.kind == 'envelope'


def test_noise_of_magnitudes_is_as_rayleigh_says():
    """Its mean square is twice that of the signal's noise, its mean sqrt(pi / 2) times that noise's deviation."""
    scene = dataclasses.replace(random_scene(1, 4), echo_kind='envelope', snr_db=-60.0)
    noise = np.sqrt(np.mean(noise_free(scene) ** 2, axis=1, keepdims=True)) * 1e3
    relative = simulate(scene) / noise
    assert np.mean(relative**2) == pytest.approx(2.0, rel=0.01)
    assert np.mean(relative) == pytest.approx(np.sqrt(np.pi / 2.0), rel=0.01)


def test_in_a_plate_one_wall_gives_the_dispersed_echo_of_its_path():
    scene = Scene('plate', [[0, 0], [9, 0], [9, 9], [0, 9]], [[4.5, 0.8, 0.0]], snr_db=None)
    assert relative_error(noise_free(scene)[0], plate_echo(1.6)) < 2e-3


def test_a_right_angled_corner_adds_one_echo_from_the_corner():
    scene = Scene('plate', [[0, 0], [9, 0], [9, 9], [0, 9]], [[0.3, 0.4, 0.0]], snr_db=None, order=2,
                  reflection=[0.9, 1.0, 1.0, -0.5])
    expected = 0.9 * plate_echo(0.8) - 0.5 * plate_echo(0.6) - 0.45 * plate_echo(1.0)
    assert relative_error(noise_free(scene)[0], expected) < 2e-3


def test_a_narrower_corner_adds_two_echoes_of_equal_length():
    angle, far = np.deg2rad(60.0), 9.0
    room = [[0, 0], [far, 0], [far * np.cos(angle), far * np.sin(angle)]]
    position = 0.5 * np.array([np.cos(angle / 2.0), np.sin(angle / 2.0)])
    scene = Scene('plate', room, [[*position, 0.0]], snr_db=None, order=2)
    expected = 2.0 * plate_echo(2 * 0.5 * np.sin(angle / 2.0)) + 2.0 * plate_echo(2 * 0.5 * np.sin(angle))
    assert relative_error(noise_free(scene)[0], expected) < 2e-3


@pytest.mark.parametrize('edges', [3, 5, 8])
def test_a_random_scene_is_the_sum_over_the_images_of_pyroomacoustics(edges):
    reflection = np.linspace(0.6, 1.0, edges)
    scene = dataclasses.replace(random_scene(4, edges), snr_db=None, order=4, reflection=reflection)
    scene = dataclasses.replace(scene, poses=scene.poses[[0, 31]])
    for position, samples in zip(scene.positions, noise_free(scene), strict=True):
        distances, amplitudes = images_by_pyroomacoustics(scene.vertices, position, 4, reflection)
        expected = sum(a * plate_echo(d, longer=8) for d, a in zip(distances, amplitudes, strict=True))
        assert relative_error(samples, expected) < 4e-3


def test_nothing_wraps_into_the_window(monkeypatch):
    """With the whole band, far images that reach the window late or never leave no trace at its start."""
    monkeypatch.setattr(waveforms, 'BAND_FLOOR', 1e-6)
    synthesis = Synthesis(make_medium(MediumParameters()), make_pulse(TONE), 2048, 1e-6)
    peak = np.abs(plate_echo(1.0)).max()
    for distance in (0.3, 5.0, 7.0, 60.0):
        error = np.abs(synthesis(np.array([distance]), np.array([1.0])) - plate_echo(distance, longer=64)).max()
        assert error < 2e-4 * peak, distance


@pytest.mark.parametrize('t0_s', [1.5e-4, -1.5e-4])
def test_the_first_sample_may_come_before_or_after_emission(t0_s):
    scene = Scene('plate', [[0, 0], [9, 0], [9, 9], [0, 9]], [[4.5, 0.8, 0.0]], snr_db=None, t0_s=t0_s)
    assert relative_error(noise_free(scene)[0], plate_echo(1.6, t0=t0_s)) < 2e-3


@pytest.mark.parametrize('snr_db', [0.0, -10.0, 20.0])
def test_noise_has_the_power_asked_for_in_every_ping(snr_db):
    scene = dataclasses.replace(random_scene(1, 4), snr_db=snr_db)
    clean = noise_free(scene)
    noise = simulate(scene) - clean
    ratio = 10.0 * np.log10(np.mean(clean**2, axis=1) / np.mean(noise**2, axis=1))
    np.testing.assert_allclose(ratio, snr_db, atol=0.6)  # 4.3 sigma of a power over 2,048 samples
    assert np.mean(ratio) == pytest.approx(snr_db, abs=0.08)
    spectrum = np.mean(np.abs(np.fft.rfft(noise / noise.std(axis=1, keepdims=True)))**2, axis=0) / 2048
    np.testing.assert_allclose(spectrum[1:-1].reshape(11, -1).mean(axis=1), 1.0, atol=0.06)


def test_gains_change_the_echoes_and_leave_the_noise():
    scene = dataclasses.replace(random_scene(1, 4), snr_db=0.0)
    varied = dataclasses.replace(scene, gain_range_db=6.0)
    clean = noise_free(scene)
    np.testing.assert_allclose(simulate(varied) - varied.gains()[:, None] * clean, simulate(scene) - clean, atol=1e-9)


def test_the_same_scene_gives_the_same_samples_and_another_seed_other_noise():
    scene = random_scene(1, 4)
    np.testing.assert_array_equal(simulate(scene), simulate(random_scene(1, 4)))
    other = dataclasses.replace(scene, seed=99)
    assert np.abs(np.corrcoef(scene.noise()[0], other.noise()[0])[0, 1]) < 0.1


def test_a_resonant_transducer_rings_as_its_differential_equation_says():
    """y'' + (w0 / Q) y' + w0^2 y = (w0 / Q) s', integrated step by step (Runge and Kutta)."""
    quality, centre_hz = 5.0, 0.94e5
    scene = dataclasses.replace(random_scene(1, 4), faults=Faults(transducer_q=quality, transducer_centre=0.94))
    pulse, w0, period_s = make_pulse(TONE), 2.0 * np.pi * centre_hz, 1e-6
    fine = pulse.samples(period_s / 40.0)
    times = np.arange(len(fine)) * period_s / 40.0

    def excitation(t):
        return np.interp(t, times, fine, right=0.0)

    def slope(t, state):
        # State: y and its integral times w0^2, so that no derivative of the excitation is needed.
        y, z = state
        return np.array((w0 / quality * (excitation(t) - y) - z, w0**2 * y))

    solved = solve_ivp(slope, (0.0, 1.2e-4), np.zeros(2), max_step=period_s / 20.0, rtol=1e-8, atol=1e-10,
                       t_eval=np.arange(0.0, 1.2e-4, period_s))
    found = emitted(scene).samples(period_s)[:len(solved.t)]
    np.testing.assert_allclose(found, solved.y[0], atol=2e-3 * np.abs(solved.y[0]).max())
