"""What may be claimed from the lines found, and what is said with it."""

import dataclasses

import numpy as np
import pytest
import shapely

from polymap_ros.geometry.overlap import Region
from polymap_ros.solvers.map_verdict import conclude
from polymap_ros.solvers.snapshot import Snapshot

LINES = np.array([(1.0, 0.1), (0.8, 1.7), (1.2, 3.0), (0.9, 4.6)])
LIKELIHOOD = np.array([0.9, 0.8, 0.7, 0.6])
AROUND = [(0.0, 0.0), (0.3, 0.0), (0.3, 0.4), (-0.2, 0.1), (-0.5, -0.3)]


def snapshot(positions, free=None, step=0.005):
    free = shapely.Point(0.0, 0.0).buffer(0.5) if free is None else free
    return Snapshot(np.ones((4, 9), np.float32), step * np.arange(9), np.zeros(4), True, Region(free),
                    np.array(positions, dtype=float).reshape(-1, 2), 77, np.ones(len(positions), int))


def codes(estimate):
    return [caution.code for caution in estimate.cautions]


def test_a_polygon_with_its_edges():
    estimate = conclude('paper', snapshot(AROUND), LINES, LIKELIHOOD, -12.0)
    assert (estimate.status, estimate.method, estimate.stamp_ns, estimate.cost) == ('closed', 'paper', 77, -12.0)
    assert codes(estimate) == []
    polygon = shapely.Polygon(estimate.polygon.vertices)
    assert polygon.is_valid
    assert polygon.exterior.is_ccw
    edges = estimate.polygon.edges
    assert [(edge.r, edge.theta, edge.likelihood) for edge in edges] == [
        (*line, likelihood) for line, likelihood in zip(LINES.tolist(), LIKELIHOOD.tolist(), strict=True)]
    free = shapely.Point(0.0, 0.0).buffer(0.5)
    assert estimate.iou_free_area == pytest.approx(free.area / polygon.area)
    for i, edge in enumerate(edges):
        segment = shapely.LineString([estimate.polygon.vertices[i], estimate.polygon.vertices[(i + 1) % 4]])
        heard = [shapely.Point(x, y) for x, y in AROUND]
        normal = np.array((np.cos(edge.theta), np.sin(edge.theta)))
        feet = [np.array((p.x, p.y)) + (edge.r - normal @ (p.x, p.y)) * normal for p in heard]
        assert edge.pings == sum(segment.distance(shapely.Point(foot)) < 1e-9 for foot in feet)


@pytest.mark.parametrize('count', [0, 1, 2])
def test_too_few_pings_are_no_polygon(count):
    estimate = conclude('paper', snapshot(AROUND[:count]), LINES, LIKELIHOOD)
    assert (estimate.status, estimate.polygon, estimate.walls, estimate.alternatives) == ('open', None, (), ())
    assert codes(estimate) == ['too_few_pings']
    assert str(count) in estimate.cautions[0].text


def test_lines_that_bound_no_area_are_no_polygon():
    estimate = conclude('paper', snapshot(AROUND), LINES[:2], LIKELIHOOD[:2])
    assert (estimate.status, estimate.polygon, codes(estimate)) == ('open', None, ['not_closed'])


def test_no_range_at_all_is_no_polygon():
    estimate = conclude('rectangle', snapshot(AROUND, shapely.Polygon()), LINES, LIKELIHOOD)
    assert (estimate.status, estimate.polygon, codes(estimate)) == ('open', None, ['no_free_area'])


@pytest.mark.parametrize('direction', [0.0, 0.7, np.pi / 2])
@pytest.mark.parametrize('scale', [1e-3, 1.0])
def test_a_straight_path_leaves_the_polygon_and_its_mirror_image(direction, scale):
    along = np.array((np.cos(direction), np.sin(direction)))
    start = scale * np.array((0.1, -0.05))
    positions = start + scale * np.outer(np.linspace(-0.4, 0.5, 20), along)
    lines = LINES * (scale, 1.0)
    estimate = conclude('paper', snapshot(positions, step=0.005 * scale), lines, LIKELIHOOD)
    assert (estimate.status, estimate.polygon, codes(estimate)) == ('ambiguous', None, ['straight_path'])
    one, other = estimate.alternatives
    away = shapely.affinity.rotate(shapely.Polygon(one.vertices), -np.rad2deg(direction), origin=tuple(start))
    mirrored = shapely.affinity.scale(away, 1.0, -1.0, origin=tuple(start))
    expected = shapely.affinity.rotate(mirrored, np.rad2deg(direction), origin=tuple(start))
    found = shapely.Polygon(other.vertices)
    assert found.symmetric_difference(expected).area < 1e-9 * expected.area
    assert found.exterior.is_ccw
    twins = {edge.likelihood: edge for edge in one.edges}
    for i, edge in enumerate(other.edges):
        for corner in (other.vertices[i], other.vertices[(i + 1) % 4]):
            assert corner @ (np.cos(edge.theta), np.sin(edge.theta)) == pytest.approx(edge.r, abs=1e-12)
        twin = twins[edge.likelihood]
        assert edge.pings == twin.pings
        for place in positions:  # what makes them twins: every ping hears both at the same distance
            assert distance(edge, place) == pytest.approx(distance(twin, place), abs=1e-9 * scale)


def distance(edge, place):
    return edge.r - place @ (np.cos(edge.theta), np.sin(edge.theta))


def test_a_straight_path_without_a_closed_polygon_is_open():
    estimate = conclude('paper', snapshot([(0.1 * i, 0.0) for i in range(9)]), LINES[:2], LIKELIHOOD[:2])
    assert (estimate.status, estimate.alternatives, codes(estimate)) == ('open', (), ['straight_path'])


@pytest.mark.parametrize(('width', 'length', 'status'), [
    (0.0, 0.0, 'ambiguous'), (0.004, 0.05, 'ambiguous'), (0.006, 0.05, 'closed'), (0.018, 1.0, 'ambiguous'),
    (0.022, 1.0, 'closed')])
def test_how_straight_is_straight(width, length, status):
    positions = [(0.0, 0.0), (0.5 * length, width), (length, 0.0)]
    assert conclude('paper', snapshot(np.subtract(positions, (length / 2, 0.0))), LINES, LIKELIHOOD).status == status


def test_pings_beyond_a_wall_are_said_and_rounding_is_not():
    estimate = conclude('paper', snapshot([*AROUND, (1.5, 0.0), (0.0, -1.5)]), LINES, LIKELIHOOD)
    assert (estimate.status, codes(estimate)) == ('closed', ['path_outside'])
    assert estimate.cautions[0].text.startswith('2 of 7')
    x, y = 1.004 * np.cos(0.1), 1.004 * np.sin(0.1)
    assert codes(conclude('paper', snapshot([*AROUND, (x, y)]), LINES, LIKELIHOOD)) == []


def test_an_answer_moves_with_the_frame():
    from polymap_ros.geometry.pose import Pose

    estimate = conclude('paper', snapshot(AROUND), LINES, LIKELIHOOD)
    moved = estimate.moved(Pose(3.0, -2.0, 2.5))
    for i, edge in enumerate(moved.polygon.edges):
        for corner in (moved.polygon.vertices[i], moved.polygon.vertices[(i + 1) % 4]):
            assert corner @ (np.cos(edge.theta), np.sin(edge.theta)) == pytest.approx(edge.r, abs=1e-12)
        assert dataclasses.replace(edge, r=0.0, theta=0.0) == dataclasses.replace(
            estimate.polygon.edges[i], r=0.0, theta=0.0)


@pytest.mark.parametrize(('positions', 'finding'), [
    (np.outer(np.linspace(-0.4, 0.5, 20), (np.cos(0.7), np.sin(0.7))), 'the path is one straight line, about which'),
    ([(0.0, 0.0), (0.5, 0.016), (1.0, 0.0)], 'the path keeps within 8 mm of one straight line, about which'),
    (np.zeros((9, 2)), 'all pings are from one place, within 0 mm: '),
    (np.linspace((0.0, 0.0), (0.003, 0.002), 9), 'all pings are from one place, within 3 mm: ')])
def test_how_straight_a_path_is_said_without_rounding_errors(positions, finding):
    caution, = conclude('paper', snapshot(positions), LINES, LIKELIHOOD).cautions
    assert caution.finding.startswith(finding)
    assert 'drive a turn' in caution.remedy
    assert ('odometry' in caution.remedy) == ('one place' in finding)
