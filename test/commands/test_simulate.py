"""polymap_simulate, with its recordings read back by rosbags alone."""

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader

from polymap_ros.commands.simulate import main
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameter_file import load_parameters
from polymap_ros.parameters import PulseParameters
from polymap_ros.pulse_file import read_pulse
from polymap_ros.recordings.truth import read_true_inside
from polymap_ros.recordings.writing import RecordingWriter
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

SCENE = '''
vertices: [[0.0, 0.0], [1.0, 0.0], [1.0, 0.7], [0.0, 0.7]]
trajectory: {start: [0.2, 0.2, 0.0], legs: [[0.0, 0.3], [120.0, 0.2]], step_m: 0.1}
n_samples: 512
t0_s: 2.0e-5
ping_period_s: 0.2
odometry_rate_hz: 18
position_noise_m: 0.01
'''


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / 'room.yaml'
    path.write_text(SCENE)
    return path


def read(path):
    with AnyReader([path]) as reader:
        entries = [(connection.topic, ns, reader.deserialize(raw, connection.msgtype))
                   for connection, ns, raw in reader.messages()]
    return ([(ns, message) for topic, ns, message in entries if topic == '/odom'],
            [(ns, message) for topic, ns, message in entries if topic == '/echo'])


def stamp_ns(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


@pytest.mark.parametrize(('name', 'storage'), [('bag', 'mcap'), ('bag', 'sqlite3'), ('bag.mcap', 'mcap'),
                                               ('bag.db3', 'sqlite3')])
def test_a_recording_holds_the_scene(tmp_path, scene_file, capsys, name, storage):
    path = tmp_path / 'made' / name
    assert main([str(scene_file), '--output', str(path), '--storage', storage]) == 0
    assert str(path) in capsys.readouterr().out
    scene = load_scene(str(scene_file))
    odometry, echoes = read(path)
    assert len(echoes) == len(scene.poses) == 6
    for index, (ns, message) in enumerate(echoes):
        assert stamp_ns(message) == scene.stamps_ns[index] == 1_200_020_000 + 200_000_000 * index
        assert ns == stamp_ns(message) + 512_000
        assert message.header.frame_id == 'sensor'
        assert message.time_increment == pytest.approx(1e-6)
        assert message.scan_time == pytest.approx(0.2)
        assert len(message.ranges) == 0
    samples = np.array([message.intensities for _, message in echoes])
    np.testing.assert_array_equal(samples, simulate(scene).astype(np.float32))

    stamps = np.array([stamp_ns(message) for _, message in odometry])
    np.testing.assert_array_equal(stamps, [ns for ns, _ in odometry])
    assert np.all(np.diff(stamps) == 50_000_000)
    assert stamps[0] == 1_000_000_000
    assert stamps[-1] == 1_000_000_000 + 200_000_000 * 7
    reported = scene.reported_poses()
    assert np.abs(reported - scene.poses).max() > 0.005
    for index, pose in enumerate(reported):
        message = odometry[4 * (index + 1)][1]
        assert stamp_ns(message) == scene.stamps_ns[index] - 20_000
        position, rotation = message.pose.pose.position, message.pose.pose.orientation
        np.testing.assert_allclose([position.x, position.y], pose[:2], atol=1e-12)
        assert 2.0 * np.arctan2(rotation.z, rotation.w) == pytest.approx(pose[2])
    truth = json.loads(((path if path.is_dir() else path.parent) / 'truth.json').read_text())
    np.testing.assert_array_equal(truth['vertices'], scene.vertices)
    lines = ((path if path.is_dir() else path.parent) / 'truth.tum').read_text().splitlines()
    assert [int(line.split()[0].replace('.', '')) for line in lines] == (scene.stamps_ns - 20_000).tolist()
    rows = np.array([line.split()[1:] for line in lines], float)
    np.testing.assert_array_equal(rows[:, :2], scene.poses[:, :2])
    np.testing.assert_allclose(2.0 * np.arctan2(rows[:, 5], rows[:, 6]), scene.poses[:, 2], atol=1e-12)
    np.testing.assert_array_equal(rows[:, 2:5], 0.0)


def test_the_truth_has_holes_and_inner_walls_where_there_are_any(tmp_path, scene_file):
    assert main([str(scene_file), '--output', str(tmp_path / 'plain')]) == 0
    assert list(json.loads((tmp_path / 'plain' / 'truth.json').read_text())) == ['vertices']
    scene_file.write_text(SCENE + '''
holes: [[[0.6, 0.4], [0.7, 0.4], [0.7, 0.5]]]
inner_walls: [{start: [0.8, 0.1], end: [0.8, 0.6], reflection: 0.6}]
''')
    assert main([str(scene_file), '--output', str(tmp_path / 'plate')]) == 0
    truth = json.loads((tmp_path / 'plate' / 'truth.json').read_text())
    assert truth['holes'] == [{'vertices': [[0.7, 0.5], [0.7, 0.4], [0.6, 0.4]]}]
    assert truth['inner_walls'] == [{'start': [0.8, 0.1], 'end': [0.8, 0.6], 'reflection': 0.6, 'transmission': 0.8}]
    known = read_true_inside(tmp_path / 'plate')
    np.testing.assert_array_equal(known.holes, [[[0.7, 0.5], [0.7, 0.4], [0.6, 0.4]]])
    np.testing.assert_array_equal(known.inner_walls, [[[0.8, 0.1], [0.8, 0.6]]])


def test_a_round_hole_is_in_the_truth_by_centre_and_radius(tmp_path, scene_file):
    scene_file.write_text(SCENE + '\nholes: [{centre: [0.65, 0.45], radius_m: 0.04}]\n')
    assert main([str(scene_file), '--output', str(tmp_path / 'plate')]) == 0
    known = read_true_inside(tmp_path / 'plate')
    np.testing.assert_array_equal(known.circles, [[0.65, 0.45, 0.04]])
    assert known.holes == ()
    np.testing.assert_allclose(known.moved(Pose(0.1, 0.2, 0.3)).circles[0][:2],
                               Pose(0.1, 0.2, 0.3).apply(np.array((0.65, 0.45))))


def test_making_it_again_gives_the_same_stamps_and_samples(tmp_path, scene_file):
    for name in ('a', 'b'):
        assert main([str(scene_file), '--output', str(tmp_path / name)]) == 0
    for first, second in zip(read(tmp_path / 'a'), read(tmp_path / 'b'), strict=True):
        assert [ns for ns, _ in first] == [ns for ns, _ in second]
        assert [stamp_ns(message) for _, message in first] == [stamp_ns(message) for _, message in second]
    for (_, first), (_, second) in zip(read(tmp_path / 'a')[1], read(tmp_path / 'b')[1], strict=True):
        np.testing.assert_array_equal(first.intensities, second.intensities)


def test_parameters_are_written_where_the_defaults_would_not_do(tmp_path, scene_file):
    assert main([str(scene_file), '--output', str(tmp_path / 'bag')]) == 0
    body = yaml.safe_load((tmp_path / 'bag' / 'params.yaml').read_text())
    assert body == {'polymap_node': {'ros__parameters': {'echo.t0_s': 2e-5}}}
    scene_file.write_text(SCENE.replace('t0_s: 2.0e-5', ''))
    assert main([str(scene_file), '--output', str(tmp_path / 'plain')]) == 0
    assert not (tmp_path / 'plain' / 'params.yaml').exists()


def test_a_recorded_pulse_is_emitted_and_goes_with_the_recording(tmp_path, scene_file):
    pulse = np.hanning(30) * np.sin(np.arange(30))
    np.save(tmp_path / 'ping.npy', pulse)
    scene_file.write_text(SCENE.replace('t0_s: 2.0e-5', 'pulse: {kind: file, path: ping.npy}\nsnr_db: null'))
    assert main([str(scene_file), '--output', str(tmp_path / 'bag')]) == 0
    parameters = load_parameters(tmp_path / 'bag' / 'params.yaml')
    np.testing.assert_array_equal(read_pulse(parameters).recorded, pulse)
    scene = load_scene(str(scene_file))
    plain = dataclasses.replace(scene, pulse=PulseParameters(), recorded_pulse=None)
    first = np.array([message.intensities for _, message in read(tmp_path / 'bag')[1]])
    assert np.abs(first).max() > 0.0
    assert np.abs(np.corrcoef(first[0], simulate(plain)[0])[0, 1]) < 0.6


def test_a_recorded_odometry_is_followed(tmp_path, scene_file):
    assert main([str(scene_file), '--output', str(tmp_path / 'drive')]) == 0
    follower = tmp_path / 'follower.yaml'
    follower.write_text('''
vertices: [[0, 0], [2, 0], [2, 2], [0, 2]]
trajectory: {recording: drive, topic: odom, pings: 25, clearance_m: 0.1}
n_samples: 256
''')
    assert main([str(follower), '--output', str(tmp_path / 'followed')]) == 0
    assert len(read(tmp_path / 'followed')[1]) == 25


@pytest.mark.parametrize(('arguments', 'words'), [
    (['nowhere', '--output', 'bag'], ['nowhere', 'triangle']),
    (['{scene}', '--output', '{tmp}/there'], ['there', 'exists']),
    (['{scene}', '--output', '{tmp}/there/bag.mcap'], ['truth.json', 'another recording']),
    (['{broken}', '--output', '{tmp}/bag'], ['broken.yaml', 'vertices']),
    (['{scene}', '--output', 'room.yaml/bag'], ['room.yaml/bag: cannot be written: room.yaml is a file']),
    (['{scene}', '--output', 'astray'], ['astray: exists already']),
    (['{scene}', '--output', 'astray/bag.db3'], ['astray/bag.db3: cannot be written: astray is a link to']),
    (['{scene}', '--output', '/proc/bag.mcap'], ['/proc/bag.mcap: cannot be written: ']),
    (['{scene}', '--output', 'a' * 300], ['aaa: File name too long']),
    (['{follower}', '--output', '{tmp}/bag'], ['missing', 'no such recording']),
])
def test_wrong_use_is_one_line_and_status_2(tmp_path, scene_file, capsys, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'there').mkdir()
    (tmp_path / 'astray').symlink_to('nowhere')
    (tmp_path / 'there' / 'truth.json').write_text('{}')
    (tmp_path / 'broken.yaml').write_text('vertices: [[0, 0], [1, 0]]\nposes: [[0, 0, 0]]')
    (tmp_path / 'follower.yaml').write_text('vertices: [[0, 0], [2, 0], [2, 2], [0, 2]]\n'
                                            'trajectory: {recording: missing, pings: 5, clearance_m: 0.1}')
    places = {'scene': scene_file, 'tmp': tmp_path, 'broken': tmp_path / 'broken.yaml',
              'follower': tmp_path / 'follower.yaml'}
    before = sorted(tmp_path.rglob('*'))
    assert main([argument.format(**places) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ''
    assert err.count('\n') == 1
    assert all(word in err for word in words)
    assert sorted(tmp_path.rglob('*')) == before


@pytest.mark.parametrize('name', ['truth.json', 'truth.tum', 'params.yaml', 'pulse.npy', 'bag.mcap'])
@pytest.mark.parametrize('folder', [False, True])
def test_a_bare_recording_takes_the_place_of_nothing_that_is_there(tmp_path, scene_file, capsys, name, folder):
    """Not even of what its scene reads; and nothing of it is written."""
    np.save(tmp_path / 'ping.npy', np.hanning(30) * np.sin(np.arange(30)))
    scene_file.write_text(f'{SCENE}\npulse: {{kind: file, path: ping.npy}}')
    place = tmp_path / 'mine' / name
    place.parent.mkdir()
    if folder:
        place.mkdir()
    else:
        place.write_text('mine')
    assert main([str(scene_file), '--output', str(tmp_path / 'mine' / 'bag.mcap')]) == 2
    assert capsys.readouterr().err.count(f'{name}: ') == 1
    assert list(place.parent.iterdir()) == [place]
    assert folder or place.read_text() == 'mine'


def test_what_goes_with_a_recording_is_removed_where_that_cannot_be_placed(tmp_path):
    with pytest.raises(FileNotFoundError), RecordingWriter(tmp_path / 'bag.mcap', companions={'a': b'1'}) as writer:
        (writer._folder / 'recording.mcap').unlink()
    assert list(tmp_path.iterdir()) == []


def test_the_module_is_light_to_import():
    code = ('import sys, polymap_ros.commands.simulate as s; s._parser(); '
            'print(sorted({"numpy", "numba", "rosbags", "scipy", "tqdm"} & set(sys.modules)))')
    assert subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True).stdout == '[]\n'
