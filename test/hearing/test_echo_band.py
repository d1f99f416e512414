"""A sample period that is wrong by a factor is told by where the samples have their energy, and nothing else is."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.errors import StateError
from polymap_ros.evaluation.variants import VARIANTS
from polymap_ros.hearing.echo_band import EchoBand
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.waveforms import simulate

PINGS = 8


@pytest.fixture(scope='module', params=['plate', 'air_chirp'])
def scene(request):
    made = VARIANTS[request.param].make(2, 4)
    return dataclasses.replace(made, poses=made.poses[:PINGS], snr_db=-10.0)


@pytest.fixture(scope='module')
def samples(scene):
    return simulate(scene)


def band(scene, samples, factor=1.0, **changes):
    found, parameters = EchoBand(), scene.parameters().replaced(changes)
    for k, row in enumerate(samples):
        found = found.taken(Ping(k, row, factor * scene.period_s), parameters)
    return found


def told(scene, found, frequency_hz=None):
    pulse = make_pulse(dataclasses.replace(scene.pulse, frequency_hz=frequency_hz or scene.pulse.frequency_hz))
    return found.cautions(pulse, frequency_hz or scene.pulse.frequency_hz)


@pytest.mark.parametrize(('factor', 'words'), [
    (0.1, ' times too short'), (0.25, ' times too short'), (0.5, ' times too short'), (2.0, ' times too long')])
def test_a_wrong_period_is_told_in_noise_10_db_above_the_echoes(scene, samples, factor, words):
    caution, = told(scene, band(scene, samples, factor))
    assert caution.code == 'echo_band'
    assert words in caution.finding
    found = band(scene, samples, factor).factor(make_pulse(scene.pulse), scene.pulse.frequency_hz)
    assert found == pytest.approx(factor, rel=0.2)


def test_the_right_period_is_not(scene, samples):
    assert told(scene, band(scene, samples)) == ()


@pytest.mark.parametrize('share', [0.92, 1.08])
def test_nor_is_a_transducer_that_is_8_percent_off(scene, samples, share):
    frequency_hz = share * scene.pulse.frequency_hz
    found = band(scene, samples, **{'pulse.frequency_hz': frequency_hz})
    assert told(scene, found, frequency_hz) == ()


@pytest.mark.parametrize('changes', [{'echo.kind': 'envelope'}, {'front_end.band_low_hz': 1000.0}])
def test_magnitudes_and_a_band_that_was_chosen_are_not_looked_at(scene, samples, changes):
    assert band(scene, samples, 0.25, **changes).pings == 0


def test_noise_hum_and_silence_tell_nothing(scene):
    generator = np.random.default_rng(2)
    noise = generator.normal(size=(PINGS, scene.n_samples))
    hum = 5.0 * np.sin(2.0 * np.pi * 0.05 * scene.pulse.frequency_hz * scene.period_s * np.arange(scene.n_samples))
    for rows in (noise, noise + hum, np.ones((PINGS, scene.n_samples))):
        assert told(scene, band(scene, rows)) == ()


def test_a_few_pings_tell_nothing_and_a_state_is_continued(scene, samples):
    assert told(scene, band(scene, samples[:4], 0.25)) == ()
    found = EchoBand.restored(band(scene, samples, 0.25).state())
    assert len(told(scene, found)) == 1
    with pytest.raises(StateError):
        EchoBand.restored(found.state() | {'known': np.full(3, 1.0)})


def test_nor_is_noise_that_is_louder_at_low_frequencies(scene):
    coloured = dataclasses.replace(scene, snr_db=0.0, faults=Faults(noise_colour=0.9))
    assert told(scene, band(scene, simulate(coloured))) == ()
