"""A sample period in another unit than seconds is called by the unit."""

import pytest

from polymap_ros.acoustics.units import likely_period, likely_unit

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


@pytest.mark.parametrize(('given', 'meant'), [
    (0.5, 5e-7), (500.0, 5e-7), (2e6, 5e-7), (5e-10, 5e-7), (5e-6, 5e-7), (1e30, None)])
def test_the_period_that_was_meant_is_guessed(given, meant):
    found = likely_period(given, 1e-6, 1e-7)
    assert found == (None if meant is None else pytest.approx(meant))
