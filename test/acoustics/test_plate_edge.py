"""A plate's free edge, against its boundary conditions solved as equations, and published figures."""

import numpy as np
import pytest

from polymap_ros.acoustics.plate_edge import free_edge_delay, poisson_ratio
from polymap_ros.parameters import MediumParameters


def reflected(sine, nu):
    """R of w = exp(-j c x) + R exp(j c x) + B exp(g x), all times exp(-j s y): no moment and no shear at x = 0."""
    c, g, s2 = np.sqrt(1.0 - sine**2), np.sqrt(1.0 + sine**2), sine**2
    waves = np.array([-1j * c, 1j * c, g])  # the derivative by x of each
    moment = waves**2 - nu * s2
    shear = waves**3 - (2.0 - nu) * s2 * waves
    equations = np.array([moment, shear])
    return np.linalg.solve(equations[:, 1:], -equations[:, 0])[0]


@pytest.mark.parametrize('nu', [0.0, 0.3, 0.34, 0.5])
def test_the_delay_is_that_of_the_boundary_conditions(nu):
    for sine in np.linspace(0.0, 0.99, 34):
        found = np.exp(-1j * free_edge_delay(np.array(np.sqrt(1.0 - sine**2)), nu))
        assert found == pytest.approx(reflected(sine, nu), abs=1e-9)


def test_head_on_it_is_a_quarter_of_a_cycle_and_less_aslant():
    assert np.rad2deg(free_edge_delay(np.array(1.0), 0.3)) == pytest.approx(90.0)
    delays = np.rad2deg(free_edge_delay(np.sqrt(1.0 - np.array([0.4, 0.8]) ** 2), 0.34))
    np.testing.assert_allclose(delays, (75.0, 39.0), atol=0.5)


def test_poissons_ratio_is_that_of_the_speeds():
    nu = poisson_ratio(MediumParameters())
    assert np.sqrt((2.0 - 2.0 * nu) / (1.0 - 2.0 * nu)) == pytest.approx(6149.0 / 3097.0)
