"""Eq. (3) against the brute force: a time-domain template per range, cross-correlated sample by sample."""

import numpy as np
import pytest

from polymap_ros.acoustics.matched_filter import EnvelopeFilter, MatchedFilter
from polymap_ros.acoustics.medium import ConstantSpeed, LambA0
from polymap_ros.acoustics.pulse import Chirp, RecordedPulse, ToneBurst

PLATE, AIR, WATER = LambA0(0.006, 6149.0, 3097.0), ConstantSpeed(343.0), ConstantSpeed(1480.0)


def sweep(t):
    """15 to 25 kHz in 2 ms."""
    wave = np.sin(2 * np.pi * (15e3 * t + 2.5e6 * t**2)) * np.sin(np.pi * t / 2e-3) ** 2
    return np.where((t >= 0) & (t <= 2e-3), wave, 0.0)


# medium, frequency of a 2-cycle burst, wall [m], end and step of the axis [m], samples, period [s], t0 [s]
BURSTS = {
    'plate, the paper': (PLATE, 1e5, 1.0, 3.0, 5e-3, 2048, 1e-6, 0.0),
    'plate, far wall': (PLATE, 1e5, 2.6, 3.0, 5e-3, 2048, 1e-6, 0.0),
    'plate, coarse axis': (PLATE, 1e5, 1.5, 3.0, 5e-2, 2048, 1e-6, 0.0),
    'plate, fine axis': (PLATE, 1e5, 1.2, 1.6, 2e-4, 1200, 1e-6, 0.0),
    'plate, late start': (PLATE, 1e5, 1.5, 2.0, 5e-3, 1100, 1e-6, 3e-4),
    'plate, samples before emission': (PLATE, 1e5, 1.0, 3.0, 5e-3, 3000, 1e-6, -1e-3),
    'plate, many samples': (PLATE, 1e5, 3.0, 4.0, 5e-3, 16384, 5e-7, 0.0),
    'plate, odd sizes': (PLATE, 1e5, 1.0, 1.61, 7e-3, 1201, 1e-6, 0.0),
    'plate, a small one': (PLATE, 1e5, 0.15, 0.2, 1e-3, 256, 1e-6, 0.0),
    'thick plate, 30 kHz': (LambA0(0.012, 5960.0, 3235.0), 3e4, 2.0, 4.0, 1e-2, 2048, 3e-6, 0.0),
    'water, copper plate': (WATER, 1.9e6, 0.05, 0.09, 5e-5, 6000, 1e-8, 5.5e-5),
    'air': (AIR, 4e4, 4.0, 6.0, 2e-3, 8192, 5e-6, 0.0),
}


def brute_force(z, medium, wave, ranges, wall, receive, n, period, t0):
    """c(r) = <z, zhat_r> / (|z| |zhat_r|) with the analytic template.

    |zhat_r| counts the whole echo, also where the window holds a part of it: that of the wall, spread to r.
    """
    whole = np.linalg.norm(receive(medium, wave, 2 * wall, 2 * n, period).real)
    values = []
    for r in ranges:
        template = receive(medium, wave, 2 * r, n, period, t0)
        values.append(z @ template.conj() / np.linalg.norm(z) / whole * (r / wall) ** medium.spreading)
    return np.array(values)


@pytest.mark.parametrize('name', BURSTS)
@pytest.mark.parametrize('noisy', [False, True], ids=['clean', '0 dB'])
def test_eq_3_is_the_normalised_correlation_with_the_expected_echo(name, noisy, burst, receive):
    medium, frequency, wall, end, step, n, period, t0 = BURSTS[name]
    ranges = step * np.arange(round(end / step) + 1)

    def wave(t):
        return burst(t, frequency)

    z = receive(medium, wave, 2 * wall, n, period, t0).real
    if noisy:
        z = z + np.random.default_rng(5).normal(scale=z.std(), size=n)
    result = MatchedFilter(medium, ToneBurst(frequency, 2.0), ranges, n, period, t0)(z)
    assert result.dtype == np.complex64
    near = np.flatnonzero(np.abs(ranges - wall) < 12 * step)
    some = np.unique(np.concatenate([near, np.linspace(1, len(ranges) - 1, 25).astype(int)]))
    expected = brute_force(z, medium, wave, ranges[some], wall, receive, n, period, t0)
    assert np.abs(result[some] - expected).max() < 1.5e-3 * np.abs(expected).max()


@pytest.mark.parametrize('noisy', [False, True], ids=['clean', '0 dB'])
def test_eq_3_compresses_a_chirp_analytic_or_recorded(noisy, receive):
    ranges = 5e-3 * np.arange(801)
    z = receive(AIR, sweep, 6.0, 3000, 1e-5).real
    if noisy:
        z = z + np.random.default_rng(6).normal(scale=z.std(), size=len(z))
    some = np.arange(560, 641, 4)
    expected = brute_force(z, AIR, sweep, ranges[some], 3.0, receive, 3000, 1e-5, 0.0)
    chirp = Chirp(2e4, 1e4, 2e-3)
    for pulse in (chirp, RecordedPulse(chirp.samples(1e-5), 1e-5)):
        result = MatchedFilter(AIR, pulse, ranges, 3000, 1e-5)(z)
        assert np.abs(result[some] - expected).max() < 2e-3 * np.abs(expected).max()


def test_a_long_tone_in_a_wide_band_is_not_missed(receive, burst):
    """40 cycles of 40 kHz, 1 ms, sampled at 10 MHz: a band of 1/1000 of what the samples could hold."""
    n, period = 60_000, 1e-7

    def tone(t):
        return burst(t, 4e4, 40.0)

    ranges = 5e-3 * np.arange(161)
    z = receive(AIR, tone, 1.2, n, period).real
    result = MatchedFilter(AIR, ToneBurst(4e4, 40.0), ranges, n, period)(z)
    some = np.arange(100, 141, 5)
    expected = brute_force(z, AIR, tone, ranges[some], 0.6, receive, n, period, 0.0)
    assert np.abs(result[some] - expected).max() < 2e-3
    assert np.abs(result).argmax() == 120


def test_superposition_and_sign(plate, burst, receive):
    ranges = 5e-3 * np.arange(601)
    matched = MatchedFilter(plate, ToneBurst(1e5, 2.0), ranges, 2048, 1e-6)
    one, two = (receive(plate, burst, 2 * r, 2048, 1e-6).real for r in (0.8, 1.7))
    both = one - 0.4 * two
    scaled = matched(both) * np.linalg.norm(both)
    apart = matched(one) * np.linalg.norm(one) - 0.4 * matched(two) * np.linalg.norm(two)
    assert np.abs(scaled - apart).max() < 1e-5 * np.abs(apart).max()
    assert matched(one).real[160] > 0.999
    assert matched(-one).real[160] < -0.999


@pytest.mark.parametrize('scale', [1e-30, 1.0, 32768.0, 1e30])
def test_the_amplitude_s_unit_does_not_matter(scale, plate, burst, receive):
    ranges = 5e-3 * np.arange(601)
    matched = MatchedFilter(plate, ToneBurst(1e5, 2.0), ranges, 2048, 1e-6)
    z = receive(plate, burst, 2.0, 2048, 1e-6).real
    assert matched(scale * z) == pytest.approx(matched(z), abs=1e-6)


def test_silence_gives_zero(plate):
    ranges = 5e-3 * np.arange(601)
    assert np.all(MatchedFilter(plate, ToneBurst(1e5, 2.0), ranges, 2048, 1e-6)(np.zeros(2048)) == 0)
    assert np.all(EnvelopeFilter(343.0, 1e-5, ranges, 2048, 1e-6)(np.zeros(2048)) == 0)


def test_autocorrelation_is_the_answer_to_a_wall(plate, burst, receive):
    step, wall = 2e-3, 300
    ranges = step * np.arange(601)
    matched = MatchedFilter(plate, ToneBurst(1e5, 2.0), ranges, 2048, 1e-6)
    psi = matched.autocorrelation
    assert psi.shape == (1201,)
    assert psi[600] == pytest.approx(1.0)
    assert psi == pytest.approx(psi[::-1].conj(), abs=1e-9)
    answer = matched(receive(plate, burst, 2 * step * wall, 2048, 1e-6).real)
    assert np.abs(answer - psi[600 - wall:1201 - wall]).max() < 2e-3


def test_envelope_samples_lie_at_half_the_way_of_the_pulse_s_centre():
    """A ping of magnitudes with one Gaussian bump per wall, centred where the pulse's centre arrives."""
    period, t0, centre, speed = 1e-5, 2e-4, 3e-4, 343.0
    t = t0 + period * np.arange(3000)
    walls = np.array([0.7, 2.345])
    samples = sum(np.exp(-(((t - centre - 2 * wall / speed) / 1e-4) ** 2)) for wall in walls)
    ranges = 5e-3 * np.arange(801)
    result = EnvelopeFilter(speed, centre, ranges, 3000, period, t0)(samples)
    arrival = 2 * ranges[:, None] / speed
    expected = np.exp(-(((arrival - 2 * walls / speed) / 1e-4) ** 2)).sum(axis=1) / np.linalg.norm(samples)
    assert result.dtype == np.complex64
    assert np.abs(result - expected).max() < 3e-3 * expected.max()


def test_envelope_is_zero_where_no_sample_is():
    ranges = 1e-2 * np.arange(501)
    result = EnvelopeFilter(1000.0, 0.0, ranges, 1001, 1e-6, t0_s=1e-3)(np.full(1001, -2.0))
    inside = (ranges >= 0.5 - 1e-9) & (ranges <= 1.0 + 1e-9)
    assert np.all(result[~inside] == 0)
    assert np.abs(result[inside]) == pytest.approx(1001**-0.5)


@pytest.mark.parametrize(('name', 'least', 'most'), [
    ('plate, the paper', 0.875, 0.89), ('plate, late start', 0.875, 0.89), ('plate, a small one', 0.875, 0.93),
    ('thick plate, 30 kHz', 0.875, 0.89), ('water, copper plate', 0.999, 1.0), ('air', 0.999, 1.0)])
def test_up_to_a_range_seven_eighths_of_an_echo_s_energy_are_heard(name, least, most, burst, receive):
    """Of echoes from there and from a twentieth beyond, the energy in the ping's samples over that of all of it."""
    medium, frequency, _, end, step, n, period, t0 = BURSTS[name]
    matched = MatchedFilter(medium, ToneBurst(frequency, 2.0), step * np.arange(round(end / step) + 1), n, period, t0)

    def heard(wall):
        echo, whole = (np.sum(np.abs(receive(medium, lambda t: burst(t, frequency), 2 * wall, size, period, t0)) ** 2)
                       for size in (n, 2 * n))
        return echo / whole

    assert least <= heard(matched.heard_m) <= most
    assert heard(1.05 * matched.heard_m) < 0.875


def test_magnitudes_are_heard_up_to_a_whole_pulse_before_the_ping_is_over():
    matched = EnvelopeFilter(1000.0, 1e-4, 1e-2 * np.arange(501), 1001, 1e-6, t0_s=1e-3)
    assert matched.heard_m == pytest.approx(0.5 * 1000.0 * (1e-3 + 1e-3 - 2e-4))


def test_every_sixth_range_alone_is_every_sixth_of_all(plate):
    ranges = np.arange(1801) * 1e-3
    matched = MatchedFilter(plate, ToneBurst(1e5, 2.0), ranges, 2048, 1e-6, fold=6)
    samples = np.random.default_rng(2).normal(size=2048)
    np.testing.assert_allclose(matched(samples, finely=False), matched(samples)[::6], atol=1e-6)
