"""Impulses and lines go, and what the echoes are stays: against the same pings without them."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.acoustics.interference import Interference
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.parameters import PulseParameters
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.waveforms import simulate

KINDS = ('plate', 'right_angled', 'air', 'air_chirp')


def made(kind='plate', seed=13, **changes):
    scene = VARIANTS[kind].make(seed, 4)
    return dataclasses.replace(scene, poses=scene.poses[:20], **changes)


def remover(scene):
    return Interference(make_pulse(scene.pulse), scene.n_samples, scene.period_s)


def beside(scene, **faults):
    """Pings with interference, and the same without."""
    return simulate(dataclasses.replace(scene, faults=Faults(**faults))), simulate(scene)


@pytest.mark.parametrize('snr_db', [None, 20.0, 0.0, -10.0])
@pytest.mark.parametrize('kind', KINDS)
def test_pings_without_interference_are_the_same_arrays(kind, snr_db):
    scene = made(kind, snr_db=snr_db)
    free = remover(scene)
    for samples in simulate(scene).astype(np.float32):
        freed = free(samples)
        assert freed.samples is samples
        assert freed.lines_hz == ()


@pytest.mark.parametrize('scale', [1e-6, 1.0, 1e6])
def test_a_line_is_found_and_taken_out(scale):
    scene = made()
    mixed, plain = scale * np.array(beside(scene, lines=1, line_hz=91e3, line_db=10.0))
    for samples, rest in zip(mixed, plain, strict=True):
        freed = remover(scene)(samples)
        assert freed.lines_hz == pytest.approx([91e3], rel=5e-3)  # its frequency wanders by 0.1 %
        left = np.sum((freed.samples - rest) ** 2) / np.sum((samples - rest) ** 2)
        assert left < 0.02


def test_three_lines_are_told_apart():
    scene = made()
    mixed, _ = beside(scene, lines=3, line_hz=70e3, line_db=3.0)
    found = [sorted(remover(scene)(samples).lines_hz) for samples in mixed]
    assert all(each == pytest.approx([70e3, 91e3, 118.3e3], rel=5e-3) for each in found)


def test_a_line_that_other_pings_have_is_found_where_it_is_weak():
    scene = made()
    mixed, _ = beside(scene, lines=1, line_hz=91e3, line_db=-8.0)
    free = remover(scene)
    unknown, known, elsewhere = (sum(len(free(samples, hz).lines_hz) for samples in mixed)
                                 for hz in ((), (91e3,), (120e3,)))
    assert unknown < 12
    assert known > 12
    assert elsewhere == unknown


def test_a_burst_of_the_same_frequency_is_no_line():
    scene = made(snr_db=20.0)
    at = np.arange(scene.n_samples)
    burst = np.where((at > 400) & (at < 1000), 10.0 * np.sin(2.0 * np.pi * 91e3 * scene.period_s * at), 0.0)
    samples = simulate(scene)[0] + np.std(simulate(scene)[0]) * burst
    assert remover(scene)(samples).lines_hz == ()


@pytest.mark.parametrize(('faults', 'most'), [
    ({'impulses': 0.02}, 0.01), ({'impulses': 0.005, 'impulse_width': 0.7}, 0.05),
    ({'impulses': 0.02, 'impulse_sigma': 1000.0}, 1e-3)])
def test_impulses_are_bounded(faults, most):
    scene = made()
    mixed, plain = beside(scene, **faults)
    freed = np.array([remover(scene)(samples).samples for samples in mixed])
    assert np.sum((freed - plain) ** 2) < most * np.sum((mixed - plain) ** 2)
    assert np.mean((freed - plain) ** 2) < 0.1 * np.mean(plain**2)


def test_impulses_at_both_ends_and_side_by_side_go():
    scene = made(snr_db=10.0)
    plain = simulate(scene)[3]
    mixed = plain.copy()
    for at, strength in ((0, 20.0), (2047, -20.0), (700, 15.0), (701, -25.0), (703, 30.0)):
        mixed[at] += strength * plain.std()
    freed = remover(scene)(mixed).samples
    assert np.max(np.abs(freed - plain)) < 4.0 * plain.std()
    assert np.sum((freed - plain) ** 2) < 0.02 * np.sum((mixed - plain) ** 2)


def test_where_all_is_struck_nothing_is_invented():
    mixed, _ = beside(made(), impulses=1.0)
    assert all(remover(made())(samples).samples is samples for samples in mixed)
    mixed, plain = beside(made(), impulses=0.3)
    freed = np.array([remover(made())(samples).samples for samples in mixed])
    assert np.sum((freed - plain) ** 2) <= np.sum((mixed - plain) ** 2)


@pytest.mark.parametrize('kind', ['plate', 'air'])
@pytest.mark.parametrize('counts', [6, 13, 25, 63])
def test_echoes_of_few_counts_in_silence_are_no_impulses(kind, counts):
    """A converter of 8 bit at a low gain: all noise is below its last digit."""
    scene = made(kind, snr_db=30.0)
    for row in simulate(scene):
        samples = np.round(counts * row / np.abs(row).max()).astype(np.float32)
        freed = remover(scene)(samples).samples
        # A lone count is as an impulse.
        assert np.sum((freed - samples) ** 2) < (0.01 if counts > 6 else 0.1) * np.sum(samples**2)


@pytest.mark.parametrize('kind', ['plate', 'air'])
@pytest.mark.parametrize('change', [
    lambda x: np.clip(3.0 * x, -np.abs(x).max(), np.abs(x).max()),
    lambda x: x * np.exp(3.0 * np.arange(len(x)) / len(x)),
    lambda x: np.where(np.arange(len(x)) < 0.3 * len(x), 0.0, x), lambda x: np.where(
        np.arange(len(x)) < 0.6 * len(x), x, x[int(0.6 * len(x))])], ids=['clipped', 'ramp', 'gate', 'tail'])
def test_what_a_device_does_to_echoes_is_no_impulse(kind, change):
    scene = made(kind, snr_db=10.0)
    for row in simulate(scene):
        samples = change(row).astype(np.float32)
        assert np.sum((remover(scene)(samples).samples - samples) ** 2) < 0.01 * np.sum(samples**2)


@pytest.mark.parametrize('cycles', [50.0, 100.0])
def test_echoes_that_last_as_long_as_the_ping_are_no_lines(cycles):
    scene = dataclasses.replace(made('right_angled'), pulse=PulseParameters(cycles=cycles))
    assert all(remover(scene)(samples).lines_hz == () for samples in simulate(scene))


def test_samples_that_leave_nothing_above_the_band_are_left_alone():
    """Three samples a cycle: what is struck there cannot be told."""
    scene = made(sample_rate_hz=3e5, n_samples=614)
    mixed, _ = beside(scene, impulses=0.01)
    assert all(remover(scene)(samples).samples is samples for samples in mixed)


def test_a_line_and_impulses_go_together_beside_an_offset():
    scene = made()
    mixed, plain = beside(scene, impulses=0.01, lines=1, line_db=6.0)
    for samples, rest in zip(mixed + 5.0, plain + 5.0, strict=True):
        freed = remover(scene)(samples)
        assert len(freed.lines_hz) == 1
        assert np.sum((freed.samples - rest) ** 2) < 0.03 * np.sum((samples - rest) ** 2)


@pytest.mark.parametrize('dtype', [np.float32, np.float64])
def test_the_type_of_the_samples_stays(dtype):
    mixed, _ = beside(made(), impulses=0.01, lines=1)
    before = mixed[0].astype(dtype)
    kept = before.copy()
    assert remover(made())(before).samples.dtype == dtype
    np.testing.assert_array_equal(before, kept)


def test_a_line_beside_echoes_of_a_narrow_band_is_found():
    """Whose spectrum stands out more than the line does."""
    scene = dataclasses.replace(made(snr_db=10.0), pulse=PulseParameters(cycles=18.0))
    mixed, _ = beside(scene, lines=1, line_hz=60e3, line_db=-6.0)
    found = [remover(scene)(samples).lines_hz for samples in mixed]
    assert sum(each == pytest.approx((60e3,), rel=5e-3) for each in found) > 16
