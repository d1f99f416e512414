"""Odometry far from its origin, such as UTM: what has 64 bits is exact, and what has 32 says so."""

import csv
import io
import json

import numpy as np
import pytest

from polymap_ros import Parameters, load_scene, map_polygon, simulate
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.ping_queue import PingCounts
from polymap_ros.messages.markers import Drawing, marker_array_message
from polymap_ros.messages.outputs import coarse_polygon, polygon_message
from polymap_ros.recordings.writing import make
from polymap_ros.results.export import exported
from polymap_ros.results.occupancy import occupancy
from polymap_ros.results.polygon_json import polygon_document

UTM = np.array([448_251.123456, 5_411_932.654321])


@pytest.fixture(scope='module')
def answers():
    """The same plate at the origin and in UTM coordinates."""
    scene = load_scene('triangle')
    samples = simulate(scene)
    return [map_polygon(scene.poses + [*origin, 0.0], samples, period_s=1e-6) for origin in (np.zeros(2), UTM)]


def test_what_has_64_bits_is_exact(answers):
    near, far = answers
    corners = near.polygon.vertices + UTM
    document = polygon_document(far, 'utm', PingCounts(), Parameters())
    geojson = json.loads(exported('geojson', far, 'utm'))['geometry']['coordinates'][0][:-1]
    rows = list(csv.DictReader(io.StringIO(exported('csv', far, 'utm').decode())))
    [outline] = [each for each in marker_array_message(make, Drawing('utm', far, (), np.empty((0, 2)))).markers
                 if each.ns == 'outline']
    for found in (far.polygon.vertices, document['vertices'], geojson,
                  [[float(row['x1_m']), float(row['y1_m'])] for row in rows],
                  [[point.x, point.y] for point in outline.points[:-1]]):
        np.testing.assert_allclose(found, corners, atol=1e-7, rtol=0.0)
    local = polygon_document(near, 'odom', PingCounts(), Parameters())
    for edge, expected in zip(document['edges'], local['edges'], strict=True):
        assert edge['length'] == pytest.approx(expected['length'], abs=1e-7)
        assert edge['length_std'] == pytest.approx(expected['length_std'], rel=0.05)
    grid = occupancy(far.polygon.vertices, 0.005, 0.1)
    np.testing.assert_allclose(grid.origin, np.floor((corners.min(axis=0) - 0.1) / 0.005) * 0.005, atol=1e-7)


def test_the_polygon_of_32_bits_says_what_it_loses(answers):
    near, far = answers
    assert coarse_polygon(near.polygon) is None
    told = coarse_polygon(far.polygon)
    points = polygon_message(make, 0, 'utm', far.polygon.vertices).polygon.points
    lost_m = np.abs(np.float32([[point.x, point.y] for point in points]) - far.polygon.vertices).max()
    assert told.code == 'coarse_polygon'
    assert f'rounded by up to {1e3 * lost_m:.0f} mm' in told.text
    assert lost_m > 0.01


@pytest.mark.parametrize(('away_m', 'is_told'), [(50.0, False), (30_000.0, True)])
def test_how_far_that_is(answers, away_m, is_told):
    moved = answers[0].polygon.moved(Pose(away_m, 0.0))
    assert (coarse_polygon(moved) is not None) is is_told
