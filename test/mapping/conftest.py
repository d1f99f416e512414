"""Shared parts of the mapping tests: heard scenes, and references written without the package's own geometry."""

import numpy as np
import pytest
import shapely

from polymap_ros.acoustics.ping import Ping
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import simulate

FAR = 1e4
"""Half the side of the square that stands for the whole plane, in units of the farthest line."""


def _clipped_plane(lines):
    """Vertices of an intersection of half-planes: a huge square clipped by one after the other."""
    polygon = FAR * np.abs(lines[:, 0]).max() * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    for r, theta in lines:
        depth = r - polygon @ (np.cos(theta), np.sin(theta))
        kept = []
        for i in range(len(polygon)):
            if depth[i - 1] * depth[i] < 0.0:
                share = depth[i - 1] / (depth[i - 1] - depth[i])
                kept.append(polygon[i - 1] + share * (polygon[i] - polygon[i - 1]))
            if depth[i] >= 0.0:
                kept.append(polygon[i])
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def _bounded_area(lines):
    """The intersection of half-planes as a shapely polygon, empty where it is unbounded."""
    angles = np.sort(np.mod(lines[:, 1], 2 * np.pi))
    if np.diff(angles, append=angles[0] + 2 * np.pi).max() > np.pi - 1e-9:
        return shapely.Polygon()
    polygon = _clipped_plane(lines)
    return shapely.Polygon(polygon) if len(polygon) > 2 else shapely.Polygon()


def _shapely_iou(first, second):
    union = first.union(second).area
    return first.intersection(second).area / union if union else 0.0


def _feed(mapper, scene, samples):
    """Give a mapper all poses and pings of a scene."""
    for stamp_ns, pose, row in zip(scene.stamps_ns.tolist(), scene.reported_poses().tolist(), samples, strict=True):
        mapper.add_pose(stamp_ns, Pose(*pose))
        mapper.add_ping(Ping(stamp_ns, row, scene.period_s, scene.t0_s))


def _finished(steps):
    """What a generator returns in the end."""
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return done.value


@pytest.fixture(scope='session')
def finished():
    return _finished


@pytest.fixture(scope='session')
def bounded_area():
    return _bounded_area


@pytest.fixture(scope='session')
def shapely_iou():
    return _shapely_iou


@pytest.fixture(scope='session')
def feed():
    return _feed


@pytest.fixture(scope='session')
def quadrilateral():
    """A random scene with four edges, and the samples of its pings."""
    scene = random_scene(1, 4)
    return scene, simulate(scene).astype(np.float32)


@pytest.fixture(scope='session')
def heard(quadrilateral):
    """A mapper that has heard all pings of the quadrilateral; only to be read."""
    scene, samples = quadrilateral
    mapper = PolygonMapper(scene.parameters(Parameters()).replaced({'solver.method': 'paper'}))
    _feed(mapper, scene, samples)
    return mapper
