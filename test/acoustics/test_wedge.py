"""The coefficient of diffraction against Sommerfeld's half plane, the exact solution for a plane wave."""

import numpy as np
import pytest
import scipy.special

from polymap_ros.acoustics.wedge import diffracts, wedge_coefficient

K = 316.0


def sommerfeld(distance, angle, coming):
    """Field of a plane wave from `coming` at a rigid half plane along angle 0, exactly, for exp(+j w t)."""
    total = 0.0j
    for beta in (angle - coming, angle + coming):
        # The integral of exp(-j t^2) from x on, by the Fresnel integrals.
        x = -np.sqrt(2.0 * K * distance) * np.cos(0.5 * beta)
        sine, cosine = scipy.special.fresnel(x * np.sqrt(2.0 / np.pi))
        rest = np.sqrt(0.5 * np.pi) * ((0.5 - cosine) - 1j * (0.5 - sine))
        total += np.exp(0.25j * np.pi) / np.sqrt(np.pi) * np.exp(1j * K * distance * np.cos(beta)) * rest
    return total


@pytest.mark.parametrize('coming', [0.4, 1.2, 2.5])
@pytest.mark.parametrize('distance', [0.05, 0.4])
def test_at_a_half_plane_images_and_what_is_diffracted_are_the_exact_field(coming, distance):
    angles = np.linspace(0.05, 2.0 * np.pi - 0.05, 181)
    waves = (np.abs(angles - coming) < np.pi) * np.exp(1j * K * distance * np.cos(angles - coming))
    waves = waves + (angles + coming < np.pi) * np.exp(1j * K * distance * np.cos(angles + coming))
    focus = np.full(len(angles), distance)
    d = wedge_coefficient(2.0 * np.pi, (1.0, 1.0), np.full(len(angles), coming), angles, K, focus)
    field = waves + d * np.exp(-1j * K * distance) / np.sqrt(distance)
    exact = np.array([sommerfeld(distance, angle, coming) for angle in angles])
    np.testing.assert_allclose(field, exact, atol=2e-3)
    assert np.abs(waves - exact).max() > 0.4, 'where images end, half of the wave is missing without'


@pytest.mark.parametrize('parts', [1, 2, 3, 4])
def test_where_images_are_exact_nothing_is_diffracted(parts):
    angle = np.pi / parts
    assert not diffracts(angle)
    coming, going = np.random.default_rng(1).uniform(0.1 * angle, 0.9 * angle, (2, 50))
    assert np.abs(wedge_coefficient(angle, (1.0, 1.0), coming, going, K, np.full(50, 0.3))).max() < 1e-9


def test_forth_and_back_are_alike():
    angle = 1.5 * np.pi
    assert diffracts(angle)
    coming, going = np.random.default_rng(2).uniform(0.1, angle - 0.1, (2, 50))
    focus = np.full(50, 0.2)
    np.testing.assert_allclose(wedge_coefficient(angle, (1.0, 1.0), coming, going, K, focus),
                               wedge_coefficient(angle, (1.0, 1.0), going, coming, K, focus), rtol=1e-6)
