"""Exports, read back by readers that know nothing of this package."""

import csv
import dataclasses
import io
import json
import sys

import numpy as np
import pytest
import shapely
import shapely.geometry

from polymap_ros.errors import UsageError
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.plane import Plane, SpatialPose
from polymap_ros.results import export
from polymap_ros.results.dimensions import dimensions
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall

CORNERS = np.array([[3.0, 4.0], [4.5, 4.25], [4.0, 5.5], [2.75, 5.0]])
EDGES = tuple(Edge(r, theta, 0.875, 1e-4, 1e-3, pings=9) for r, theta in polygon_lines(CORNERS))
ROOM = Candidate(CORNERS, EDGES)
CLOSED = Estimate('closed', 'evidence', stamp_ns=12, polygon=ROOM)
HOLE_CORNERS = np.array([[3.3, 4.4], [3.2, 4.8], [3.6, 4.9], [3.7, 4.5]])
HOLE = Candidate(HOLE_CORNERS, tuple(Edge(r, theta, 0.75, 1e-4, 1e-3) for r, theta in polygon_lines(HOLE_CORNERS)))
SEAM = InnerWall(np.array([4.0, 4.25]), np.array([3.75, 5.25]), Edge(4.6, 0.25, 0.9, 2e-4, 1e-3, 7), -0.25, 0.9375)
PIERCED = dataclasses.replace(CLOSED, holes=(HOLE, Candidate(HOLE_CORNERS + (0.45, 0.3), HOLE.edges)),
                              inner_walls=(SEAM,))
AMBIGUOUS = Estimate('ambiguous', 'paper', alternatives=(ROOM, ROOM))


def rows(content):
    return list(csv.DictReader(io.StringIO(content.decode(), newline='')))


def column(table, *names):
    return np.array([[float(row[name]) for name in names] for row in table])


def test_csv_has_a_row_per_edge():
    table, sizes = rows(export.exported('csv', CLOSED, 'odom')), dimensions(ROOM)
    assert [row['edge'] for row in table] == ['0', '1', '2', '3']
    np.testing.assert_allclose(column(table, 'x1_m', 'y1_m'), CORNERS, atol=1e-8)
    np.testing.assert_allclose(column(table, 'x2_m', 'y2_m'), np.roll(CORNERS, -1, axis=0), atol=1e-8)
    np.testing.assert_allclose(column(table, 'length_m', 'length_std_m').T, sizes[:2], atol=1e-8)
    np.testing.assert_allclose(np.deg2rad(column(table, 'angle_deg', 'angle_std_deg')).T, sizes[2:4], atol=1e-8)
    np.testing.assert_allclose(column(table, 'r_m', 'r_std_m'), [(edge.r, 1e-4) for edge in EDGES], atol=1e-8)
    np.testing.assert_allclose(np.deg2rad(column(table, 'theta_deg', 'theta_std_deg')),
                               [(edge.theta, 1e-3) for edge in EDGES], atol=1e-8)
    assert {(row['likelihood'], row['pings']) for row in table} == {('0.875', '9')}


def test_csv_tells_edges_of_holes_and_inner_walls_apart():
    table, plain = (rows(export.exported('csv', estimate, 'odom')) for estimate in (PIERCED, CLOSED))
    assert list(plain[0]) == list(table[0])
    assert [(row['part'], row['edge']) for row in table] == [
        (part, str(i)) for part, n in (('outline', 4), ('hole 0', 4), ('hole 1', 4), ('inner wall', 1))
        for i in range(n)]
    assert table[:4] == plain
    np.testing.assert_allclose(column(table[4:8], 'x1_m', 'y1_m'), HOLE_CORNERS, atol=1e-8)
    np.testing.assert_allclose(column(table[4:8], 'x2_m', 'y2_m'), np.roll(HOLE_CORNERS, -1, axis=0), atol=1e-8)
    assert column(table[4:8], 'angle_deg').sum() == pytest.approx(6 * 180.0)
    assert {(row['reflection'], row['transmission']) for row in table[:12]} == {('', '')}
    seam = table[12]
    assert [seam[name] for name in ('x1_m', 'y1_m', 'x2_m', 'y2_m', 'r_m', 'r_std_m', 'pings')] == [
        '4', '4.25', '3.75', '5.25', '4.6', '0.0002', '7']
    assert float(seam['length_m']) == pytest.approx(np.hypot(0.25, 1.0))
    assert (seam['reflection'], seam['transmission'], seam['angle_deg'], seam['length_std_m']) == (
        '-0.25', '0.9375', '', '')


def test_csv_of_an_open_answer_has_the_walls_whose_ends_are_not_known():
    wall = Edge(-1e-12, 0.5, 0.95)
    [row] = rows(export.exported('csv', Estimate('open', 'evidence', walls=(wall,)), 'odom'))
    assert (row['r_m'], row['theta_deg'], row['likelihood']) == ('0', '28.647889757', '0.95')
    assert {row[name] for name in ('x1_m', 'y2_m', 'length_m', 'angle_deg', 'r_std_m', 'theta_std_deg')} == {''}


def test_geojson_is_a_polygon_in_metres():
    feature = json.loads(export.exported('geojson', CLOSED, 'odom'))
    shape = shapely.geometry.shape(feature['geometry'])
    assert shape.is_valid
    assert shape.exterior.is_ccw
    assert shape.equals(shapely.Polygon(CORNERS))
    found = feature['properties']
    assert (found['frame_id'], found['coordinates']) == ('odom', 'metres in odom, not WGS 84')
    assert found['area_m2'] == pytest.approx(shape.area)
    assert found['area_std_m2'] == dimensions(ROOM).area_std_m2
    assert found['lengths_m'][1] == pytest.approx(np.hypot(0.5, 1.25))
    assert sum(found['angles_deg']) == pytest.approx(360.0)


def test_geojson_has_inner_rings_and_a_line_for_each_inner_wall():
    found = json.loads(export.exported('geojson', PIERCED, 'odom'))
    assert found['type'] == 'FeatureCollection'
    place, seam = found['features']
    shape = shapely.geometry.shape(place['geometry'])
    assert shape.is_valid
    assert shape.exterior.is_ccw  # the right-hand rule of RFC 7946
    assert [ring.is_ccw for ring in shape.interiors] == [False, False]
    assert shape.equals(shapely.Polygon(CORNERS, [hole.vertices for hole in PIERCED.holes]))
    properties = place['properties']
    assert properties['area_m2'] == pytest.approx(shape.area)
    assert properties['area_std_m2'] > dimensions(ROOM).area_std_m2
    assert sum(properties['angles_deg']) == pytest.approx(360.0)
    assert [sum(each['angles_deg']) for each in properties['holes']] == pytest.approx(2 * [1080.0])
    line = shapely.geometry.shape(seam['geometry'])
    assert (line.geom_type, list(line.coords)) == ('LineString', [(4.0, 4.25), (3.75, 5.25)])
    assert {name: seam['properties'][name] for name in ('frame_id', 'inner_wall', 'reflection', 'transmission',
                                                        'likelihood')} == {
        'frame_id': 'odom', 'inner_wall': 0, 'reflection': -0.25, 'transmission': 0.9375, 'likelihood': 0.9}


def test_geojson_with_holes_alone_is_a_feature():
    found = json.loads(export.exported('geojson', dataclasses.replace(PIERCED, inner_walls=()), 'odom'))
    assert (found['type'], len(found['geometry']['coordinates'])) == ('Feature', 3)


def test_geojson_of_a_wall_s_plane_says_where_that_is():
    standing = Plane(SpatialPose((1.0, 2.0, 3.0), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))))
    found = json.loads(export.exported('geojson', CLOSED, 'odom', standing))['properties']
    assert found['coordinates'] == 'metres in the plane of the first pose in odom, not WGS 84'
    assert found['plane']['origin'] == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(found['plane']['y_axis'], [0.0, 0.0, 1.0], atol=1e-12)


def test_geojson_of_a_method_without_deviations_has_nulls():
    plain = Candidate(CORNERS, tuple(Edge(edge.r, edge.theta, 1.0) for edge in EDGES))
    found = json.loads(export.exported('geojson', Estimate('closed', 'paper', polygon=plain), 'odom'))['properties']
    assert (found['area_std_m2'], found['length_stds_m'], found['angle_stds_deg']) == (None, [None] * 4, [None] * 4)


def test_dxf_is_a_closed_polyline_in_metres():
    ezdxf = pytest.importorskip('ezdxf')
    drawing = ezdxf.read(io.StringIO(export.exported('dxf', CLOSED, 'odom').decode()))
    assert drawing.audit().errors == []
    assert (drawing.header['$INSUNITS'], drawing.header['$MEASUREMENT']) == (6, 1)
    [outline] = drawing.modelspace().query('LWPOLYLINE')
    assert outline.closed
    assert outline.dxf.layer == 'POLYMAP_OUTLINE'
    np.testing.assert_allclose(list(outline.get_points('xy')), CORNERS)
    labels = drawing.modelspace().query('TEXT')
    assert [label.dxf.text for label in labels] == [f'{length:.4f} m' for length in dimensions(ROOM).lengths_m]
    for label in labels:
        assert label.dxf.layer == 'POLYMAP_LABELS'
        assert shapely.Polygon(CORNERS).contains(shapely.Point(*label.dxf.align_point.vec2))


def test_dxf_has_a_polyline_per_ring_and_a_line_per_inner_wall():
    ezdxf = pytest.importorskip('ezdxf')
    drawing = ezdxf.read(io.StringIO(export.exported('dxf', PIERCED, 'odom').decode()))
    assert drawing.audit().errors == []
    space = drawing.modelspace()
    rings = space.query('LWPOLYLINE')
    assert [(ring.closed, ring.dxf.layer) for ring in rings] == [
        (True, layer) for layer in ('POLYMAP_OUTLINE', 'POLYMAP_HOLES', 'POLYMAP_HOLES')]
    np.testing.assert_allclose(list(rings[1].get_points('xy')), HOLE_CORNERS)
    [seam] = space.query('LINE')
    assert (seam.dxf.layer, *seam.dxf.start.vec2, *seam.dxf.end.vec2) == ('POLYMAP_INNER_WALLS', 4.0, 4.25, 3.75, 5.25)
    assert {entity.dxf.layer for entity in space} <= {layer.dxf.name for layer in drawing.layers}
    plate, labels = shapely.Polygon(CORNERS, [HOLE_CORNERS]), space.query('TEXT')
    assert len(labels) == 12
    assert all(plate.contains(shapely.Point(*label.dxf.align_point.vec2)) for label in labels[:8])
    plain = ezdxf.read(io.StringIO(export.exported('dxf', CLOSED, 'odom').decode()))
    assert not {'POLYMAP_HOLES', 'POLYMAP_INNER_WALLS'} & {layer.dxf.name for layer in plain.layers}


def test_the_same_answer_gives_the_same_drawing():
    pytest.importorskip('ezdxf')
    assert export.exported('dxf', CLOSED, 'odom') == export.exported('dxf', CLOSED, 'odom')


@pytest.mark.parametrize(('kind', 'estimate'), [
    (kind, estimate) for kind in ('csv', 'geojson', 'dxf') for estimate in (AMBIGUOUS, Estimate('open', 'paper'))])
def test_without_a_polygon_there_is_nothing_to_export(kind, estimate):
    assert export.exported(kind, estimate, 'odom') is None


def test_ezdxf_missing_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, 'ezdxf', None)
    with pytest.raises(UsageError, match=r"--export dxf needs ezdxf: pip install 'polymap_ros\[export\]'"):
        export.require_ezdxf()
