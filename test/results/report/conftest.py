"""Answers of every kind, as polygon.json has them, with what was heard in such a place."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.ping_queue import PingCounts
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.parameters import Parameters
from polymap_ros.results.polygon_json import encode, polygon_document
from polymap_ros.results.report.heard import Survey
from polymap_ros.solvers.estimate import Candidate, Caution, Edge, Estimate, InnerWall

COUNTS = PingCounts(received=60, used=52, dropped={'no_pose': 5, 'stale': 2})
CAUTION = Caution('unheard_corner', 'no echo has been near corner 2')


def polygon(corners, std_m=2e-4):
    """A polygon whose deviations are those seen from its middle."""
    middle = np.asarray(corners).mean(axis=0)
    edges = tuple(Edge(r, theta, 0.997, r_std=std_m, theta_std=std_m, pings=13)
                  for r, theta in polygon_lines(corners - middle))
    return Candidate(corners - middle, edges).moved(Pose(*middle))


def regular(n, size_m, x=0.0, y=0.0, turn=0.3):
    angles = turn + 2.0 * math.pi * np.arange(n) / n
    return np.column_stack((x + 0.5 * size_m * np.cos(angles), y + 0.5 * size_m * np.sin(angles)))


def heard_within(corners):
    """A loop of pings about the middle of a place, and the map that its walls alone make."""
    middle, size_m = corners.mean(axis=0), float(np.ptp(corners, axis=0).max())
    turns = np.linspace(0.0, 5.5, 40)
    path = middle + 0.18 * size_m * np.column_stack((np.cos(turns), 0.6 * np.sin(turns)))
    start = Pose(*path[0], 0.4)
    step_m = size_m / 400.0
    beam_map = BeamformingMap(Parameters().replaced(
        {'grid.range_max_m': size_m, 'grid.range_step_m': step_m, 'grid.angle_step_deg': 2.0}).grid)
    for x, y in path:
        distances = [abs(r - x * math.cos(theta) - y * math.sin(theta)) for r, theta in polygon_lines(corners)]
        envelope = sum(np.exp(-((beam_map.r_m - distance) / (0.01 * size_m)) ** 2) for distance in distances)
        place = start.inverse().apply(np.array([x, y]))
        beam_map.add(*place, envelope.astype(np.float32))
    return Survey(path, start, beam_map.normalised(), beam_map.theta_rad, beam_map.r_m,
                 drop_texts={'no_pose': 'no odometry after 12.3 s'})


def document(estimate, frame_id='odom', recording='square_room', parameters=None):
    found = polygon_document(estimate, frame_id, COUNTS, parameters or Parameters())
    return {**json.loads(encode(found)), 'recording': recording}


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.8], [0.0, 0.8]])
SLOT = np.array([[0.12, 0.1], [0.1, 0.2], [0.6, 0.22], [0.6, 0.1]])
EDGE = Edge(-0.749, 0.04 - math.pi, 0.96, 1e-4, 2e-4, 12)
MIRRORED = SQUARE * (1.0, -1.0) + (0.0, 0.7)
PLACES = {
    'square': SQUARE, 'triangle': regular(3, 0.2), 'ten': regular(10, 2.0), 'hall': regular(6, 48.0, turn=0.1),
    'long': np.array([[0.0, 0.0], [48.0, 0.0], [48.0, 2.5], [0.0, 2.0]]),
    'high': np.array([[0.0, 0.0], [1.2, 0.0], [1.0, 20.0], [0.0, 20.0]]),
    'utm': SQUARE + (691234.5, 5334567.25),
}


def answers():
    """Documents and what was heard, by a name."""
    parameters = Parameters().replaced({'medium.model': 'constant', 'grid.range_max_m': 2.0, 'echo.kind': 'envelope'})
    found = {
        name: (document(Estimate('closed', 'evidence', polygon=polygon(corners), iou_free_area=0.93,
                                 cautions=(CAUTION,) if name == 'square' else ()), parameters=parameters),
               heard_within(corners))
        for name, corners in PLACES.items()}
    seam = InnerWall(np.array([0.75, 0.02]), np.array([0.72, 0.78]), EDGE, -0.25, 0.93)
    holes = polygon(SLOT), polygon(regular(5, 0.12, 0.85, 0.6)[::-1])
    found['pierced'] = document(Estimate(
        'closed', 'evidence', polygon=polygon(SQUARE), holes=holes, inner_walls=(seam,))), heard_within(SQUARE)
    both = tuple(polygon(corners) for corners in (SQUARE, MIRRORED[::-1]))
    found['ambiguous'] = (document(Estimate('ambiguous', 'evidence', alternatives=both, cautions=(CAUTION,))),
                          heard_within(SQUARE))
    walls = polygon(SQUARE).edges[:2]
    open_ = document(Estimate('open', 'evidence', walls=walls, cautions=(CAUTION,)))
    open_['walls'][1]['mirror'] = {'r': 0.1, 'theta': 2.6, 'likelihood': 0.5}
    found['open'] = open_, heard_within(SQUARE)
    silent = Survey(np.zeros((0, 2)), None, np.zeros((180, 5), np.float32), np.arange(180) / 30.0, np.arange(5) * 0.1)
    found['silent'] = document(Estimate('open', 'evidence', cautions=(CAUTION,)), frame_id=''), silent
    return found


@pytest.fixture(scope='session')
def pages():
    """Answers of every kind by a name."""
    return answers()


@pytest.fixture
def made():
    """The makers of these."""
    return SimpleNamespace(polygon=polygon, document=document, heard_within=heard_within, caution=CAUTION)
