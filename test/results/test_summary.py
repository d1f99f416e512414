"""The summary says what the file says."""

import numpy as np

from polymap_ros.mapping.comparison import compare
from polymap_ros.mapping.estimate import Candidate, Caution, Edge, Estimate
from polymap_ros.mapping.lines import polygon_lines
from polymap_ros.mapping.ping_queue import PingCounts
from polymap_ros.results.dimensions import dimensions
from polymap_ros.results.summary import summary

CORNERS = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
ROOM = Candidate(CORNERS, tuple(Edge(r, theta, 0.5, pings=4) for r, theta in polygon_lines(CORNERS)))


def test_a_closed_room():
    estimate = Estimate('closed', 'paper', polygon=ROOM, cost=-3.25, iou_free_area=0.5)
    shifted = CORNERS + [0.0, 0.002]
    lines = summary(estimate, 'odom', PingCounts(5, 4, {'stale': 1}), comparison=compare(shifted, CORNERS)).splitlines()
    assert lines[0] == 'closed: 4 edges (method paper, cost -3.25)'
    assert lines[2].split() == ['0', '0.00000', '0.00000', '2.00000', '-', '90.000', '-']
    assert lines[7].split() == ['0', '0.00000', '-', '-90.000', '-', '0.500', '4']
    assert [len(line) for line in lines[1:11]] == [len(lines[1])] * 5 + [len(lines[6])] * 5
    assert 'area 2 m2, extent 2 m, corners counter-clockwise in odom' in lines
    assert 'pings: 5 received, 4 used, dropped: 1 stale' in lines
    assert 'IoU with the free area: 0.5000' in lines
    assert 'against the truth: 4 edges of 4, right; IoU 0.9960' in lines
    assert '  wall offset: median 1 mm, largest 2 mm' in lines
    assert '  wall angle: median 0 deg, largest 0 deg' in lines


def test_deviations_are_in_millimetres_and_degrees():
    edge = Edge(1.0, 0.5, 0.99, r_std=0.00025, theta_std=np.deg2rad(0.125), pings=60)
    text = summary(Estimate('open', 'evidence', walls=(edge,)), 'odom', PingCounts())
    assert text.splitlines()[2].split() == ['edge', 'r', '[m]', '+-', '[mm]', 'theta', '[deg]', '+-', '[deg]',
                                            'likelihood', 'pings']
    assert text.splitlines()[3].split() == ['0', '1.00000', '0.250', '28.648', '0.125', '0.990', '60']


def test_sizes_come_with_their_deviations():
    edges = tuple(Edge(r, theta, 1.0, r_std=0.0003, theta_std=np.deg2rad(0.03)) for r, theta in polygon_lines(CORNERS))
    polygon = Candidate(CORNERS, edges)
    found = dimensions(polygon)
    lines = summary(Estimate('closed', 'evidence', polygon=polygon), 'odom', PingCounts()).splitlines()
    assert lines[1].split() == ['edge', 'x', '[m]', 'y', '[m]', 'length', '[m]', '+-', '[mm]', 'corner', '[deg]', '+-',
                                '[deg]']
    assert lines[3].split() == ['1', '2.00000', '0.00000', '1.00000', f'{1e3 * found.length_stds_m[1]:.3f}', '90.000',
                                f'{np.rad2deg(found.angle_stds_rad[1]):.3f}']
    assert f'area 2 m2 +- {1e4 * found.area_std_m2:.2g} cm2, extent 2 m, corners counter-clockwise in odom' in lines


def test_zero_has_no_sign():
    wall = Edge(-1e-9, -1e-9, 0.5)
    line = summary(Estimate('open', 'paper', walls=(wall,)), 'odom', PingCounts()).splitlines()[3]
    assert line.split() == ['0', '0.00000', '-', '0.000', '-', '0.500', '0']


def test_answers_without_a_polygon():
    caution = Caution('straight_path', 'drive a turn')
    text = summary(Estimate('ambiguous', 'paper', alternatives=(ROOM, ROOM), cautions=(caution,)), 'odom', PingCounts())
    assert text.startswith('ambiguous: 2 polygons fit (method paper)')
    assert 'candidate 2' in text
    assert 'warning (straight_path): drive a turn' in text
    text = summary(Estimate('open', 'paper', walls=ROOM.edges[:1]), 'odom', PingCounts(), [Caution('x', 'y')])
    assert text.startswith('open: no polygon closes (method paper)\ncertain walls\n')
    assert text.endswith('pings: 0 received, 0 used\nwarning (x): y')
