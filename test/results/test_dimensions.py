"""Lengths, angles, area and their deviations, against shapely and against polygons drawn at random."""

import dataclasses

import numpy as np
import pytest
import shapely

from polymap_ros.mapping.estimate import Candidate, Edge
from polymap_ros.mapping.lines import polygon_lines
from polymap_ros.mapping.pose import Pose
from polymap_ros.results.dimensions import dimensions

PENTAGON = np.array([[0.0, 0.0], [1.0, 0.0], [1.3, 0.7], [0.6, 1.2], [-0.2, 0.6]])
NEEDLE = np.array([[0.0, 0.0], [2.0, 0.0], [2.1, 0.3]])


def polygon_of(corners, seed):
    """A polygon whose edges have covariances drawn at random, of 0.1 to 0.4 mm and 0.01 to 0.04 degrees."""
    generator = np.random.default_rng(seed)
    edges = []
    for r, theta in polygon_lines(corners):
        r_std, theta_std = generator.uniform(1e-4, 4e-4), generator.uniform(2e-4, 7e-4)
        both = generator.uniform(-0.9, 0.9) * r_std * theta_std
        edges.append(Edge(r, theta, 1.0, r_std=r_std, theta_std=theta_std, r_theta_covariance=both))
    return Candidate(corners, tuple(edges))


def drawn(polygon, number, seed):
    """Polygons with the errors of their edges drawn from the covariances: the walls as segments, cut by shapely."""
    generator = np.random.default_rng(seed)
    walls = []
    for edge in polygon.edges:
        covariance = [[edge.r_std**2, edge.r_theta_covariance], [edge.r_theta_covariance, edge.theta_std**2]]
        r, theta = generator.multivariate_normal([edge.r, edge.theta], covariance, number).T
        foot = r[:, None] * np.column_stack((np.cos(theta), np.sin(theta)))
        reach = 10.0 * np.column_stack((-np.sin(theta), np.cos(theta)))
        walls.append(shapely.linestrings(np.stack((foot - reach, foot + reach), axis=1)))
    return [shapely.intersection(walls[k - 1], walls[k]) for k in range(len(walls))]


def measured(corners):
    """Lengths, angles by the law of cosines, and areas of many polygons, from points of shapely."""
    n = len(corners)
    lengths = [shapely.distance(corners[k], corners[(k + 1) % n]) for k in range(n)]
    across = [shapely.distance(corners[k - 1], corners[(k + 1) % n]) for k in range(n)]
    angles = [np.arccos((lengths[k - 1] ** 2 + lengths[k] ** 2 - across[k] ** 2) / (2 * lengths[k - 1] * lengths[k]))
              for k in range(n)]
    areas = shapely.area(shapely.polygons(np.stack([shapely.get_coordinates(points) for points in corners], axis=1)))
    return np.array(lengths), np.array(angles), areas


@pytest.mark.parametrize('corners', [PENTAGON, NEEDLE, PENTAGON + [30.0, -20.0]])
def test_sizes_are_those_of_shapely(corners):
    found = dimensions(polygon_of(corners, 1))
    lengths, angles, area = measured(shapely.points(corners)[:, None])
    np.testing.assert_allclose(found.lengths_m, lengths[:, 0], rtol=1e-12)
    np.testing.assert_allclose(found.angles_rad, angles[:, 0], atol=1e-9)
    assert found.area_m2 == pytest.approx(area[0], rel=1e-10)
    assert sum(found.angles_rad) == pytest.approx((len(corners) - 2) * np.pi)


@pytest.mark.parametrize(('corners', 'seed'), [(PENTAGON, 2), (PENTAGON, 3), (NEEDLE, 4)])
def test_deviations_are_those_of_polygons_drawn_at_random(corners, seed):
    polygon = polygon_of(corners, seed)
    found = dimensions(polygon)
    lengths, angles, areas = measured(drawn(polygon, 10_000, seed))
    np.testing.assert_allclose(found.length_stds_m, lengths.std(axis=1), rtol=0.04)
    np.testing.assert_allclose(found.angle_stds_rad, angles.std(axis=1), rtol=0.04)
    assert found.area_std_m2 == pytest.approx(areas.std(), rel=0.04)


def test_sizes_do_not_depend_on_the_frame():
    """r and its deviation do: seen from afar, the angle's error moves the line's nearest point."""
    near = polygon_of(PENTAGON, 5)
    far = near.moved(Pose(40.0, -25.0, 0.7))
    assert max(edge.r_std for edge in far.edges) > 10.0 * max(edge.r_std for edge in near.edges)
    for one, other in zip(dimensions(near), dimensions(far), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)


def test_what_no_solver_says_is_not_known():
    polygon = polygon_of(PENTAGON, 6)
    unknown = dataclasses.replace(polygon.edges[2], theta_std=None)
    found = dimensions(Candidate(PENTAGON, (*polygon.edges[:2], unknown, *polygon.edges[3:])))
    assert np.all(np.isnan(found.length_stds_m))
    assert np.all(np.isnan(found.angle_stds_rad))
    assert np.isnan(found.area_std_m2)
    assert np.all(found.lengths_m > 0.0)
