"""Floor and ceiling of simulated rooms: echoes against those of pyroomacoustics; what a scene file may say of them."""

import dataclasses

import numpy as np
import pyroomacoustics
import pytest

from polymap_ros.errors import ParameterError, SceneError
from polymap_ros.parameters import MediumParameters
from polymap_ros.simulation.height import Height
from polymap_ros.simulation.random_scenes import air_filled, random_scene
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import noise_free

SIZE = np.array([3.1, 2.3])
HEIGHT = Height(0.3, 2.1)


def test_echoes_are_those_of_pyroomacoustics_images():
    corners = np.array([(0.0, 0.0), (SIZE[0], 0.0), tuple(SIZE), (0.0, SIZE[1])])
    plain = air_filled(random_scene(1, 4))
    poses = np.array([(1.17, 0.81, 0.0), (2.2, 1.9, 1.0)])
    scene = dataclasses.replace(plain, vertices=corners, poses=poses, order=3, height=HEIGHT, reflection=1.0)

    def heard(position):
        room = pyroomacoustics.ShoeBox((*SIZE, HEIGHT.floor_m + HEIGHT.ceiling_m), fs=16000, max_order=3)
        place = np.append(position, HEIGHT.floor_m)
        room.add_source(place)
        room.add_microphone(place)
        room.image_source_model()
        distance = np.linalg.norm(room.sources[0].images.T - place, axis=1)
        distance = distance[distance > 1e-6]
        return distance, np.ones(len(distance))

    found, expected = noise_free(scene), noise_free(scene, heard)
    # They compute in single precision: a micrometre is a thousandth of a radian.
    np.testing.assert_allclose(found, expected, atol=5e-3 * np.abs(expected).max())


def test_a_plate_has_no_height():
    plate = random_scene(1, 5)
    with pytest.raises(SceneError, match=r'height is that of a room.*medium\.model'):
        dataclasses.replace(plate, height=HEIGHT)


def test_a_scene_file_says_how_high_a_room_is(tmp_path):
    path = tmp_path / 'room.scene.yaml'
    text = ('vertices: [[0, 0], [3, 0], [0, 3]]\nposes: [[0.5, 0.5, 0.0]]\n'
            'medium: {model: constant, speed_m_s: 343.0}\n')
    path.write_text(text + 'height: {floor_m: 0.3, ceiling_m: 2.1, ceiling_reflection: 0.8}\n')
    scene = load_scene(path)
    assert scene.height == Height(0.3, 2.1, 1.0, 0.8)
    assert scene.height.storey.reflection.tolist() == [1.0, 0.8]
    for wrong, name in (('{floor_m: -1}', r'height\.floor_m'), ('{roof_m: 2}', 'roof_m')):
        path.write_text(text + f'height: {wrong}\n')
        with pytest.raises((SceneError, ParameterError), match=name):
            load_scene(path)


def test_one_plane_alone():
    triangle = np.array([(0.0, 0.0), (3.0, 0.0), (0.0, 3.0)])
    scene = Scene('r', triangle, np.array([(0.5, 0.5, 0.0)]), medium=MediumParameters(model='constant'),
                  height=Height(ceiling_m=2.0))
    assert scene.height.storey.height_m.tolist() == [2.0]
