"""A sample period in another unit than seconds is called by the unit."""

import pytest

from polymap_ros.acoustics.units import guessed_unit, likely_unit

RIGHT_S = 5e-7


@pytest.mark.parametrize(('given', 'words'), [
    (0.5, 'microseconds'), (0.51, 'microseconds'), (500.0, 'nanoseconds'), (5e-4, 'milliseconds'),
    (2e6, 'a sample rate in Hz'), (2000.0, 'a sample rate in kHz'), (2.0, 'a sample rate in MHz')])
def test_units(given, words):
    assert likely_unit(given, RIGHT_S) == f': {given:g} looks like {words}, the period is in seconds (5e-07)'


@pytest.mark.parametrize(('given', 'words'), [
    (5e-6, '10 times too long'), (1e-6, '2 times too long'), (5e-10, '1000 times too short')])
def test_factors(given, words):
    assert words in likely_unit(given, RIGHT_S)


@pytest.mark.parametrize('given', [RIGHT_S, 1.01 * RIGHT_S, 0.0, -1.0, float('nan'), float('inf')])
def test_what_is_alike_or_none_has_no_unit(given):
    assert likely_unit(given, RIGHT_S) == ''


@pytest.mark.parametrize(('given', 'words'), [
    (0.5, 'looks like microseconds, the period is in seconds (5e-07)'), (5e-10, '1000 times too short for 5e-07 s'),
    (5e-6, '10 times too long for 5e-07 s'), (2e6, 'looks like a sample rate in Hz, '), (1e30, ''),
    (1000.0, 'looks like nanoseconds or a sample rate in kHz, the period is in seconds (1e-06)'),
    (1.0, 'looks like microseconds or a sample rate in MHz, the period is in seconds (1e-06)'),
    (0.001024, 'looks like the time of all 2048 samples, the period is in seconds (5e-07), or like milliseconds'),
    (0.0005, 'looks like milliseconds, the period is in seconds (5e-07), or like the time of all 2048 samples')])
def test_what_was_meant_is_guessed(given, words):
    found = guessed_unit(given, 5e-7, 2e-6, 1e-7, 2048)
    assert words in found
    assert bool(words) == bool(found)


def test_the_time_of_the_whole_ping_is_no_period():
    assert likely_unit(2048 * RIGHT_S, RIGHT_S, 2048) == (
        ': 0.001024 looks like the time of all 2048 samples, the period is in seconds (5e-07)')
