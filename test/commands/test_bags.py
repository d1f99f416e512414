"""The recordings in bags/ are what `polymap_simulate` makes today, and can be mapped."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from polymap_ros.commands.simulate import main
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.echoes import ping_from_message
from polymap_ros.messages.odometry import stamped_pose
from polymap_ros.parameter_file import load_parameters
from polymap_ros.parameters import Parameters
from polymap_ros.recordings.truth import read_truth

BAGS = Path(__file__).parents[2] / 'bags'
SCENES = ('triangle', 'quadrilateral', 'pentagon', 'rectangle', 'l_shape', 'room')


def read(path):
    with AnyReader([path]) as reader:
        return [(connection.topic, ns, reader.deserialize(raw, connection.msgtype), connection.msgtype)
                for connection, ns, raw in reader.messages()]


@pytest.mark.parametrize('scene', SCENES)
def test_a_recording_can_be_made_again(scene, tmp_path):
    assert main([scene, '--output', str(tmp_path / scene)]) == 0
    kept, made = read(BAGS / scene), read(tmp_path / scene)
    assert [entry[:2] for entry in kept] == [entry[:2] for entry in made]
    for (topic, _, first, _), (_, _, second, _) in zip(kept, made, strict=True):
        stamps = [(message.header.stamp.sec, message.header.stamp.nanosec) for message in (first, second)]
        assert stamps[0] == stamps[1]
        if topic == '/echo':
            peak = np.abs(first.intensities).max()
            np.testing.assert_allclose(second.intensities, first.intensities, rtol=0.0, atol=1e-6 * peak)
        else:
            np.testing.assert_allclose([first.pose.pose.position.x, first.pose.pose.position.y],
                                       [second.pose.pose.position.x, second.pose.pose.position.y], atol=1e-12)
    assert (BAGS / scene / 'truth.json').read_text() == (tmp_path / scene / 'truth.json').read_text()
    paths = (np.loadtxt(folder / scene / 'truth.tum') for folder in (BAGS, tmp_path))
    np.testing.assert_allclose(next(paths), next(paths), atol=1e-12)
    files = {path.name for path in (tmp_path / scene).iterdir()}
    told = {'params.yaml'} if scene == 'room' else set()
    assert files == {f'{scene}.mcap', 'metadata.yaml', 'truth.json', 'truth.tum'} | told


@pytest.mark.parametrize('scene', SCENES)
def test_default_parameters_find_the_plate_and_a_rooms_own_the_room(scene):
    told = BAGS / scene / 'params.yaml'
    mapper = PolygonMapper(load_parameters(told) if told.exists() else Parameters())
    for topic, ns, message, kind in read(BAGS / scene):
        if topic == '/odom':
            stamp_ns, frame_id, pose = stamped_pose(message)
            mapper.add_pose(stamp_ns, pose, frame_id)
        else:
            mapper.add_ping(ping_from_message(message, kind, mapper.parameters.echo, ns))
    mapper.finish()
    estimate = mapper.solve()
    assert mapper.counts.used == 60
    assert estimate.status == 'closed'
    assert not estimate.cautions
    assert compare(estimate.polygon.vertices, read_truth(BAGS / scene)).right
    assert estimate.storey.height_m.tolist() == pytest.approx([0.3, 2.2] if scene == 'room' else [], abs=1e-3)


def test_the_recordings_are_small_and_of_both_storages():
    sizes = {scene: sum(path.stat().st_size for path in (BAGS / scene).iterdir()) for scene in SCENES}
    assert max(sizes.values()) <= 1_000_000
    suffixes = {path.suffix for scene in SCENES for path in (BAGS / scene).iterdir()}
    assert {'.mcap', '.db3'} <= suffixes
