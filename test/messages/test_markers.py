"""Markers as they arrive: order, geometry, what is drawn for each status."""

import dataclasses

import numpy as np
import pytest
import shapely

from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.markers import Drawing, answer_line, delete_all_message, drawing_of, marker_array_message
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall

MARKERS = 'visualization_msgs/msg/MarkerArray'
SQUARE = np.array([[1.0, 1.0], [3.0, 1.0], [3.0, 2.0], [1.0, 2.0]])
EDGES = tuple(Edge(float(r), float(theta), 1.0) for r, theta in polygon_lines(SQUARE))
RING = np.array([[1.5, 1.2], [2.5, 1.2], [2.0, 1.8], [1.5, 1.2]])
PATH = np.array([[1.5, 1.5], [2.0, 1.5], [2.0, 1.6]])
CLOSED = Estimate('closed', 'paper', polygon=Candidate(SQUARE, EDGES), cost=-1.5, iou_free_area=0.9)


def markers(make, transported, estimate, rings=(RING,), path=PATH):
    message = marker_array_message(make, Drawing('odom', estimate, rings, path))
    received = transported(message, MARKERS).markers
    assert received[0].action == 3
    assert [each.action for each in received[1:]] == [0] * (len(received) - 1)
    assert {(each.header.frame_id, each.header.stamp.sec, each.header.stamp.nanosec) for each in received} == {
        ('odom', 0, 0)}
    assert all(each.pose.orientation.w == 1.0 for each in received)
    return {each.ns: each for each in received[1:]}


def points(marker):
    return np.array([[point.x, point.y] for point in marker.points])


def test_closed_polygon_is_drawn_with_its_lines_path_and_free_area(make, transported):
    found = markers(make, transported, CLOSED)
    assert list(found) == ['outline', 'area', 'lines', 'free_area', 'path', 'text']
    assert np.allclose(points(found['outline']), np.vstack([SQUARE, SQUARE[:1]]))
    filled = shapely.MultiPolygon([shapely.Polygon(each) for each in points(found['area']).reshape(-1, 3, 2)])
    assert (filled.area, filled.bounds) == (pytest.approx(2.0), (1.0, 1.0, 3.0, 2.0))
    assert np.allclose(points(found['path']), PATH)
    assert np.allclose(points(found['free_area']), RING[[0, 1, 1, 2, 2, 3]])
    assert found['text'].text == 'closed: 4 edges, cost -1.5, IoU with free area 0.900'
    assert all(each.color.a > 0.0 and max(each.scale.x, each.scale.z) > 0.0 for each in found.values())


def test_holes_are_left_out_and_inner_walls_are_drawn(make, transported):
    holes = [np.array([[1.2, 1.2], [1.3, 1.7], [1.6, 1.4]]), np.array([[2.2, 1.2], [2.2, 1.8], [2.8, 1.8], [2.8, 1.2]])]
    seam = InnerWall(np.array([1.9, 1.0]), np.array([1.8, 2.0]), EDGES[0], 0.3, 0.9)
    plate = dataclasses.replace(CLOSED, holes=tuple(Candidate(each, ()) for each in holes), inner_walls=(seam,))
    found = markers(make, transported, plate)
    assert list(found) == ['outline', 'holes', 'area', 'inner_walls', 'lines', 'free_area', 'path', 'text']
    drawn = shapely.polygonize(list(shapely.linestrings(points(found['holes']).reshape(-1, 2, 2))))
    filled = shapely.union_all([shapely.Polygon(each) for each in points(found['area']).reshape(-1, 3, 2)])
    whole = shapely.Polygon(SQUARE, holes)
    assert shapely.symmetric_difference(filled, whole).area < 1e-9
    assert shapely.union(filled, drawn).area == pytest.approx(2.0)
    assert np.allclose(points(found['inner_walls']), [seam.start, seam.end])
    assert len({tuple(vars(found[name].color).values()) for name in ('outline', 'inner_walls', 'lines')}) == 3
    assert found['text'].text.startswith('closed: 4 edges, 2 holes, 1 inner wall, cost -1.5')


@pytest.mark.parametrize('status', ['open', 'ambiguous'])
def test_without_an_outline_nothing_inside_is_drawn(make, transported, status):
    found = markers(make, transported, Estimate(status, 'evidence', walls=EDGES, holes=(Candidate(RING, ()),)))
    assert not {'holes', 'area', 'inner_walls'} & found.keys()


def test_lines_lie_on_their_edges_and_reach_beyond_the_corners(make, transported):
    ends = points(markers(make, transported, CLOSED)['lines']).reshape(4, 2, 2)
    for edge, pair, start, stop in zip(EDGES, ends, SQUARE, np.roll(SQUARE, -1, axis=0), strict=True):
        normal = np.array([np.cos(edge.theta), np.sin(edge.theta)])
        assert np.allclose(pair @ normal, edge.r)
        along = np.array([-normal[1], normal[0]])
        assert (pair @ along).min() < min(start @ along, stop @ along)
        assert (pair @ along).max() > max(start @ along, stop @ along)


def test_open_and_ambiguous_answers_have_lines_but_no_outline(make, transported):
    found = markers(make, transported, Estimate('open', 'evidence', walls=EDGES[:2]))
    assert 'outline' not in found
    assert len(points(found['lines'])) == 4
    assert found['text'].text == 'open: certain walls: 2'
    both = Candidate(SQUARE, EDGES), Candidate(SQUARE + 1.0, EDGES)
    found = markers(make, transported, Estimate('ambiguous', 'evidence', alternatives=both))
    assert 'outline' not in found
    assert len(points(found['lines'])) == 16
    assert found['text'].text == 'ambiguous: 2 polygons fit'


def test_nothing_yet_is_a_text_alone(make, transported):
    found = markers(make, transported, None, rings=(), path=np.empty((0, 2)))
    assert list(found) == ['text']
    assert found['text'].text == 'waiting for echoes'


def test_delete_all_is_one_marker(make, transported):
    received = transported(delete_all_message(make, 'odom'), MARKERS).markers
    assert [(each.action, each.header.frame_id) for each in received] == [(3, 'odom')]


@pytest.mark.parametrize('start', [Pose(0.0, 0.0), Pose(2.0, -1.0, 0.7)])
def test_drawing_is_in_the_odometrys_frame(start):
    mapper = PolygonMapper(Parameters())
    mapper.free_area.add(0.5, 0.0, 0.3)
    mapper.start_pose, mapper.intake.frame_id = start, 'map'
    drawing = drawing_of(mapper)
    centre = start.apply(np.array([0.5, 0.0]))
    distances = np.hypot(*(drawing.free_area[0] - centre).T)
    assert drawing.frame_id == 'map'
    assert distances == pytest.approx(0.3, abs=0.003)
    assert answer_line(drawing.estimate) == 'waiting for echoes'
