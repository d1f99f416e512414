"""Maxima of functions whose maxima are known."""

import numpy as np
import pytest

from polymap_ros.calibration.hill_climb import ascend, highest


@pytest.mark.parametrize('start', [(0.0, 0.0), (0.31, -0.2), (2.0, 1.5)])
def test_a_log_likelihood_is_climbed_and_its_covariance_told(start):
    middle, covariance = np.array((0.3, -0.2)), np.array(((0.04, 0.03), (0.03, 0.09)))
    precision = np.linalg.inv(covariance)

    def likelihood(p, found):
        return 7.0 - 0.5 * (p - middle) @ precision @ (p - middle), (*found, tuple(p))

    peak = highest(likelihood, np.array(start), (), np.array((0.1, 0.15)))
    np.testing.assert_allclose(peak.at, middle, atol=1e-6)
    np.testing.assert_allclose(peak.covariance, covariance, rtol=1e-6)
    assert peak.value == pytest.approx(7.0)
    assert peak.found[-1] == pytest.approx(tuple(peak.at))  # what was found there, not elsewhere


def test_a_slope_without_a_top_has_no_covariance():
    peak = highest(lambda p, found: (float(p[0]), found), np.zeros(1), None, np.array((0.1,)))
    assert peak.covariance is None
    assert peak.value > 0.1


def test_one_parameter_that_is_not_quadratic():
    peak = highest(lambda p, found: (float(np.cos(p[0] - 1.0)), found), np.array((0.2,)), None, np.array((0.1,)))
    assert peak.at[0] == pytest.approx(1.0, abs=1e-3)
    assert peak.covariance[0, 0] == pytest.approx(1.0, rel=1e-2)


def test_steps_along_the_axes_find_a_ridge_that_is_not_smooth():
    top = np.array((0.37, -1.21))
    found = ascend(lambda p: -abs(p[0] - top[0]) - 2.0 * abs(p[1] - top[1]), np.zeros(2), np.array((0.5, 0.5)),
                   np.array((1e-3, 1e-3)))
    np.testing.assert_allclose(found, top, atol=1e-3)
