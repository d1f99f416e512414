"""What all pings have in common is found where it is, and a wall's echo is none of it."""

import numpy as np
import pytest

from polymap_ros.acoustics.common_part import common_part, without_common
from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.parameters import MediumParameters, PulseParameters
from polymap_ros.simulation.waveforms import Synthesis

PINGS, N, WINDOW = 32, 2048, 20
SYNTHESIS = Synthesis(make_medium(MediumParameters()), make_pulse(PulseParameters()), N, 1e-6)


def echo(range_m, peak=1.0):
    wave = SYNTHESIS(np.array([2.0 * range_m]), np.ones(1))
    return peak * wave / np.abs(wave).max()


@pytest.fixture
def pings():
    """Noise of power 1 and three echoes in each ping, at ranges of its own."""
    generator = np.random.default_rng(3)
    return np.array([generator.normal(size=N) + sum(echo(r, 3.0) for r in generator.uniform(0.2, 2.0, 3))
                     for _ in range(PINGS)])


@pytest.mark.parametrize('peak', [10.0, 30.0, 100.0])
def test_clutter_is_found_to_within_the_median_s_error_and_nothing_beside_it(pings, peak):
    clutter = echo(0.08, peak) + echo(0.6, peak)
    common = common_part(pings + clutter, WINDOW)
    # The median of N values of deviation 1 deviates by 1.25 / sqrt(N), and what is left where it is not looked for is
    # weaker than the pings.
    deviation = 1.25 * pings.std() / np.sqrt(PINGS)
    found = common != 0.0
    assert np.sqrt(np.mean((common - clutter)[found] ** 2)) < 1.3 * deviation
    assert np.sqrt(np.mean(clutter[~found] ** 2)) < deviation
    assert found[np.abs(clutter) < 0.05 * deviation].mean() < 0.1
    left = np.array([without_common(ping, common) for ping in pings + clutter]) - pings
    assert np.sqrt(np.mean(left**2)) < 1.2 * deviation


def test_pings_without_clutter_have_nothing_in_common(pings):
    common = common_part(pings, WINDOW)
    assert np.mean(common != 0.0) < 0.01
    assert common_part(np.zeros((9, 100)), WINDOW).tolist() == [0.0] * 100


def test_an_echo_between_parallel_walls_is_left(pings):
    """It goes to and fro over the same way from everywhere, and is as strong as others."""
    common = common_part(pings + echo(0.8, 3.0), WINDOW)
    assert np.mean(common != 0.0) < 0.01


def test_a_wall_that_most_of_the_way_leads_along_is_left(pings):
    along = pings.copy()
    along[:19] += echo(0.4, 10.0)  # three pings of five
    assert np.abs(np.median(along, axis=0)).max() > 3.0  # which the median alone would take
    assert np.mean(common_part(along, WINDOW) != 0.0) < 0.01


def test_clutter_that_drifts_in_strength_is_taken_out_as_strong_as_it_is(pings):
    clutter = echo(0.08, 30.0)
    gains = np.random.default_rng(0).uniform(0.8, 1.25, PINGS)
    drifting = pings + gains[:, None] * clutter
    common = common_part(drifting, WINDOW)
    left = np.array([without_common(ping, common) for ping in drifting]) - pings
    assert np.sqrt(np.mean(left[:, :200] ** 2)) < 1.0  # of 30, and that times up to a quarter
