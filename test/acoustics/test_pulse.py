"""Every pulse's samples and spectrum against its formula in time and adaptive quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad

from polymap_ros.acoustics.pulse import Chirp, RecordedPulse, ToneBurst, make_pulse
from polymap_ros.errors import ParameterError
from polymap_ros.parameters import PulseParameters


def window(t, duration, hann):
    return np.sin(np.pi * t / duration) ** 2 if hann else 1.0


def tone(t, hann):
    return window(t, 2e-5, hann) * np.sin(2 * np.pi * 1e5 * t)


def sweep(t, hann):
    """20 to 60 kHz in 0.5 ms: instantaneous frequency 20e3 + 80e6 t."""
    return window(t, 5e-4, hann) * np.sin(2 * np.pi * (20e3 * t + 40e6 * t**2))


PULSES = [
    (ToneBurst(1e5, 2.0), tone, True, 1e-9),
    (ToneBurst(1e5, 2.0, hann=False), tone, False, 1e-9),
    (Chirp(4e4, 4e4, 5e-4), sweep, True, 1e-6),
    (Chirp(4e4, 4e4, 5e-4, hann=False), sweep, False, 1e-2),
]


@pytest.mark.parametrize(('pulse', 'wave', 'hann', 'tolerance'), PULSES)
def test_spectrum_is_the_fourier_integral(pulse, wave, hann, tolerance):
    omega = 2 * np.pi * np.array([[1e3, 2e4, 3.3e4], [4e4, 1e5, 1.31e5]])
    expected = np.empty(omega.shape, dtype=complex)
    for at, w in np.ndenumerate(omega):
        real, imaginary = (
            quad(lambda t, f=f, w=w: wave(t, hann) * f(w * t), 0.0, pulse.duration_s, limit=400)[0]
            for f in (np.cos, np.sin)
        )
        expected[at] = real - 1j * imaginary
    assert np.abs(pulse.spectrum(omega) - expected).max() < tolerance * np.abs(expected).max()


@pytest.mark.parametrize(('pulse', 'wave', 'hann', '_'), PULSES)
def test_samples_start_at_time_zero(pulse, wave, hann, _):
    period = 1.3e-6
    samples = pulse.samples(period)
    assert (len(samples) - 1) * period <= pulse.duration_s < len(samples) * period
    assert samples == pytest.approx(wave(np.arange(len(samples)) * period, hann), abs=1e-9)
    assert pulse.centre_s == pulse.duration_s / 2


def test_last_sample_at_the_exact_end_is_not_lost_to_rounding():
    assert len(ToneBurst(1e5, 2.0).samples(1e-6)) == 21
    assert len(Chirp(4e4, 4e4, 5e-4).samples(1e-7)) == 5001


def test_recorded_pulse_is_the_analytic_one_again():
    exact = ToneBurst(1e5, 4.0)
    recorded = RecordedPulse(exact.samples(1e-6), 1e-6)
    omega = 2 * np.pi * np.linspace(5e4, 1.5e5, 50)
    assert recorded.duration_s == pytest.approx(exact.duration_s)
    assert recorded.centre_s == pytest.approx(exact.centre_s, abs=1e-8)
    expected = exact.spectrum(omega)
    assert recorded.spectrum(omega) == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())
    assert recorded.samples(2e-6) == pytest.approx(exact.samples(2e-6), abs=1e-12)


def test_recorded_pulse_holds_nothing_above_half_its_rate():
    recorded = RecordedPulse(np.array([0.0, 1.0, -1.0, 0.0]), 1e-6)
    assert np.all(recorded.spectrum(2 * np.pi * np.array([5.1e5, 2e6])) == 0.0)
    assert recorded.spectrum(2 * np.pi * 4.9e5) != 0.0


def test_recorded_pulse_off_centre():
    burst = ToneBurst(1e5, 2.0).samples(1e-6)
    late = RecordedPulse(np.concatenate([np.zeros(30), burst]), 1e-6)
    assert late.centre_s == pytest.approx(40e-6, abs=1e-7)


def test_make_pulse_takes_every_parameter():
    assert make_pulse(PulseParameters()) == ToneBurst(1e5, 2.0)
    tone_burst = PulseParameters(frequency_hz=4e4, cycles=8, window='rectangular')
    assert make_pulse(tone_burst) == ToneBurst(4e4, 8.0, hann=False)
    chirp = PulseParameters(kind='chirp', frequency_hz=4e4, bandwidth_hz=2e4, duration_s=1e-3)
    assert make_pulse(chirp) == Chirp(4e4, 2e4, 1e-3)
    pulse = make_pulse(PulseParameters(kind='file', path='s.npy'), np.array([0, 3, -3, 1]), 2e-6)
    assert pulse.duration_s == pytest.approx(6e-6)
    assert pulse.samples(2e-6) == pytest.approx([0, 3, -3, 1])


@pytest.mark.parametrize('recorded', [None, np.ones(1), np.ones((2, 2)), np.zeros(9), np.array([0.0, np.nan, 1.0])])
def test_useless_recorded_pulse_is_refused(recorded):
    with pytest.raises(ParameterError, match=r'pulse\.path'):
        make_pulse(PulseParameters(kind='file', path='s.npy'), recorded, 1e-6)


def test_a_long_wave_has_the_spectrum_of_its_sum():
    samples = np.random.default_rng(4).normal(size=3000)
    omega = 2.0 * np.pi * np.linspace(0.0, 4.5e5, 257)
    expected = 1e-6 * np.exp(-1j * np.outer(omega, np.arange(3000) * 1e-6)) @ samples
    found = RecordedPulse(samples, 1e-6).spectrum(omega)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
