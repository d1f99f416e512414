"""Exports, read back by readers that know nothing of this package."""

import csv
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
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate

CORNERS = np.array([[3.0, 4.0], [4.5, 4.25], [4.0, 5.5], [2.75, 5.0]])
EDGES = tuple(Edge(r, theta, 0.875, 1e-4, 1e-3, pings=9) for r, theta in polygon_lines(CORNERS))
ROOM = Candidate(CORNERS, EDGES)
CLOSED = Estimate('closed', 'evidence', stamp_ns=12, polygon=ROOM)
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
