"""What is published of an answer with holes and inner walls, moved into the frame that is shown."""

import numpy as np

from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.latched import LATCHED, Latched
from polymap_ros.parameters import Parameters
from polymap_ros.results.occupancy import occupancy_of
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall


def ring(corners):
    return Candidate(np.array(corners), tuple(Edge(r, theta, 1.0) for r, theta in polygon_lines(corners)))


PLATE = Estimate(
    'closed', 'evidence', polygon=ring([[1.0, 1.0], [3.0, 1.0], [3.0, 2.0], [1.0, 2.0]]),
    holes=(ring([[1.2, 1.2], [1.2, 1.7], [1.6, 1.7], [1.6, 1.2]]),),
    inner_walls=(InnerWall(np.array([2.0, 1.1]), np.array([2.0, 1.9]), Edge(2.0, 0.0, 1.0), 0.3, 0.9),))


def test_the_map_has_holes_and_inner_walls_and_the_polygon_its_outline_alone(make, transported):
    mapper, sent = PolygonMapper(Parameters()), {}
    mapper.start_pose, mapper.intake.frame_id, mapper.estimate = Pose(1.8, 1.5), 'odom', PLATE

    def keep(name, message):
        sent[name] = transported(message, LATCHED[name])

    latched = Latched(make, keep, 'polymap_node', lambda estimate: occupancy_of(estimate, Parameters()))
    for publish in latched.drawn(mapper):
        publish()
    assert len(sent['polygon'].polygon.points) == 4
    assert {'holes', 'area', 'inner_walls'} <= {marker.ns for marker in sent['markers'].markers}
    info = sent['map'].info
    cells = np.asarray(sent['map'].data).reshape(info.height, info.width)

    def at(x, y):
        return cells[int((y - info.origin.position.y) / info.resolution),
                     int((x - info.origin.position.x) / info.resolution)]

    assert [at(1.4, 1.5), at(2.5, 1.5), at(2.001, 1.5), at(1.3, 1.2), at(0.95, 1.5)] == [-1, 0, 100, 100, -1]
