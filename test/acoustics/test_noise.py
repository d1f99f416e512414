"""The noise of a ping, told from the ping alone."""

import numpy as np
import pytest

from polymap_ros.acoustics.matched_filter import MatchedFilter
from polymap_ros.acoustics.medium import ConstantSpeed
from polymap_ros.acoustics.noise import MODEL_ERROR, NoiseGauge, noise_from_envelope
from polymap_ros.acoustics.pulse import Chirp, ToneBurst

PERIOD = 1e-6
BURST = ToneBurst(1e5, 2.0)


@pytest.mark.parametrize('snr_db', [20.0, 0.0, -10.0])
@pytest.mark.parametrize('n', [1000, 2048, 8192])
def test_noise_is_told_from_the_echoes(snr_db, n, plate, burst, receive):
    generator = np.random.default_rng(1)
    gauge = NoiseGauge(plate, BURST, n, PERIOD)
    echoes = sum(receive(plate, burst, path, n, PERIOD).real for path in (0.5, 0.9, 1.3))
    sigma = np.sqrt(np.mean(echoes**2) * 10 ** (-snr_db / 10))
    ratios = []
    for _ in range(50):
        samples = echoes + generator.normal(scale=sigma, size=n)
        ratios.append(gauge(samples) / max(sigma / np.linalg.norm(samples), np.sqrt(MODEL_ERROR / n)))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.03)
    assert np.std(ratios) < 0.1


@pytest.mark.parametrize('pulse', [ToneBurst(2e4, 4.0), Chirp(2e4, 2e4, 2e-3)], ids=['burst', 'chirp'])
@pytest.mark.parametrize('snr_db', [10.0, 0.0, -20.0])
def test_so_it_is_in_air(pulse, snr_db):
    generator, n, period = np.random.default_rng(3), 14336, 5e-6
    gauge = NoiseGauge(ConstantSpeed(343.0), pulse, n, period)
    wave, echoes = pulse.samples(period), np.zeros(n)
    for first, gain in ((900, 1.0), (2100, -0.6), (8000, 0.3), (14300, 0.5)):  # the last one is cut off by the end
        part = wave[: n - first]
        echoes[first:first + len(part)] += gain * part
    sigma = np.sqrt(np.mean(echoes**2) * 10 ** (-snr_db / 10))
    for _ in range(5):
        samples = echoes + generator.normal(scale=sigma, size=n)
        floor = np.sqrt(MODEL_ERROR / n)
        assert gauge(samples) == pytest.approx(max(sigma / np.linalg.norm(samples), floor), rel=0.05)


def test_it_is_the_spread_of_eq_3_where_nothing_echoes(plate):
    generator = np.random.default_rng(2)
    ranges = 5e-3 * np.arange(601)
    matched, gauge = MatchedFilter(plate, BURST, ranges, 4096, PERIOD), NoiseGauge(plate, BURST, 4096, PERIOD)
    noise = [generator.normal(size=4096) for _ in range(60)]
    spread = np.std([matched(samples).real[100:500] for samples in noise])
    assert np.mean([gauge(samples) for samples in noise]) == pytest.approx(spread, rel=0.03)
    envelopes = [noise_from_envelope(np.abs(matched(samples)), 4096) for samples in noise]
    assert np.mean(envelopes) == pytest.approx(spread, rel=0.05)


def test_a_clean_ping_has_the_model_s_error(plate, burst, receive):
    samples = receive(plate, burst, 1.0, 2048, PERIOD).real
    floor = np.sqrt(MODEL_ERROR / 2048)
    assert NoiseGauge(plate, BURST, 2048, PERIOD)(samples) == pytest.approx(floor)
    assert noise_from_envelope(np.zeros(100), 2048) == pytest.approx(floor)


def test_no_quiet_frequency_no_answer():
    """A chirp over nearly all that the sample rate can hold leaves nothing to listen to."""
    air = ConstantSpeed(343.0)
    assert NoiseGauge(air, Chirp(2.4e4, 4.6e4, 2e-3, hann=False), 400, 1e-5)(np.ones(400)) is None
    assert NoiseGauge(air, ToneBurst(2e4, 8.0), 400, 1e-5)(np.ones(400)) is not None
