"""The summary says what the file says."""

import dataclasses

import numpy as np

from polymap_ros.cautions import Caution
from polymap_ros.geometry.alignment import PathError
from polymap_ros.geometry.inside_error import compare_inside
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.storey import Storey
from polymap_ros.hearing.ping_queue import PingCounts
from polymap_ros.results.dimensions import dimensions
from polymap_ros.results.summary import summary
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall

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


def test_what_is_inside_is_compared_where_there_is_any():
    estimate, seam = Estimate('closed', 'evidence', polygon=ROOM), np.array((SEAM.start, SEAM.end))

    def told(*inside):
        return [line for line in summary(estimate, 'odom', PingCounts(5, 5, {}), comparison=compare(CORNERS, CORNERS),
                                         inside=compare_inside(*inside)).splitlines() if ' found, ' in line]

    assert told([], [], [], []) == []
    assert told([HOLE_CORNERS], [], [HOLE_CORNERS], [seam]) == [
        '  holes: 1 found, 1 of 1 right', '  inner walls: 0 found, 0 of 1 right']
    assert told([HOLE_CORNERS], [seam], [], [seam + 0.1]) == [
        '  holes: 1 found, 0 of 0 right', '  inner walls: 1 found, 0 of 1 right']


HOLE_CORNERS = np.array([[0.5, 0.25], [0.5, 0.75], [1.0, 0.75], [1.0, 0.25]])
HOLE = Candidate(HOLE_CORNERS, tuple(
    Edge(r, theta, 0.75, 1e-4, 1e-4, pings=3) for r, theta in polygon_lines(HOLE_CORNERS)))
SEAM = InnerWall(np.array([1.5, -0.0]), np.array([1.5, 0.9]), Edge(1.5, 0.0, 0.96, 2e-4, pings=7), -0.25, 0.92)


def test_holes_and_inner_walls_are_told_with_their_numbers():
    estimate = Estimate('closed', 'evidence', polygon=ROOM, holes=(HOLE,), inner_walls=(SEAM, SEAM))
    lines = summary(estimate, 'odom', PingCounts()).splitlines()
    assert lines[0] == 'closed: 4 edges, 1 hole, 2 inner walls (method evidence)'
    assert 'area 1.75 m2 without the hole, extent 2 m, corners counter-clockwise in odom' in lines
    hole = lines.index('hole 0')
    assert lines[hole + 2].split()[:4] == ['0', '0.50000', '0.25000', '0.50000']
    assert [line.split()[5] for line in lines[hole + 2:hole + 6]] == ['270.000'] * 4
    assert lines[hole + 7].split() == ['0', '0.50000', '0.100', '0.000', '0.006', '0.750', '3']
    assert lines[hole + 11] == (f'area 0.25 m2 +- {1e4 * dimensions(HOLE).area_std_m2:.2g} cm2, corners clockwise, '
                                'angles within the material')
    assert lines[hole + 12] == 'inner walls'
    assert lines[hole + 14].split() == ['0', '1.50000', '0.00000', '1.50000', '0.90000', '-0.250', '0.920']
    assert lines[hole + 16].split()[:3] == ['wall', 'r', '[m]']
    assert lines[hole + 18].split() == ['1', '1.50000', '0.200', '0.000', '-', '0.960', '7']
    several = summary(dataclasses.replace(estimate, holes=(HOLE,) * 2, inner_walls=()), 'odom', PingCounts())
    assert several.startswith('closed: 4 edges, 2 holes (method evidence)\n')
    assert 'area 1.5 m2 without the 2 holes, extent' in several
    assert 'inner wall' not in several


def test_a_rooms_height_is_told():
    storey = Storey(np.array([0.3, 2.1]), np.array([0.8, 0.75]))
    text = summary(Estimate('closed', 'evidence', polygon=ROOM, storey=storey), 'odom', PingCounts())
    assert 'floor 0.3000 m from the device, reflects 0.80\nceiling 2.1000 m from the device, reflects 0.75' in text


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
    caution = Caution('straight_path', 'the path is straight', 'drive a turn')
    estimate = Estimate('ambiguous', 'paper', alternatives=(ROOM, ROOM))
    text = summary(estimate, 'odom', PingCounts(), [caution])
    assert text.startswith('ambiguous: 2 polygons fit (method paper)')
    assert 'candidate 2' in text
    assert 'warning (straight_path): the path is straight; drive a turn' in text
    caution = Caution('not_closed', 'x', 'y')
    text = summary(Estimate('open', 'paper', walls=ROOM.edges[:1]), 'odom', PingCounts(), [caution])
    assert text.startswith('open: no polygon closes (method paper)\ncertain walls\n')
    assert text.endswith('pings: 0 received, 0 used\nwarning (not_closed): x; y')


def test_columns_stay_apart_far_away_and_say_what_r_is_about():
    far = CORNERS + [500_000.0, 5_400_000.0]
    edges = tuple(Edge(r, theta, 0.99, 1e-4, 1e-5, 4).moved(Pose(500_000.0, 5_400_000.0))
                  for r, theta in polygon_lines(CORNERS))
    answer = Estimate('closed', 'evidence', polygon=Candidate(far, edges))
    lines = summary(answer, 'odom', PingCounts()).splitlines()
    assert [len(line.split()) for line in lines[2:6] + lines[7:11]] == [7] * 8
    assert lines[3].split()[1:3] == ['500002.00000', '5400000.00000']
    [said] = [line for line in lines if line.startswith('r and its deviation')]
    assert said == ("r and its deviation are about the frame's origin, 5423099 m away; at their middles the edges are "
                    'good to 0.1 mm')
    assert not any('away' in line for line in summary(
        Estimate('closed', 'evidence', polygon=ROOM), 'odom', PingCounts()).splitlines())


def test_an_error_of_the_path_is_told_in_millimetres_and_degrees():
    found = summary(Estimate('open', 'evidence'), 'odom', PingCounts(), path_error=PathError(1.2345e-4, 3e-16, 0.01))
    assert 'ATE 0.123 mm, worst ping 0.000 mm, heading 0.573 deg rms' in found
