"""What the dispersive filter is for: sharp and unbiased ranges at 1 m and beyond, and what a wrong medium costs."""

import numpy as np
import pytest

from polymap_ros.acoustics.matched_filter import MatchedFilter
from polymap_ros.acoustics.medium import ConstantSpeed, LambA0, group_speed
from polymap_ros.acoustics.pulse import ToneBurst

STEP = 2e-4
RANGES = STEP * np.arange(15001)
BURST = ToneBurst(1e5, 2.0)


def envelope(medium, samples):
    return np.abs(MatchedFilter(medium, BURST, RANGES, len(samples), 1e-6)(samples))


def width(e):
    """Full width at half maximum of the main lobe [m]."""
    low = high = int(e.argmax())
    while e[low] > e.max() / 2:
        low -= 1
    while e[high] > e.max() / 2:
        high += 1
    return STEP * (high - low)


def span(e):
    """From the first to the last range above half of the maximum [m]."""
    above = np.flatnonzero(e > e.max() / 2)
    return STEP * (above[-1] - above[0])


@pytest.mark.parametrize('wall', [0.3, 1.0, 2.0, 2.8])
def test_dispersive_filter_is_sharp_and_unbiased_at_every_range(wall, plate, burst, receive):
    e = envelope(plate, receive(plate, burst, 2 * wall, 3000, 1e-6).real)
    assert 0.016 <= width(e) <= 0.020
    assert abs(RANGES[e.argmax()] - wall) <= STEP
    assert e.max() == pytest.approx(1.0, abs=5e-3)


class WithoutDispersion(ConstantSpeed):
    """The paper's plate, its dispersion left out: the amplitude of A0, at one speed."""

    def excitability(self, omega_rad_s):
        return LambA0(0.006, 6149.0, 3097.0).excitability(omega_rad_s)


def test_constant_speed_leaves_the_echo_of_1_m_wide_weak_and_biased(plate, burst, receive):
    samples = receive(plate, burst, 2.0, 2048, 1e-6).real
    e = envelope(WithoutDispersion(float(group_speed(plate, 1e5)), 0.5), samples)
    assert 0.090 <= span(e) <= 0.110
    assert 0.40 <= e.max() <= 0.46
    assert -0.009 <= RANGES[e.argmax()] - 1.0 <= -0.006


@pytest.mark.parametrize(('assumed', 'percent'), [
    (LambA0(0.005, 6149.0, 3097.0), -3.0),
    (LambA0(0.0048, 6149.0, 3097.0), -3.7),
    (LambA0(0.006, 5960.0, 3235.0), 2.8),
])
def test_a_wrong_plate_is_mainly_a_wrong_scale(assumed, percent, plate, burst, receive):
    e = envelope(assumed, receive(plate, burst, 2.0, 2048, 1e-6).real)
    assert 100 * (RANGES[e.argmax()] - 1.0) == pytest.approx(percent, abs=0.1)


def test_noise_of_0_db_hardly_moves_the_range(plate, burst, receive):
    generator = np.random.default_rng(11)
    clean = receive(plate, burst, 2.0, 2048, 1e-6).real
    found = [
        RANGES[envelope(plate, clean + generator.normal(scale=clean.std(), size=2048)).argmax()] for _ in range(20)
    ]
    assert np.abs(np.array(found) - 1.0).max() < 2e-3
