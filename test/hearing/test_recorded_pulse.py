"""A recorded pulse has the sample period of the pings, whatever that is, and gives what the pulse itself gives."""

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import RecordedPulse
from polymap_ros.errors import BadPing, ParameterError
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.listening import Listener
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

SPEED, WALL_M, FREQUENCY_HZ = 340.0, 0.85, 1e5
AIR = {'medium.model': 'constant', 'medium.speed_m_s': SPEED, 'medium.spreading_exponent': 0.0}
RANGES = np.arange(601) * 0.005


def burst(t):
    """Five cycles under a Hann window: the source of both the pulse's file and the echo."""
    inside = (t >= 0.0) & (t <= 5e-5)
    return np.where(inside, np.sin(2e5 * np.pi * t) * np.sin(2e4 * np.pi * t) ** 2, 0.0)


def ping(period_s):
    t = np.arange(round(9e-3 / period_s)) * period_s
    return Ping(0, burst(t - 2.0 * WALL_M / SPEED), period_s)


def listener(period_s, known_s=0.0):
    samples = burst(np.arange(round(5e-5 / period_s) + 1) * period_s)
    parameters = Parameters().replaced(AIR | {'pulse.kind': 'file', 'pulse.path': 'p.npy'})
    return Listener(parameters, RANGES, RecordedPulse(samples, known_s))


@pytest.mark.parametrize('cycles_a_sample', [0.05, 0.125, 0.21])
def test_the_envelope_is_that_of_the_samples_themselves(cycles_a_sample):
    """Reference: the magnitude of the plain correlation over samples, which knows no frequency and no axis of ours."""
    period_s = cycles_a_sample / FREQUENCY_HZ
    heard = ping(period_s)
    ears = listener(period_s).at(period_s)
    ears.admission.check(heard)
    echo = ears.hear(heard)
    fine_m = np.linspace(0.0, 3.0, ears.n_fine)
    peak = int(np.abs(echo.echo).argmax())
    assert abs(echo.echo[peak]) == pytest.approx(1.0, abs=0.01)
    assert fine_m[peak] == pytest.approx(WALL_M, abs=fine_m[1])
    dense_s = np.arange(-4e-5, 4e-5, 1e-7)
    t = np.arange(-5e-5, 1e-4, 1e-7)
    reference = np.array([burst(t) @ burst(t - lag) for lag in dense_s])
    reference /= reference.max()
    lags_s = 2.0 * (fine_m - WALL_M) / SPEED
    near = np.abs(lags_s) < 3.5e-5
    np.testing.assert_allclose(echo.echo.real[near], np.interp(lags_s[near], dense_s, reference), atol=0.02)
    assert ears.pulse_s == pytest.approx(5e-5, rel=0.05)


def test_the_axis_is_fine_enough_for_the_pulse_at_its_own_period():
    """Taken for one of eight samples a cycle, one of fifty would have a sixth of its band, and too coarse an axis."""
    fine, usual, coarse = (listener(period_s).at(period_s).fold for period_s in (2e-7, 1.25e-6, 2.5e-6))
    assert fine == usual
    assert 0.75 * usual < coarse <= usual


def test_two_rates_are_refused_by_name():
    from_header = listener(1e-6, known_s=1e-6)
    from_header.admission.check(ping(1e-6))
    with pytest.raises(BadPing, match=r'pulse\.path is sampled at 1e\+06 Hz, the echoes at 800000 Hz; resample') as bad:
        from_header.at(1.25e-6).admission.check(ping(1.25e-6))
    assert bad.value.reason == 'bad_shape'
    with pytest.raises(BadPing, match=r'pulse\.path is sampled at 1e\+06 Hz'):
        listener(1e-6).at(1e-6).admission.check(ping(1.25e-6))


def test_a_whole_recording_is_no_pulse():
    """Told before anything is done with it, or where its period is that of the pings, at the first of them."""
    whole = np.random.default_rng(3).normal(size=10_000)
    r_m = BeamformingMap(Parameters().grid).r_m
    of_file = Parameters.of(pulse={'kind': 'file', 'path': 'p.npy'})
    with pytest.raises(ParameterError, match=r'pulse\.path: it lasts 0\.01 s, and pings are listened to for 0\.00'):
        Listener(of_file, r_m, RecordedPulse(whole, 1e-6))
    with pytest.raises(BadPing, match=r'pulse\.path: it lasts 0\.01 s.*cut it to the pulse alone'):
        Listener(of_file, r_m, whole).at(1e-6)
    with pytest.raises(ParameterError, match=r'pulse\.path: RecordedPulse\(1000000 samples'):
        Listener(of_file, r_m, np.tile(whole, 100))


def fed(scene, pulse, **changes):
    kind = {'pulse.kind': 'file', 'pulse.path': 'p.npy'} if pulse is not None else {}
    mapper = PolygonMapper(scene.parameters(Parameters().replaced(changes)).replaced(kind), pulse)
    for k, (pose, samples) in enumerate(zip(scene.poses, simulate(scene), strict=True)):
        mapper.add_pose(k, Pose(*pose))
        mapper.add_ping(Ping(k, samples, scene.period_s))
    return mapper


def test_a_plate_is_mapped_as_by_the_burst_itself_and_goes_on_from_a_state():
    scene = load_scene('triangle')
    t = np.arange(21) * scene.period_s
    pulse = (0.5 - 0.5 * np.cos(1e5 * np.pi * t)) * np.sin(2e5 * np.pi * t)
    expected, mapper = fed(scene, None), fed(scene, pulse)
    found = mapper.solve()
    np.testing.assert_allclose(found.polygon.vertices, expected.solve().polygon.vertices, atol=2e-5)
    again = PolygonMapper.from_state(mapper.parameters, mapper.state(), pulse)
    again.add_ping(Ping(10**9, simulate(scene)[0], 1.25e-6))
    assert 'the echoes at 800000 Hz' in again.intake.last_drop_texts['bad_shape']
    np.testing.assert_array_equal(again.solve().polygon.vertices, found.polygon.vertices)
