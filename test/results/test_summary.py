"""The summary says what the file says."""

import numpy as np

from polymap_ros.mapping.comparison import compare
from polymap_ros.mapping.estimate import Candidate, Caution, Edge, Estimate
from polymap_ros.mapping.lines import polygon_lines
from polymap_ros.mapping.ping_queue import PingCounts
from polymap_ros.results.summary import summary

CORNERS = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
ROOM = Candidate(CORNERS, tuple(Edge(r, theta, 0.5, pings=4) for r, theta in polygon_lines(CORNERS)))


def test_a_closed_room():
    estimate = Estimate('closed', 'paper', polygon=ROOM, cost=-3.25, iou_free_area=0.5)
    shifted = CORNERS + [0.0, 0.002]
    lines = summary(estimate, 'odom', PingCounts(5, 4, {'stale': 1}), comparison=compare(shifted, CORNERS)).splitlines()
    assert lines[0] == 'closed: 4 edges (method paper, cost -3.25)'
    assert lines[2].split() == ['0', '0.0000', '0.0000', '2.0000', '0.0000', '-', '-90.000', '-', '0.500', '4']
    assert [len(line) for line in lines[1:6]] == [len(lines[1])] * 5
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
    assert text.splitlines()[3].split() == ['0', '1.0000', '0.250', '28.648', '0.125', '0.990', '60']


def test_answers_without_a_polygon():
    caution = Caution('straight_path', 'drive a turn')
    text = summary(Estimate('ambiguous', 'paper', alternatives=(ROOM, ROOM), cautions=(caution,)), 'odom', PingCounts())
    assert text.startswith('ambiguous: 2 polygons fit (method paper)')
    assert 'candidate 2' in text
    assert 'warning (straight_path): drive a turn' in text
    text = summary(Estimate('open', 'paper', walls=ROOM.edges[:1]), 'odom', PingCounts(), [Caution('x', 'y')])
    assert text.startswith('open: no polygon closes (method paper)\ncertain walls\n')
    assert text.endswith('pings: 0 received, 0 used\nwarning (x): y')
