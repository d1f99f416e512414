"""The map in which a robot is localised, read from what a map's folder holds; every file that is none is named."""

import json

import numpy as np
import pytest

from polymap_ros.errors import ParameterError, StateError
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.hearing.ping_queue import PingCounts
from polymap_ros.parameters import Parameters
from polymap_ros.results.loading import check_loading, loaded_mapper, read_outline
from polymap_ros.results.polygon_json import encode, polygon_document
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]


@pytest.fixture
def folder(tmp_path):
    (tmp_path / 'polygon.json').write_text(json.dumps({'status': 'closed', 'vertices': SQUARE}))
    return tmp_path


@pytest.mark.parametrize('name', ['', 'polygon.json', 'state.npz'])
def test_a_map_is_given_by_its_folder_or_a_file_of_it(folder, name):
    np.testing.assert_array_equal(read_outline(folder / name), SQUARE)
    parameters = Parameters().replaced({'slam.mode': 'localization', 'output.load_path': str(folder / name)})
    check_loading(parameters)
    assert loaded_mapper(parameters, None).evidence.outline is not None


def test_a_map_with_holes_and_inner_walls_gives_its_outline(folder):
    """As it was written, whatever stands inside."""
    def ring(corners):
        return Candidate(np.array(corners), tuple(Edge(r, theta, 1.0) for r, theta in polygon_lines(corners)))

    hole, seam = ring([[0.2, 0.2], [0.2, 0.4], [0.4, 0.4]]), InnerWall(
        np.array([0.6, 0.0]), np.array([0.6, 1.0]), Edge(0.6, 0.0, 1.0), 0.3, 0.9)
    answer = Estimate('closed', 'evidence', polygon=ring(SQUARE), holes=(hole,), inner_walls=(seam,))
    content = encode(polygon_document(answer, 'odom', PingCounts(), Parameters()))
    assert {'holes', 'inner_walls'} <= json.loads(content).keys()
    (folder / 'polygon.json').write_bytes(content)
    np.testing.assert_array_equal(read_outline(folder), SQUARE)
    parameters = Parameters().replaced({'slam.mode': 'localization', 'output.load_path': str(folder)})
    assert loaded_mapper(parameters, None).evidence.outline is not None


@pytest.mark.parametrize(('text', 'told'), [
    ('{', 'is no polygon.json: JSONDecodeError'),
    ('[1]', 'it has no vertices'),
    ('{"vertices": 3}', 'it has no vertices'),
    ('{"status": "open", "vertices": []}', 'its map is open: it holds no polygon'),
    ('{"vertices": [[0, 0], [1, 1], [1, 0], [0, 1]]}', 'edges cross'),
    ('{"vertices": [[0, 0], ["a", 1], [1, 0]]}', 'not numbers'),
    ('[' * 100_000, 'is no polygon.json: RecursionError'),
])
def test_what_is_no_map_is_named(tmp_path, text, told):
    path = tmp_path / 'polygon.json'
    path.write_text(text)
    with pytest.raises(StateError, match=told) as caught:
        read_outline(path)
    assert str(path) in str(caught.value)


def test_a_map_that_is_missing_is_named(tmp_path):
    with pytest.raises(StateError, match=r'polygon\.json: cannot be read: No such file'):
        read_outline(tmp_path)
    with pytest.raises(ParameterError, match=r'output\.load_path'):
        check_loading(Parameters().replaced({'slam.mode': 'localization'}))
