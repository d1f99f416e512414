"""Walls compared one by one."""

import itertools

import numpy as np
import pytest

from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.geometry.polygon_error import compare

LINES = np.array([(0.5, 0.1), (0.6, 1.3), (0.4, 2.6), (0.7, 4.0), (0.5, 5.2)])
TRUE = half_plane_polygon(LINES)[0]


def moved(dr=(0,) * 5, dtheta=(0,) * 5):
    """The truth with every wall turned about its edge's midpoint and then moved outward."""
    middles = 0.5 * (TRUE + np.roll(TRUE, -1, axis=0))
    theta = LINES[:, 1] + np.asarray(dtheta)
    r = np.einsum('nk,nk->n', middles, np.column_stack((np.cos(theta), np.sin(theta)))) + np.asarray(dr)
    return half_plane_polygon(np.column_stack((r, theta)))[0]


def test_the_truth_is_right():
    found = compare(TRUE, TRUE)
    assert found.right
    assert (found.n_true, found.n_estimated) == (5, 5)
    assert found.iou == pytest.approx(1.0)
    np.testing.assert_allclose((found.offsets_m, found.angles_rad), 0.0, atol=1e-12)


def test_offsets_are_outward_at_the_midpoint_and_angles_signed():
    dr, dtheta = (0.001, -0.002, 0.0, 0.0025, 0.0), np.deg2rad((0.1, 0.0, -0.4, 0.2, 0.0))
    found = compare(moved(dr, dtheta), TRUE)
    np.testing.assert_allclose(found.offsets_m, dr, atol=1e-9)
    np.testing.assert_allclose(found.angles_rad, dtheta, atol=1e-9)
    assert found.right


@pytest.mark.parametrize(('dr', 'degrees', 'right'), [
    (0.0029, 0.0, True), (0.0031, 0.0, False), (-0.0031, 0.0, False), (0.0, 0.49, True), (0.0, -0.51, False)])
def test_right_ends_at_the_tolerances(dr, degrees, right):
    assert compare(moved((0, 0, dr, 0, 0), np.deg2rad((0, 0, degrees, 0, 0))), TRUE).right is right


def test_tolerances_can_be_given():
    assert compare(moved((0, 0, 0.009, 0, 0)), TRUE, offset_tolerance_m=0.01).right


def test_a_missing_edge_leaves_one_unmatched():
    found = compare(half_plane_polygon(LINES[[0, 1, 2, 4]])[0], TRUE)
    assert not found.right
    assert (found.n_true, found.n_estimated) == (5, 4)
    assert np.isnan(found.offsets_m).tolist() == np.isnan(found.angles_rad).tolist() == [False] * 3 + [True, False]


def test_an_edge_too_many_is_wrong_but_the_walls_match():
    found = compare(half_plane_polygon(np.vstack((LINES, [(0.6, 0.7)])))[0], TRUE)
    assert not found.right
    np.testing.assert_allclose(found.offsets_m, 0.0, atol=1e-12)


def test_nothing_found():
    found = compare(np.empty((0, 2)), TRUE)
    assert not found.right
    assert (found.iou, found.n_estimated) == (0.0, 0)
    assert np.all(np.isnan(found.offsets_m))


def test_angles_wrap():
    square = half_plane_polygon([(1.0, np.pi), (1.0, 0.0), (1.0, np.pi / 2), (1.0, -np.pi / 2)])[0]
    turned = half_plane_polygon([(1.0, -np.pi + 1e-3), (1.0, 0.0), (1.0, np.pi / 2), (1.0, -np.pi / 2)])[0]
    assert np.abs(compare(turned, square).angles_rad).max() == pytest.approx(1e-3)


def test_as_many_walls_as_possible_are_matched_within_tolerance():
    rng = np.random.default_rng(2)
    for _ in range(30):
        estimated = half_plane_polygon(LINES + rng.normal(scale=(0.004, 0.006), size=LINES.shape))[0]
        found = compare(estimated, TRUE)
        within = np.sum((np.abs(found.offsets_m) <= 0.003) & (np.abs(found.angles_rad) <= np.deg2rad(0.5)))
        pairs = np.array([[_close(estimated, j, i) for j in range(5)] for i in range(5)])
        orders = itertools.permutations(range(5))
        assert within == max(sum(pairs[i, p] for i, p in enumerate(order)) for order in orders)
        assert found.right == (within == 5)


def _close(estimated, j, i):
    start, end = estimated[j], estimated[(j + 1) % len(estimated)]
    along = (end - start) / np.linalg.norm(end - start)
    middle = 0.5 * (TRUE[i] + TRUE[(i + 1) % 5])
    true_along = TRUE[(i + 1) % 5] - TRUE[i]
    cross = np.cross(np.append(true_along, 0), np.append(along, 0))[2]
    offset = np.cross(np.append(along, 0), np.append(middle - start, 0))[2]
    return abs(offset) <= 0.003 and abs(np.arctan2(cross, along @ true_along)) <= np.deg2rad(0.5)
