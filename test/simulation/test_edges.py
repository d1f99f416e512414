"""Phases of reflections in simulated echoes, against ways drawn by hand."""

import numpy as np
import pytest

from polymap_ros.acoustics.plate_edge import free_edge_delay
from polymap_ros.errors import SceneError
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.simulation.edges import Edges, delays
from polymap_ros.simulation.propagation import ways
from polymap_ros.simulation.scene_file import load_scene

ROOM = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])
HERE = np.array([0.7, 0.4])


def told(edges):
    images = visible_images(ROOM, HERE, 2)
    return images, delays(edges, np.random.default_rng(1), ROOM, ways(images, ROOM, HERE))


def test_each_reflection_delays_by_as_much():
    images, found = told(Edges(delay_deg=40.0))
    np.testing.assert_allclose(found, np.deg2rad(40.0) * images.order)


def test_each_wall_has_a_delay_of_its_own():
    images, found = told(Edges(spread_deg=30.0))
    by_wall = {int(walls[0]): delay for walls, order, delay in zip(images.walls, images.order, found, strict=True)
               if order == 1}
    assert len({round(delay, 9) for delay in by_wall.values()}) == 4
    assert max(abs(delay) for delay in by_wall.values()) <= np.deg2rad(30.0)
    for walls, order, delay in zip(images.walls, images.order, found, strict=True):
        assert delay == pytest.approx(sum(by_wall[int(wall)] for wall in walls[:order]))


def test_a_free_edge_delays_by_the_angle_of_incidence():
    images, found = told(Edges(kind='free', poisson=0.3))
    for place, walls, order, delay in zip(images.position_m, images.walls, images.order, found, strict=True):
        way = np.abs(place - HERE) / np.linalg.norm(place - HERE)  # of a rectangle, each leg has these components
        cosines = [way[1 - wall % 2] for wall in walls[:order]]
        assert delay == pytest.approx(sum(float(free_edge_delay(np.array(cosine), 0.3)) for cosine in cosines))


def test_a_scene_file_says_what_its_edges_do(tmp_path):
    path = tmp_path / 'plate.scene.yaml'
    text = 'vertices: [[0, 0], [1, 0], [0, 1]]\nposes: [[0.2, 0.2, 0.0]]\n'
    path.write_text(text + 'edges: {kind: free, poisson: 0.3}\n')
    assert load_scene(path).edges == Edges(kind='free', poisson=0.3)
    path.write_text(text + 'edges: {kind: soft}\n')
    with pytest.raises(SceneError, match=r'edges\.kind'):
        load_scene(path)
