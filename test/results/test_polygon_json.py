"""polygon.json holds to the contract, whatever the answer."""

import dataclasses
import json

import numpy as np
import pytest

from polymap_ros import __version__
from polymap_ros.cautions import Caution
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.storey import Storey
from polymap_ros.hearing.ping_queue import PingCounts
from polymap_ros.parameters import Parameters
from polymap_ros.results.dimensions import dimensions
from polymap_ros.results.polygon_json import encode, polygon_document
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall

EDGE = Edge(r=0.5, theta=np.float64(-1.5), likelihood=np.float32(0.25), r_std=1e-4, theta_std=np.nan, pings=np.int64(7))
SQUARE = Candidate(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), (EDGE,) * 4)
CLOSED = Estimate('closed', 'paper', stamp_ns=12, polygon=SQUARE, cost=-1.5, iou_free_area=0.9)
COUNTS = PingCounts(received=10, used=7, dropped={'stale': 1, 'no_pose': 2})


def written(estimate, parameters=None, cautions=()):
    def refuse(name):
        raise AssertionError(f'{name} is not JSON')

    document = polygon_document(estimate, 'odom', COUNTS, parameters or Parameters(), cautions)
    return json.loads(encode(document), parse_constant=refuse)


def test_the_keys_are_those_of_the_contract():
    found = written(CLOSED)
    assert list(found) == ['format', 'recording', 'status', 'frame_id', 'stamp_ns', 'method', 'vertices', 'edges',
                           'area', 'area_std', 'walls', 'alternatives', 'cost', 'iou_free_area', 'pings',
                           'trajectory', 'warnings',
                           'parameters', 'software']
    assert found['recording'] is None
    assert (found['format'], found['status'], found['frame_id'], found['stamp_ns'], found['method']) == (
        'polymap/1', 'closed', 'odom', 12, 'paper')
    assert found['vertices'] == [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    assert found['edges'] == 4 * [
        {'r': 0.5, 'theta': -1.5, 'likelihood': 0.25, 'r_std': 1e-4, 'theta_std': None, 'pings': 7,
         'length': 1.0, 'length_std': None, 'angle': np.pi / 2, 'angle_std': None}]
    assert (found['area'], found['area_std']) == (1.0, None)
    assert (found['cost'], found['iou_free_area']) == (-1.5, 0.9)
    assert found['pings'] == {'received': 10, 'used': 7, 'dropped': {'no_pose': 2, 'stale': 1}}
    assert list(found['pings']['dropped']) == ['no_pose', 'stale']
    assert found['software'] == {'polymap_ros': __version__}
    assert found['parameters'] == Parameters().flat()


def test_floor_and_ceiling_are_there_where_they_were_heard():
    storey = Storey(np.array([0.3, 2.1]), np.array([0.8, 0.75]))
    assert written(dataclasses.replace(CLOSED, storey=storey))['height'] == {
        'floor_m': 0.3, 'floor_reflection': 0.8, 'ceiling_m': 2.1, 'ceiling_reflection': 0.75}
    alone = Storey(storey.height_m[:1], storey.reflection[:1])
    assert list(written(dataclasses.replace(CLOSED, storey=alone))['height']) == ['floor_m', 'floor_reflection']
    assert 'height' not in written(CLOSED)


def ring(corners):
    edges = tuple(Edge(r, theta, 0.9, 1e-4, 1e-3, 5) for r, theta in polygon_lines(corners))
    return Candidate(np.array(corners), edges)


HOLE = ring([[0.25, 0.25], [0.25, 0.75], [0.5, 0.75]])
SEAM = InnerWall(
    np.array([0.6, -0.0]), np.array([0.6, 1.0]), Edge(0.6, 0.0, 0.97, 2e-4, pings=8), -0.3, np.float64(0.95))


def test_holes_and_inner_walls_are_there_where_there_are_any():
    plate = dataclasses.replace(CLOSED, polygon=ring(SQUARE.vertices), holes=(HOLE, HOLE), inner_walls=(SEAM,))
    found = written(plate)
    assert list(found)[6:12] == ['vertices', 'edges', 'area', 'area_std', 'holes', 'inner_walls']
    hole = found['holes'][1]
    assert hole['vertices'] == [[0.25, 0.25], [0.25, 0.75], [0.5, 0.75]]
    assert hole['edges'][0].keys() == found['edges'][0].keys()
    assert [edge['length'] for edge in hole['edges']] == pytest.approx([0.5, 0.25, np.sqrt(0.3125)])
    assert [edge['angle'] for edge in hole['edges']] == pytest.approx(
        [2 * np.pi - np.arctan(0.5), 1.5 * np.pi, 2 * np.pi - np.arctan(2.0)])
    assert hole['area'] == pytest.approx(0.0625)
    assert found['area'] == pytest.approx(0.875)
    assert found['area_std'] > written(dataclasses.replace(plate, holes=()))['area_std'] > 0.0
    assert found['inner_walls'] == [{
        'start': [0.6, 0.0], 'end': [0.6, 1.0], 'reflection': -0.3, 'transmission': 0.95, 'r': 0.6, 'theta': 0.0,
        'likelihood': 0.97, 'r_std': 2e-4, 'theta_std': None, 'pings': 8}]
    for other in (written(CLOSED), written(dataclasses.replace(plate, status='open'))):
        assert not {'holes', 'inner_walls'} & other.keys()


def test_an_ambiguous_answer_has_alternatives_only():
    cautions = (Caution('mirror_image', 'a', 'b'),)
    estimate = Estimate('ambiguous', 'paper', alternatives=(SQUARE, SQUARE), cautions=cautions)
    found = written(estimate, cautions=[Caution('slip', 'c', 'd')])
    assert (found['status'], found['vertices'], found['edges'], found['walls']) == ('ambiguous', [], [], [])
    assert [list(each) for each in found['alternatives']] == 2 * [['vertices', 'edges', 'area', 'area_std']]
    assert found['warnings'] == [{'code': 'mirror_image', 'text': 'a; b'}, {'code': 'slip', 'text': 'c; d'}]
    assert (found['cost'], found['iou_free_area']) == (None, None)


def test_an_open_answer_has_walls_only_even_if_a_polygon_came_with_it():
    found = written(dataclasses.replace(CLOSED, status='open', walls=(EDGE,)))
    assert (found['vertices'], found['edges'], found['area'], len(found['walls'])) == ([], [], None, 1)
    assert found['walls'][0].keys() == written(CLOSED)['edges'][0].keys()
    assert (found['walls'][0]['length'], found['walls'][0]['angle']) == (None, None)


def test_sizes_have_their_deviations():
    edges = tuple(Edge(r, theta, 1.0, r_std=1e-4, theta_std=1e-3) for r, theta in polygon_lines(SQUARE.vertices))
    square = Candidate(SQUARE.vertices, edges)
    found, sizes = written(dataclasses.replace(CLOSED, polygon=square)), dimensions(square)
    assert [edge['length_std'] for edge in found['edges']] == sizes.length_stds_m.tolist()
    assert [edge['angle_std'] for edge in found['edges']] == sizes.angle_stds_rad.tolist()
    assert found['area_std'] == sizes.area_std_m2 > 0.0


def test_what_is_not_finite_is_null_and_zero_has_no_sign():
    found = written(dataclasses.replace(CLOSED, cost=np.inf, iou_free_area=-0.0))
    assert found['cost'] is None
    assert str(found['iou_free_area']) == '0.0'


def test_no_paths_are_told():
    parameters = Parameters().replaced({
        'output.dir': '/home/me/maps', 'output.load_path': '../old/state.npz', 'pulse.path': '/data/pulse.npy'})
    used = written(CLOSED, parameters)['parameters']
    assert (used['output.dir'], used['output.load_path'], used['pulse.path']) == ('maps', 'state.npz', 'pulse.npy')


def test_the_text_can_be_read_line_by_line():
    lines = encode(polygon_document(CLOSED, 'odom', COUNTS, Parameters())).decode().splitlines()
    assert '  [1.0, 0.0],' in lines
    assert '  "grid.range_step_m": 0.005,' in lines
    assert max(map(len, lines)) < 200


def test_a_recording_is_named_and_its_place_is_not():
    document = polygon_document(CLOSED, 'odom', COUNTS, Parameters(), recording='dr\udcffve')
    assert json.loads(encode(document))['recording'] == 'dr\\udcffve'  # a name that is no UTF-8, as UTF-8
