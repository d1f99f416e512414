"""The simulator's lines and impulses are as strong and as many as a scene says, and no two pings have the same."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import noise_free, simulate

SCENE = random_scene(5, 4)


def added(**faults):
    return simulate(dataclasses.replace(SCENE, faults=Faults(**faults))) - simulate(SCENE)


@pytest.mark.parametrize('line_db', [-6.0, 0.0, 10.0])
def test_a_line_has_its_power_over_the_mean_of_the_echoes(line_db):
    line = added(lines=1, line_db=line_db)
    power = np.mean(line**2) / np.mean(noise_free(SCENE) ** 2)
    assert 10.0 * np.log10(power) == pytest.approx(line_db, abs=0.2)
    spectrum = np.abs(np.fft.rfft(line, axis=1))
    peaks = np.fft.rfftfreq(line.shape[1], SCENE.period_s)[spectrum.argmax(axis=1)]
    assert peaks == pytest.approx(90e3, rel=0.01)
    phases = np.angle(np.sum(line * np.exp(-2j * np.pi * 90e3 * SCENE.period_s * np.arange(line.shape[1])), axis=1))
    assert np.abs(np.mean(np.exp(1j * phases))) < 0.4


def test_more_lines_are_further_up():
    spectrum = np.mean(np.abs(np.fft.rfft(added(lines=3, line_hz=60e3), axis=1)) ** 2, axis=0)
    frequency = np.fft.rfftfreq(SCENE.n_samples, SCENE.period_s)
    for hz in (60e3, 78e3, 101.4e3):
        near = np.abs(frequency - hz) < 0.02 * hz
        assert np.sum(spectrum[near]) == pytest.approx(np.sum(spectrum) / 3.0, rel=0.1)


@pytest.mark.parametrize('snr_db', [0.0, None])
def test_impulses_are_as_many_and_as_strong_as_said(snr_db):
    scene = dataclasses.replace(SCENE, snr_db=snr_db)
    impulses = simulate(dataclasses.replace(scene, faults=Faults(impulses=0.02, impulse_sigma=20.0))) - simulate(scene)
    struck = np.abs(impulses) > 1e-9
    assert np.mean(struck) == pytest.approx(0.02, rel=0.1)
    level = np.sqrt(np.mean(noise_free(scene) ** 2, axis=1, keepdims=True))
    relative = np.abs(impulses / level)[struck]
    assert (relative.min(), relative.mean(), relative.max()) == pytest.approx((10.0, 20.0, 30.0), rel=0.05)


def test_a_receiver_makes_them_longer():
    wide = added(impulses=1e-3, impulse_width=1.0)
    lengths = np.sum(np.abs(wide) > 1e-3 * np.abs(wide).max(), axis=1) / np.maximum(np.sum(
        np.abs(added(impulses=1e-3)) > 0.0, axis=1), 1)
    assert 5.0 < np.median(lengths[lengths > 0.0]) < 9.0


def test_without_them_the_samples_are_what_they_were():
    np.testing.assert_array_equal(added(), 0.0)
