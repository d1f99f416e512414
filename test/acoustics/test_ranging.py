"""The closest range: first peak that stands out, to a fraction of a cell, or an honest nan."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.acoustics.matched_filter import MatchedFilter
from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.acoustics.ranging import closest_range, confidence, first_echo
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import simulate

STEP = 0.005
RANGES = STEP * np.arange(601)


def bumps(*walls):
    """An envelope of 25 mm wide echoes, (range, height) each."""
    return sum(height * np.exp(-(((RANGES - r) / 0.015) ** 2)) for r, height in walls)


@pytest.mark.parametrize('wall', [0.1, 0.3012, 0.7525, 1.9988, 2.9])
def test_peak_is_found_to_a_fraction_of_a_cell(wall):
    assert closest_range(bumps((wall, 1.0)), STEP) == pytest.approx(wall, abs=2e-4)


@pytest.mark.parametrize(('height', 'expected'), [(1.0, 0.4), (0.5, 0.4), (0.33, 0.4), (0.27, 1.1)])
def test_the_first_peak_counts_unless_it_is_too_weak(height, expected):
    assert closest_range(bumps((0.4, height), (1.1, 1.0), (2.0, 0.8)), STEP) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize('step', [0.001, 0.005, 0.0007])
def test_blanking_leaves_out_what_is_nearer(step):
    ranges = step * np.arange(800)
    e = sum(np.exp(-(((ranges - r) / 0.015) ** 2)) for r in (0.03, 0.3))
    assert closest_range(e, step, 0.0) == pytest.approx(0.03, abs=1e-3)
    assert closest_range(e, step, 0.025) == pytest.approx(0.03, abs=1e-3)
    # Only the near peak's falling side is left in: no peak.
    assert closest_range(e, step, 0.035) == pytest.approx(0.3, abs=1e-3)
    assert closest_range(e, step, 0.2) == pytest.approx(0.3, abs=1e-3)
    assert np.isnan(closest_range(e, step, 0.4 + 800 * step))


@pytest.mark.parametrize('envelope', [
    np.zeros(601), np.ones(601), RANGES, RANGES[::-1], np.ones(2), np.ones(0)])
def test_no_peak_is_nan(envelope):
    assert np.isnan(closest_range(envelope, STEP))


def test_scale_does_not_matter():
    e = bumps((0.4, 0.6), (1.1, 1.0))
    assert closest_range(1e-12 * e, STEP) == pytest.approx(closest_range(e, STEP), rel=1e-9)
    assert closest_range(e.astype(np.float32), STEP) == pytest.approx(closest_range(e, STEP), abs=1e-6)


@pytest.mark.parametrize('shape', ['pure noise', 'noise and a wall'])
def test_noise_alone_is_rarely_taken_for_a_wall(shape):
    """Envelopes of white noise have Rayleigh statistics; a wall of 15 standard deviations stands out."""
    generator = np.random.default_rng(3)
    wall = bumps((1.5, 15.0)) if shape == 'noise and a wall' else 0.0
    found = []
    for _ in range(100):
        noise = generator.normal(size=601) + 1j * generator.normal(size=601)
        smooth = np.convolve(noise, np.hanning(9) / np.linalg.norm(np.hanning(9)), 'same')
        found.append(closest_range(np.abs(wall + smooth), STEP))
    near = np.abs(np.array(found) - 1.5) < 0.03
    assert near.mean() > 0.9 if shape == 'noise and a wall' else near.mean() < 0.1


@pytest.mark.parametrize(('snr', 'least', 'short'), [(None, 0.96, 0.0), (0.0, 0.95, 0.01), (-10.0, 0.33, 0.05)])
def test_ranges_of_random_rooms(snr, least, short):
    """Share of the pings of drawn plates whose range is within 2 cm of the closest wall, and of those too short."""
    errors = []
    for seed, edges in [(21, 3), (22, 4), (23, 5), (24, 6), (25, 7), (26, 8)]:
        scene = dataclasses.replace(random_scene(seed, edges), snr_db=snr)
        matched = MatchedFilter(
            make_medium(scene.medium), make_pulse(scene.pulse), RANGES, scene.n_samples, 1 / scene.sample_rate_hz)
        corners = np.asarray(scene.vertices)
        along = np.roll(corners, -1, axis=0) - corners
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        for pose, samples in zip(scene.poses, simulate(scene), strict=True):
            offset = pose[:2] - corners
            true = np.min(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0])
            errors.append(closest_range(np.abs(matched(samples)), STEP, 0.02) - true)
    errors = np.array(errors)
    right = np.abs(errors) < 0.02
    assert right.mean() >= least
    assert np.mean(errors < -0.02) <= short
    assert errors[right].std() < 4e-3


def rayleigh(generator, cells, oversampled=4):
    """Envelope of noise of deviation 1 whose independent cells are so many samples wide."""
    from scipy.ndimage import gaussian_filter1d

    white = generator.normal(size=(2, cells * oversampled))
    smooth = gaussian_filter1d(white, oversampled / (2.0 * np.sqrt(np.pi)), axis=1, mode='wrap')
    return np.hypot(*(smooth / smooth.std()))


@pytest.mark.parametrize('false_alarm', [0.3, 0.1, 0.02])
def test_noise_is_taken_for_an_echo_as_often_as_allowed(false_alarm):
    generator = np.random.default_rng(1)
    found = [first_echo(rayleigh(generator, 150), 1.0, 0.005, 0.0, 0.02, false_alarm) for _ in range(2000)]
    assert np.mean(np.isfinite(found)) == pytest.approx(false_alarm, rel=0.3)


def test_a_weak_first_echo_is_found_whatever_follows():
    r = 0.005 * np.arange(600)
    envelope = 8.0 * np.exp(-((r - 0.5) / 0.01) ** 2) + 80.0 * np.exp(-((r - 1.2) / 0.01) ** 2) + 0.1
    assert first_echo(envelope, 1.0, 0.005, 0.02, 0.02, 1e-3) == pytest.approx(0.5, abs=1e-3)
    assert closest_range(envelope, 0.005, 0.02) == pytest.approx(1.2, abs=1e-3)
    assert np.isnan(first_echo(envelope[:200] / 8.0, 1.0, 0.005, 0.02, 0.02, 1e-3))
    assert np.isnan(first_echo(envelope[:5], 1.0, 0.005, 0.02, 0.02, 1e-3))


def test_confidence_is_how_rarely_noise_gets_so_high_so_early():
    generator = np.random.default_rng(2)
    noise = [rayleigh(generator, 150) for _ in range(2000)]
    for height, rho in ((3.5, 1.5), (4.0, 3.0), (3.0, 0.3)):  # the formula is for high peaks
        envelope = np.zeros(601)
        envelope[round(rho / 0.005)] = height
        silent = np.mean([each[:round(rho / 0.005)].max() < height for each in noise])
        assert confidence(envelope, 1.0, 0.005, 0.0, 0.02, rho) == pytest.approx(silent, abs=0.08)
    assert confidence(np.full(601, 12.0), 1.0, 0.005, 0.0, 0.02, 3.0) > 0.999999
    assert confidence(envelope, 1.0, 0.005, 0.0, 0.02, float('nan')) == 0.0
