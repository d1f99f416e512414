"""One ping at its own place: what is refused and why, what is heard, and the filters that are kept."""

import numpy as np
import pytest

from polymap_ros.acoustics.matched_filter import EnvelopeFilter, MatchedFilter
from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.acoustics.ranging import closest_range
from polymap_ros.errors import BadPing, ParameterError
from polymap_ros.hearing.admission import MAX_SAMPLES, MAX_STEPS
from polymap_ros.hearing.listening import Listener
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.waveforms import Synthesis

RANGES = 0.005 * np.arange(601)
NOISE = np.random.default_rng(0).normal(size=2048).astype(np.float32)


def listener(**changes):
    return Listener(Parameters().replaced({name.replace('__', '.'): value for name, value in changes.items()}), RANGES)


def ping(samples=NOISE, period_s=1e-6, **rest):
    return Ping(0, samples, period_s, **rest)


def with_one(value):
    samples = NOISE.copy()
    samples[1000] = value
    return samples


@pytest.mark.parametrize(('bad', 'reason'), [
    (ping(with_one(np.nan)), 'bad_samples'),
    (ping(with_one(np.inf)), 'bad_samples'),
    (ping(np.zeros(2048, np.float32)), 'bad_samples'),
    (ping(NOISE.reshape(2, -1)), 'bad_shape'),
    (ping(np.full(2048, 'loud')), 'bad_shape'),
    (ping(NOISE.astype(complex)), 'bad_shape'),
    (ping(period_s=0.0), 'bad_shape'),
    (ping(period_s=-1e-6), 'bad_shape'),
    (ping(period_s=np.nan), 'bad_shape'),
    (ping(t0_s=np.inf), 'bad_shape'),
    (ping(period_s=6e-6), 'bad_shape'),
    (ping(np.empty(0, np.float32)), 'too_short'),
    (ping(NOISE[:20]), 'too_short'),
    (ping(t0_s=-0.00203), 'too_short'),
    (ping(range_min_m=3.2), 'too_short'),
    (ping(np.ones(MAX_SAMPLES + 1, np.float32)), 'too_long'),
    (ping(t0_s=1e6), 'too_long'),
    (ping(t0_s=-1e6), 'too_long'),
])
def test_what_cannot_be_used_is_refused_with_its_reason(bad, reason):
    with pytest.raises(BadPing) as caught:
        listener().admission.check(bad)
    assert caught.value.reason == reason
    assert str(caught.value)


@pytest.mark.parametrize(('limits', 'words'), [
    ({'range_min_m': 20.0, 'range_max_m': 3000.0}, r'range_min of the message is 20 m.*'
     r'20 looks like millimetres \(0\.02 m\) or centimetres \(0\.2 m\), ranges are in metres'),
    ({'range_max_m': 0.0025}, r'range_max of the message is 0\.0025 m.* looks like kilometres \(2\.5 m\), '),
    ({'range_max_m': 0.15}, 'range_max of the message is 0.15 m, which leaves nothing to hear')])
def test_a_limit_in_another_unit_is_called_by_its_field(limits, words):
    with pytest.raises(BadPing, match=words):
        listener(echo__blanking_m=0.2 if '0.15' in words else 0.01).admission.check(ping(**limits))


def test_a_time_zero_in_another_unit_is_named_and_not_the_period():
    with pytest.raises(BadPing, match=r'the first sample is 50 s after emission: echo\.t0_s is in seconds') as caught:
        listener().admission.check(ping(t0_s=50.0))
    assert 'too long for' not in str(caught.value)


def test_limits_that_leave_something_to_hear_pass():
    for limits in ({'range_min_m': 0.02}, {'range_min_m': 2.9}, {'range_max_m': 3000.0}, {'range_max_m': 0.05}):
        listener().admission.check(ping(**limits))


@pytest.mark.parametrize('good', [
    ping(), ping(NOISE.astype(np.float64)), ping(NOISE[:40]), ping(period_s=4.9e-6), ping(t0_s=5e-5), ping(t0_s=-1e-4),
    ping(NOISE.astype(np.float16)), ping(with_one(1e30)),
])
def test_what_can_be_used_passes(good):
    listener().admission.check(good)
    heard = listener().hear(good)
    assert np.all(np.isfinite(heard.envelope))


def test_the_memory_that_a_ping_can_ask_for_is_bounded():
    steps = 0.5 * 343.0 * MAX_SAMPLES * 1e-5 / 0.005
    assert steps < MAX_STEPS  # many samples alone are within
    slow = ping(np.ones(MAX_SAMPLES, np.float32), period_s=1e-3)
    with pytest.raises(BadPing, match='range'):
        listener(medium__model='constant', pulse__frequency_hz=100.0).admission.check(slow)


def test_magnitudes_need_no_period_fine_enough_for_the_carrier():
    listener(echo__kind='envelope').admission.check(ping(np.abs(NOISE), period_s=1e-5))


def test_hears_eq_3_and_the_closest_range():
    parameters = Parameters()
    expected = MatchedFilter(make_medium(parameters.medium), make_pulse(parameters.pulse), RANGES, 2048, 1e-6)(NOISE)
    heard = listener(echo__blanking_m=0.0).hear(ping())
    fold = (len(heard.echo) - 1) // 600  # the echo's axis may be finer than that of the ranges
    np.testing.assert_allclose(heard.echo[::fold], expected, atol=1e-5)
    np.testing.assert_allclose(heard.envelope, np.abs(expected), atol=1e-5)
    np.testing.assert_equal(heard.rho, closest_range(np.abs(heard.echo[::fold]), 0.005, 0.0))
    assert (heard.echo.dtype, heard.envelope.dtype) == (np.complex64, np.float32)


def test_hears_magnitudes():
    parameters = Parameters().replaced({'medium.model': 'constant', 'echo.kind': 'envelope'})
    pulse = make_pulse(parameters.pulse)
    samples = np.exp(-((np.arange(8000) - 5847.0) / 100.0) ** 2).astype(np.float32)
    heard = Listener(parameters, RANGES).hear(ping(samples))
    expected = EnvelopeFilter(343.0, pulse.centre_s, RANGES, 8000, 1e-6)(samples)
    np.testing.assert_allclose(heard.envelope[4:], np.abs(expected)[4:], atol=1e-6)
    assert heard.rho == pytest.approx((5847e-6 - pulse.centre_s) * 343.0 / 2.0, abs=0.002)


@pytest.mark.parametrize(('given', 'first', 'last'), [
    ({}, 4, 600), ({'range_min_m': 0.1}, 20, 600), ({'range_max_m': 1.0}, 4, 200),
    ({'range_min_m': 0.01, 'range_max_m': 0.5025}, 4, 100)])
def test_only_the_useful_ranges_are_heard(given, first, last):
    heard = listener().hear(ping(**given))
    assert np.flatnonzero(heard.envelope)[[0, -1]].tolist() == [first, last]
    assert not np.any(heard.echo[:first])
    assert np.isnan(heard.rho) or first * 0.005 <= heard.rho <= last * 0.005


def test_the_edge_of_the_blanking_is_not_taken_for_an_echo():
    parameters = Parameters().replaced({'echo.blanking_m': 0.305})
    synthesis = Synthesis(make_medium(parameters.medium), make_pulse(parameters.pulse), 2048, 1e-6)
    samples = synthesis(np.array([0.6, 2.0]), np.array([1.0, 1.0]))  # walls at 0.3 m, just within it, and at 1 m
    assert Listener(Parameters(), RANGES).hear(ping(samples)).rho == pytest.approx(0.3, abs=0.002)
    assert Listener(parameters, RANGES).hear(ping(samples)).rho == pytest.approx(1.0, abs=0.002)


def test_filters_are_kept_for_few_shapes_and_float32_periods_are_one():
    ears = listener()
    fields = [float(np.float32(1e-6) * (1.0 + k * 1e-9)) for k in range(5)]
    for period_s in fields:
        ears.hear(ping(period_s=period_s))
    assert len(ears._filters) == 1
    for n in range(100, 130):
        ears.hear(ping(NOISE[:n]))
    assert len(ears._filters) <= 8


def test_pings_of_different_shapes_do_not_mix():
    ears, alone = listener(), []
    shapes = [ping(NOISE[:n], period_s, t0_s=t0_s) for n, period_s, t0_s in
              ((2048, 1e-6, 0.0), (2048, 2e-6, 0.0), (1000, 1e-6, 0.0), (2048, 1e-6, 1e-5))]
    for each in shapes:
        alone.append(listener().hear(each).echo)
    for each, echo in list(zip(shapes, alone, strict=True)) * 2:
        np.testing.assert_array_equal(ears.hear(each).echo, echo)


def test_pings_of_a_bad_converter_are_refused_beyond_the_blanking():
    clipped = np.clip(NOISE, -1.5, 1.5)  # 13 % of the samples
    listener().admission.check(ping(clipped))
    with pytest.raises(BadPing, match=r'clipped.*front_end\.max_bad') as caught:
        listener(front_end__max_bad=0.01).admission.check(ping(clipped))
    assert caught.value.reason == 'bad_samples'
    silent = NOISE.copy()
    silent[1000:1100] = 0.25
    with pytest.raises(BadPing, match='dropped out'):
        listener(front_end__max_bad=0.01).admission.check(ping(silent))
    near = NOISE.copy()
    near[:100] = 7.0  # the direct wave, within 0.15 m
    listener(front_end__max_bad=0.01, echo__blanking_m=0.15).admission.check(ping(near))
    with pytest.raises(BadPing):
        listener(front_end__max_bad=0.01).admission.check(ping(near))


def two_walls(parameters=None):
    parameters = parameters or Parameters()
    synthesis = Synthesis(make_medium(parameters.medium), make_pulse(parameters.pulse), 2048, 1e-6)
    return synthesis(np.array([0.6, 2.0]), np.array([1.0, 1.0]))


def test_the_front_end_acts_before_eq_3():
    samples = (two_walls() + 1e3).astype(np.float32)
    assert listener(front_end__remove_dc=True).hear(ping(samples)).rho == pytest.approx(0.3, abs=0.002)
    muted = listener(front_end__mute_blanking=True, echo__blanking_m=0.5).hear(ping(two_walls()))
    alone = listener().hear(ping(two_walls())).envelope[200]
    assert muted.envelope[200] > 1.2 * alone  # a share of what is left of the ping
    noisy = two_walls() + 10.0 * np.sin(2.0 * np.pi * 2e4 * 1e-6 * np.arange(2048))
    assert listener(front_end__band_low_hz=5e4).hear(ping(noisy)).rho == pytest.approx(0.3, abs=0.002)


def test_a_band_pass_does_not_pass_noise_off_as_silence():
    """Noise is told from frequencies beyond the pulse's, before they are taken out."""
    samples = two_walls() / np.abs(two_walls()).max() + 0.3 * NOISE
    plain, limited = (listener(front_end__band_low_hz=low, front_end__band_high_hz=high).hear(ping(samples))
                      for low, high in ((0.0, 0.0), (1.5e4, 3e5)))
    # Relative to the ping's norm, of which the band-pass took some: the ratio of signal to noise is the same.
    assert limited.envelope[60] / limited.noise == pytest.approx(plain.envelope[60] / plain.noise, rel=0.05)


def test_flat_spreading_makes_far_echoes_as_bright_as_near_ones():
    plain, flat = (listener(front_end__flat_spreading=on).hear(ping(two_walls())) for on in (False, True))
    assert plain.envelope[60] / plain.envelope[200] == pytest.approx(np.sqrt(2.0 / 0.6), rel=0.05)
    assert flat.envelope[60] / flat.envelope[200] == pytest.approx(1.0, rel=0.05)
    np.testing.assert_array_equal(plain.echo, flat.echo)


def test_the_first_echo_is_searched_with_the_false_alarm_rate_given():
    weak = np.array([0.1, 1.0])  # a wall at 0.3 m, heard at less than 0.3 of the one at 1 m
    synthesis = Synthesis(make_medium(Parameters().medium), make_pulse(Parameters().pulse), 2048, 1e-6)
    samples = synthesis(np.array([0.6, 2.0]), weak)
    heard = ping(samples + 2e-3 * np.abs(samples).max() * NOISE)
    assert listener().hear(heard).rho == pytest.approx(1.0, abs=0.002)
    found = listener(free_area__false_alarm=1e-3).hear(heard)
    assert found.rho == pytest.approx(0.3, abs=0.003)
    assert found.confidence > 0.9
    nothing = [listener(free_area__false_alarm=1e-3).hear(
        ping(np.random.default_rng(seed).normal(size=2048))).rho for seed in range(30)]
    assert np.isnan(nothing).mean() > 0.9


@pytest.mark.parametrize(('values', 'name'), [
    ({'pulse__frequency_hz': 1e9}, 'grid.range_max_m'),
    ({'pulse__frequency_hz': 1.0, 'pulse__cycles': 10.0}, 'pulse.frequency_hz'),
])
def test_a_pulse_that_asks_for_too_many_ranges_is_refused(values, name):
    with pytest.raises(ParameterError) as refused:
        listener(medium__model='constant', **values)
    assert refused.value.name == name


@pytest.mark.parametrize(('values', 'name'), [
    ({'front_end__band_low_hz': 220e3}, 'front_end.band_low_hz'),
    ({'front_end__band_low_hz': 6e5, 'front_end__band_high_hz': 7e5}, 'front_end.band_low_hz'),
    ({'front_end__band_high_hz': 30e3}, 'front_end.band_high_hz'),
])
def test_a_band_without_the_pulse_is_refused(values, name):
    """Two cycles of 100 kHz under a Hann window: the spectrum is nothing from 200 kHz."""
    with pytest.raises(ParameterError, match='takes out the pulse') as refused:
        listener(**values)
    assert refused.value.name == name
    listener(front_end__band_low_hz=90e3, front_end__band_high_hz=110e3)
    listener(echo__kind='envelope', front_end__band_high_hz=30e3)  # magnitudes are slower than the pulse


def test_a_gain_that_leaves_no_numbers_is_refused():
    listener(front_end__gain_db_s=1e5).admission.check(ping(NOISE))
    with pytest.raises(BadPing, match='gain_db_s comes to'):
        listener(front_end__gain_db_s=1e7).admission.check(ping(NOISE))
