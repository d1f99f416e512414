"""The Rayleigh-Lamb A0 mode against published figures, its own equation and its two asymptotes."""

import numpy as np
import pytest
from scipy.optimize import brentq

from polymap_ros.acoustics.medium import ConstantSpeed, LambA0, group_speed, make_medium
from polymap_ros.parameters import MediumParameters

AL_6061, AL, STEEL = (6149.0, 3097.0), (6420.0, 3040.0), (5960.0, 3235.0)

# Material, frequency [Hz], wavenumber [rad/m], phase speed [m/s], group speed [m/s]; computed independently, 6 mm.
TABLE = [
    (AL_6061, 50e3, 204.14718, 1538.886, 2582.052),
    (AL_6061, 75e3, 261.91082, 1799.234, 2834.305),
    (AL_6061, 100e3, 315.89579, 1989.006, 2973.006),
    (AL_6061, 125e3, 367.97998, 2134.350, 3051.720),
    (AL_6061, 150e3, 419.04724, 2249.097, 3095.868),
    (AL, 100e3, 317.30134, 1980.195, 2942.118),
    (STEEL, 100e3, 310.54753, 2023.260, 3059.190),
]


@pytest.mark.parametrize(('speeds', 'frequency', 'k', 'phase', 'group'), TABLE)
def test_a0_agrees_with_the_independent_table(speeds, frequency, k, phase, group):
    medium = LambA0(0.006, *speeds)
    omega = 2 * np.pi * frequency
    assert medium.wavenumber(omega) == pytest.approx(k, rel=1e-6)
    assert omega / medium.wavenumber(omega) == pytest.approx(phase, rel=1e-6)
    assert group_speed(medium, frequency) == pytest.approx(group, rel=1e-6)


@pytest.mark.parametrize('thickness', [0.001, 0.006, 0.05])
@pytest.mark.parametrize('speeds', [AL_6061, AL, STEEL, (2700.0, 1100.0)])
def test_a0_solves_the_pole_free_rayleigh_lamb_equation(thickness, speeds):
    frequency = np.geomspace(2e3, 1e6, 41)
    omega, h = 2 * np.pi * frequency, thickness / 2
    k = LambA0(thickness, *speeds).wavenumber(omega)

    def rayleigh_lamb(k):
        p, q = (np.emath.sqrt((omega / speed) ** 2 - k**2) for speed in speeds)
        value = (q**2 - k**2) ** 2 * np.cos(q * h) * np.sin(p * h) / p + 4 * k**2 * q * np.sin(q * h) * np.cos(p * h)
        return np.real(value)

    assert np.all(k > omega / speeds[1])  # slower than shear waves, as A0 is and no other mode at low frequency
    assert np.all(rayleigh_lamb(k * (1 - 1e-7)) * rayleigh_lamb(k * (1 + 1e-7)) < 0)


def test_thin_plates_bend_by_kirchhoff():
    medium = LambA0(0.006, *AL_6061)
    longitudinal, shear = AL_6061
    plate_speed_squared = 4 * shear**2 * (1 - (shear / longitudinal) ** 2)  # E / (rho (1 - nu^2))
    omega = 2 * np.pi * np.array([1.0, 10.0, 100.0])
    kirchhoff = (12 * omega**2 / (plate_speed_squared * 0.006**2)) ** 0.25
    assert medium.wavenumber(omega) == pytest.approx(kirchhoff, rel=2e-3)
    assert medium.wavenumber(omega[0]) == pytest.approx(kirchhoff[0], rel=2e-5)
    assert group_speed(medium, [10.0, 100.0]) == pytest.approx(2 * omega[1:] / kirchhoff[1:], rel=1e-3)


@pytest.mark.parametrize('speeds', [AL_6061, STEEL])
def test_thick_plates_carry_rayleigh_waves(speeds):
    longitudinal, shear = speeds

    def rayleigh(c):
        a, b = (c / longitudinal) ** 2, (c / shear) ** 2
        return (2 - b) ** 2 - 4 * np.sqrt((1 - a) * (1 - b))

    surface = brentq(rayleigh, 0.7 * shear, 0.99 * shear, xtol=1e-9)
    medium = LambA0(0.006, *speeds)
    assert 2 * np.pi * 5e6 / medium.wavenumber(2 * np.pi * 5e6) == pytest.approx(surface, rel=1e-6)
    assert group_speed(medium, 5e6) == pytest.approx(surface, rel=1e-6)


def test_frequency_times_thickness_is_what_counts():
    omega = np.geomspace(1e4, 1e7, 20)
    thick, thin = LambA0(0.012, *AL_6061), LambA0(0.006, *AL_6061)
    assert thick.wavenumber(omega) == pytest.approx(thin.wavenumber(2 * omega) / 2, rel=1e-12)


def test_nothing_travels_at_zero_frequency(plate):
    assert plate.wavenumber([0.0]) == [0.0]
    assert plate.excitability([0.0]) == ConstantSpeed(343.0).excitability([0.0]) == [0.0]
    assert plate.wavenumber(np.ones((2, 3))).shape == (2, 3)


def test_amplitudes_at_a_metre(plate):
    """Of g(d, w) = a(w) d**-p exp(-j k(w) d): 1 / sqrt(k) in a plate, 1 in a volume."""
    omega = 2 * np.pi * np.array([5e4, 1e5])
    assert plate.excitability(omega) == pytest.approx(plate.wavenumber(omega) ** -0.5)
    assert ConstantSpeed(343.0).excitability(omega) == pytest.approx(np.ones(2))
    assert ConstantSpeed(343.0).wavenumber(omega) == pytest.approx(omega / 343.0)


def test_make_medium_takes_every_parameter():
    for medium, spreading in [
        (make_medium(MediumParameters()), 0.5),
        (make_medium(MediumParameters(spreading_exponent=0.0)), 0.0),
        (make_medium(MediumParameters(model='constant')), 1.0),
        (make_medium(MediumParameters(model='constant', spreading_exponent=0.5)), 0.5),
    ]:
        assert medium.spreading == spreading
    parameters = MediumParameters(thickness_m=0.004, longitudinal_speed_m_s=5960, shear_speed_m_s=3235)
    assert make_medium(parameters) == LambA0(0.004, 5960.0, 3235.0)
    assert make_medium(MediumParameters(model='constant', speed_m_s=1480)) == ConstantSpeed(1480.0)
    assert group_speed(ConstantSpeed(1480.0), [1e3, 1e6]) == pytest.approx(1480.0)
