"""The steps before eq. (3), each against what it is for, on samples whose content is known."""

import numpy as np
import pytest
import scipy.signal

from polymap_ros.acoustics.front_end import (
    FrontEnd,
    band_pass,
    clipped,
    dropped_out,
    in_band,
    mute,
    time_gain,
    without_dc,
)
from polymap_ros.acoustics.matched_filter import MatchedFilter
from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.pulse import RecordedPulse, make_pulse
from polymap_ros.errors import ParameterError
from polymap_ros.parameters import FrontEndParameters, MediumParameters, PulseParameters
from polymap_ros.simulation.waveforms import Synthesis

N, PERIOD_S = 2048, 1e-6
MEDIUM = make_medium(MediumParameters())
PULSE = make_pulse(PulseParameters())
RANGES = 0.001 * np.arange(2000)


def echoes(*range_m, pulse=PULSE):
    return Synthesis(MEDIUM, pulse, N, PERIOD_S)(2.0 * np.array(range_m), np.ones(len(range_m)))


def noise(seed=0):
    return np.random.default_rng(seed).normal(size=N)


def test_clipping_is_where_the_converter_stood_at_its_end():
    wave = np.sin(2.0 * np.pi * 1e5 * PERIOD_S * np.arange(N)) + 0.01 * noise()
    assert not clipped(wave).any()
    np.testing.assert_array_equal(clipped(np.clip(wave, -0.7, 0.8)), (wave < -0.7) | (wave > 0.8))
    # Coarse steps repeat values everywhere, and the largest one rarely more than twice.
    assert clipped(np.round(noise() * 20.0)).mean() < 0.002


def test_a_dropout_is_a_run_of_equal_samples_of_any_value():
    samples = noise()
    assert not dropped_out(samples).any()
    samples[300:350] = 0.0
    samples[700:716] = samples[700]
    samples[900:915] = samples[900]
    np.testing.assert_array_equal(np.flatnonzero(dropped_out(samples)), [*range(300, 350), *range(700, 716)])


def test_dc_is_gone_from_every_ping_of_its_own():
    pings = np.array([noise(1) + 3.0, noise(2) - 5.0])
    np.testing.assert_allclose(without_dc(pings).mean(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(without_dc(pings)), np.diff(pings))


@pytest.mark.parametrize(('frequency_hz', 'left'), [(20e3, 0.0), (50e3, 0.5), (100e3, 1.0), (200e3, 0.5), (300e3, 0.0)])
def test_the_band_pass_lets_pass_what_is_inside(frequency_hz, left):
    tone = np.sin(2.0 * np.pi * frequency_hz * PERIOD_S * np.arange(N)) * scipy.signal.windows.hann(N)
    passed = in_band(tone, band_pass(N, PERIOD_S, 50e3, 200e3))
    assert np.linalg.norm(passed) / np.linalg.norm(tone) == pytest.approx(left, abs=0.12 if left == 0.5 else 1e-3)


def test_the_band_pass_does_not_move_echoes():
    correlate = MatchedFilter(MEDIUM, PULSE, RANGES, N, PERIOD_S)
    passed = in_band(echoes(0.5), band_pass(N, PERIOD_S, 60e3, 150e3))
    assert RANGES[np.abs(correlate(passed)).argmax()] == pytest.approx(0.5, abs=0.001)
    late = np.zeros(N)
    late[-30:] = 1.0
    assert np.abs(in_band(late, band_pass(N, PERIOD_S, 60e3, 150e3))[:200]).max() < 1e-3  # no ringing from the end


def test_muting_silences_what_comes_before_and_nothing_after():
    weights = mute(N, PERIOD_S, -1e-5, 1e-4, 2e-5)
    t = -1e-5 + PERIOD_S * np.arange(N)
    assert not weights[t < 8e-5 - 1e-9].any()
    assert np.all(weights[t >= 1e-4 - 1e-12] == 1.0)
    assert np.all(np.diff(weights) >= 0.0)


def test_gain_over_time_is_in_decibels_per_second():
    factors = time_gain(N, PERIOD_S, 5e-4, 40e3)
    assert 20.0 * np.log10(factors[0]) == pytest.approx(20.0)
    assert 20.0 * np.log10(factors[1000] / factors[0]) == pytest.approx(40.0)


def test_steps_that_are_off_leave_the_very_samples():
    samples = noise()
    front_end = FrontEnd(FrontEndParameters(), False, N, PERIOD_S, 0.0, 2e-5)
    assert front_end.levelled(samples) is samples
    assert front_end.limited(samples, 1e-4) is samples


def test_all_steps_together_and_magnitudes_stay_magnitudes():
    parameters = FrontEndParameters(
        remove_dc=True, band_low_hz=5e4, band_high_hz=2e5, mute_blanking=True, gain_db_s=1e3)
    front_end = FrontEnd(parameters, False, N, PERIOD_S, 0.0, 2e-5)
    samples = noise() + 2.0
    levelled = (samples - samples.mean()) * time_gain(N, PERIOD_S, 0.0, 1e3)
    np.testing.assert_allclose(front_end.levelled(samples), levelled)
    expected = in_band(levelled, band_pass(N, PERIOD_S, 5e4, 2e5)) * mute(N, PERIOD_S, 0.0, 1e-4, 2e-5)
    np.testing.assert_allclose(front_end.limited(levelled, 1e-4), expected)
    magnitudes = FrontEnd(FrontEndParameters(remove_dc=True), True, N, PERIOD_S, 0.0, 2e-5)
    assert magnitudes.limited(magnitudes.levelled(np.abs(noise())), 0.0).min() == 0.0


def width_m(envelope):
    """Width of the highest peak at half its height."""
    return scipy.signal.peak_widths(envelope, [int(envelope.argmax())])[0][0] * RANGES[1]


@pytest.mark.parametrize('pulse', [PULSE, RecordedPulse(np.diff(PULSE.samples(PERIOD_S) ** 3), PERIOD_S)])
def test_deconvolution_is_sharper_in_place_and_lets_as_much_noise_through(pulse):
    matched = MatchedFilter(MEDIUM, pulse, RANGES, N, PERIOD_S)
    wiener = MatchedFilter(MEDIUM, pulse, RANGES, N, PERIOD_S, wiener_noise=0.03)
    sharp, blunt = (np.abs(correlate(echoes(0.5, pulse=pulse))) for correlate in (wiener, matched))
    assert width_m(sharp) < 0.8 * width_m(blunt)
    assert RANGES[sharp.argmax()] == pytest.approx(0.5, abs=0.001)
    assert 0.5 < sharp.max() < blunt.max() <= 1.001
    # A wall's echo looks as the autocorrelation says, up to its height.
    expected = np.abs(wiener.autocorrelation[len(RANGES) - 1 - 500:][:len(RANGES)])
    assert expected[500] == pytest.approx(1.0)
    np.testing.assert_allclose(sharp / sharp.max(), expected, atol=0.02)
    for correlate in (wiener, matched):
        power = np.mean([np.mean(np.abs(correlate(noise(seed)))[100:1500] ** 2) for seed in range(20)])
        assert power * N / 2.0 == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize('wrong', [{'band_low_hz': 2e5, 'band_high_hz': 1e5}, {'common_pings': 3}, {'max_bad': 1.5}])
def test_parameters_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ParameterError, match='front_end'):
        FrontEndParameters(**wrong)
