"""Lengths, angles, area and their deviations, against shapely and against polygons drawn at random."""

import dataclasses

import numpy as np
import pytest
import shapely

from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.pose import Pose
from polymap_ros.results.dimensions import dimensions, net_area
from polymap_ros.solvers.estimate import Candidate, Edge

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


def together(polygon, seed):
    """The same, whose edges err together: by the shift and the turn of all, and each two by a part in common."""
    generator = np.random.default_rng(seed)
    size = 2 * len(polygon.edges)
    shared = generator.normal(size=(size, size)) * np.tile((1e-4, 2e-4), len(polygon.edges))[:, None]
    normals = [(np.cos(edge.theta), np.sin(edge.theta)) for edge in polygon.edges]
    moved = np.array([row for x, y in normals for row in ((x, y, 0.0), (0.0, 0.0, 1.0))])
    covariance = shared @ shared.T / size + moved @ np.diag((1e-3, 1e-3, 2e-3)) ** 2 @ moved.T
    edges = [dataclasses.replace(edge, r_std=np.sqrt(covariance[2 * k, 2 * k]),
                                 theta_std=np.sqrt(covariance[2 * k + 1, 2 * k + 1]),
                                 r_theta_covariance=covariance[2 * k, 2 * k + 1])
             for k, edge in enumerate(polygon.edges)]
    return Candidate(polygon.vertices, tuple(edges), covariance)


def drawn(polygon, number, seed):
    """Polygons with the errors of their edges drawn from the covariances: the walls as segments, cut by shapely."""
    generator = np.random.default_rng(seed)
    walls = []
    covariance = polygon.covariance
    if covariance is None:
        covariance = np.zeros((2 * len(polygon.edges), 2 * len(polygon.edges)))
        for k, edge in enumerate(polygon.edges):
            covariance[2 * k:2 * k + 2, 2 * k:2 * k + 2] = [
                [edge.r_std**2, edge.r_theta_covariance], [edge.r_theta_covariance, edge.theta_std**2]]
    means = [value for edge in polygon.edges for value in (edge.r, edge.theta)]
    for r, theta in generator.multivariate_normal(means, covariance, number).T.reshape(len(polygon.edges), 2, number):
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
    for polygon in (polygon_of(corners, seed), together(polygon_of(corners, seed), seed)):
        found = dimensions(polygon)
        lengths, angles, areas = measured(drawn(polygon, 10_000, seed))
        np.testing.assert_allclose(found.length_stds_m, lengths.std(axis=1), rtol=0.04)
        np.testing.assert_allclose(found.angle_stds_rad, angles.std(axis=1), rtol=0.04)
        assert found.area_std_m2 == pytest.approx(areas.std(), rel=0.04)


@pytest.mark.parametrize(('corners', 'seed'), [(PENTAGON, 2), (NEEDLE, 4)])
def test_a_hole_is_measured_from_the_material_around_it(corners, seed):
    """Clockwise: the same lengths, area and deviations, and at each corner what is left of a whole turn."""
    hole = polygon_of(corners[::-1], seed)
    for found in (dimensions(hole), dimensions(together(hole, seed)), dimensions(hole.moved(Pose(3.0, -2.0, 1.0)))):
        lengths, angles, area = measured(shapely.points(corners[::-1])[:, None])
        np.testing.assert_allclose(found.lengths_m, lengths[:, 0], rtol=1e-9)
        np.testing.assert_allclose(found.angles_rad, 2.0 * np.pi - angles[:, 0], atol=1e-9)
        assert found.area_m2 == pytest.approx(area[0], rel=1e-9)
    for polygon in (hole, together(hole, seed)):
        found, (lengths, angles, areas) = dimensions(polygon), measured(drawn(polygon, 10_000, seed))
        np.testing.assert_allclose(found.length_stds_m, lengths.std(axis=1), rtol=0.04)
        np.testing.assert_allclose(found.angle_stds_rad, angles.std(axis=1), rtol=0.04)
        assert found.area_std_m2 == pytest.approx(areas.std(), rel=0.04)


def test_what_holes_leave_of_an_area_is_as_good_as_all_rings_together():
    plate, holes = polygon_of(4.0 * PENTAGON, 8), [polygon_of(PENTAGON[::-1] + shift, 9) for shift in (1.0, 2.2)]
    found, (outline, *apart) = net_area(plate, holes), [dimensions(each) for each in (plate, *holes)]
    assert found[0] == pytest.approx(shapely.Polygon(4.0 * PENTAGON, [each.vertices for each in holes]).area)
    assert found[1] ** 2 == pytest.approx(outline.area_std_m2**2 + sum(hole.area_std_m2**2 for hole in apart))
    assert net_area(plate, []) == (outline.area_m2, outline.area_std_m2)
    assert np.isnan(net_area(plate, [Candidate(PENTAGON[::-1], (Edge(1.0, 0.0, 1.0),) * 5)])[1])


def test_sizes_do_not_depend_on_the_frame():
    """r and its deviation do: seen from afar, the angle's error moves the line's nearest point."""
    for near in (polygon_of(PENTAGON, 5), together(polygon_of(PENTAGON, 5), 5)):
        far = near.moved(Pose(40.0, -25.0, 0.7))
        assert max(edge.r_std for edge in far.edges) > 10.0 * max(edge.r_std for edge in near.edges)
        for one, other in zip(dimensions(near), dimensions(far), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6)


def test_a_covariance_of_all_edges_is_moved_as_that_of_each():
    far = together(polygon_of(PENTAGON, 7), 7).moved(Pose(3.0, -2.0, -2.0))
    variances = [value for edge in far.edges for value in (edge.r_std**2, edge.theta_std**2)]
    np.testing.assert_allclose(np.diag(far.covariance), variances, rtol=1e-9)
    both = [edge.r_theta_covariance for edge in far.edges]
    np.testing.assert_allclose(np.diag(far.covariance, 1)[::2], both, rtol=1e-9)


def test_what_no_solver_says_is_not_known():
    polygon = polygon_of(PENTAGON, 6)
    unknown = dataclasses.replace(polygon.edges[2], theta_std=None)
    found = dimensions(Candidate(PENTAGON, (*polygon.edges[:2], unknown, *polygon.edges[3:])))
    assert np.all(np.isnan(found.length_stds_m))
    assert np.all(np.isnan(found.angle_stds_rad))
    assert np.isnan(found.area_std_m2)
    assert np.all(found.lengths_m > 0.0)


def test_the_area_is_as_exact_far_from_the_origin():
    shape = np.array([[0.0, 0.0], [0.25, 0.0], [0.25, 0.125], [0.0, 0.125]])
    for x, y in ((0.0, 0.0), (691234.5, 5334567.25), (-3e8, 7.75)):
        corners = shape + (x, y)
        polygon = Candidate(corners, tuple(Edge(r, theta, 1.0) for r, theta in polygon_lines(corners)))
        assert dimensions(polygon).area_m2 == 0.25 * 0.125
