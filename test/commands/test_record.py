"""result.mcap of `polymap_replay --record`: what a node would have published, when it would have."""

import importlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from polymap_ros.geometry.pose import Pose
from polymap_ros.recordings import outcome
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.writing import RecordingWriter, typestore

ROS_PAGE = (Path(__file__).parents[2] / 'doc' / 'ros.md').read_text(encoding='utf-8')
POLYGON, MARKERS, BEAM_MAP, MAP, PATH, POSE = (
    f'/polymap_node/{name}' for name in ('polygon', 'markers', 'beam_map', 'map', 'path', 'pose'))
SECOND_NS = 10**9
DELETE_ALL = 3
FAST = ('-p', 'solver.method:=paper', '-p', 'solver.iterations:=60')


class Record:
    """All messages of a result.mcap by topic, each with its log time after a recording's start [ns]."""

    def __init__(self, path, recording):
        with Recording.open(recording) as source:
            start_ns = source.start_ns
        with path.open('rb') as stream:
            order = [message.log_time for _, _, message in make_reader(stream).iter_messages(log_time_order=False)]
        assert order == sorted(order)
        with AnyReader([path]) as reader:
            self.types = {each.topic: each.msgtype for each in reader.connections}
            self.messages = {topic: [] for topic in self.types}
            for each, log_ns, raw in reader.messages():
                self.messages[each.topic].append((log_ns - start_ns, reader.deserialize(raw, each.msgtype)))

    def times_s(self, topic):
        return [ns / SECOND_NS for ns, _ in self.messages[topic]]

    def diagnostics(self):
        """Level, message and values of each second."""
        found = [message.status[0] for _, message in self.messages['/diagnostics']]
        return [(each.level, each.message, {pair.key: pair.value for pair in each.values}) for each in found]

    def last_corners(self):
        return [(point.x, point.y) for point in self.messages[POLYGON][-1][1].polygon.points]


def replay(recording, folder, *arguments, status=0):
    main = importlib.import_module('polymap_ros.commands.replay').main
    assert main([str(recording), '--output', str(folder), *arguments]) == status
    return folder


def recorded(recording, folder, *arguments, status=0):
    """What is recorded, and polygon.json."""
    replay(recording, folder, '--record', *arguments, status=status)
    return Record(folder / 'result.mcap', recording), json.loads((folder / 'polygon.json').read_text())


def assert_ends_with_the_answer(record, answer):
    assert record.last_corners() == [tuple(corner) for corner in np.float32(answer['vertices']).tolist()]
    _, _, values = record.diagnostics()[-1]
    assert values['status'] == answer['status']
    assert values['pings used'] == str(answer['pings']['used'])


@pytest.fixture(scope='module')
def folder(triangle, tmp_path_factory):
    return replay(triangle, tmp_path_factory.mktemp('record') / 'out', '--record')


@pytest.fixture(scope='module')
def record(folder, triangle):
    return Record(folder / 'result.mcap', triangle)


@pytest.fixture
def answer(folder):
    return json.loads((folder / 'polygon.json').read_text())


def test_it_holds_the_topics_of_the_node_and_the_odometry(record):
    outputs = ROS_PAGE.split('\n## Outputs')[1].split('\n## ')[0]
    rows = re.findall(r'^\| `(\S+)` \| `(\S+/msg/\S+)` \|', outputs, re.MULTILINE)
    assert record.types == {'/odom': 'nav_msgs/msg/Odometry', **{
        name.replace('~', '/polymap_node'): kind for name, kind in rows}}


def test_a_pose_comes_with_every_ping_and_every_solve(record, answer):
    poses = record.messages[POSE]
    assert record.times_s(POSE) == sorted(record.times_s(POSE))
    stamps = {seconds(message.header.stamp) for _, message in poses}
    assert len(stamps) == answer['pings']['used'] <= len(poses)
    odometry = {seconds(each.header.stamp): each.pose.pose.position for _, each in record.messages['/odom']}
    for _, message in poses:
        if (place := odometry.get(seconds(message.header.stamp))) is not None:
            np.testing.assert_allclose((message.pose.pose.position.x, message.pose.pose.position.y), (place.x, place.y),
                                       atol=1e-9)


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


def test_with_a_map_frame_tf_leads_from_the_odometry_to_the_pose(triangle, tmp_path):
    record, _ = recorded(triangle, tmp_path / 'out', *FAST, '-p', 'slam.map_frame:=map', '-p',
                         'slam.map_origin:=first_ping', '-p', 'slam.tf_period_s:=0.5', '-p', 'slam.tf_tolerance_s:=0.2')
    assert record.types['/tf'] == 'tf2_msgs/msg/TFMessage'
    poses, transforms = record.messages[POSE], record.messages['/tf']
    assert len(transforms) > len(poses) > 20
    assert {message.header.frame_id for _, message in poses} == {'map'}
    odometry = {seconds(each.header.stamp): each.pose.pose for _, each in record.messages['/odom']}
    newest = [(message, odometry.get(seconds(message.header.stamp))) for _, message in poses]
    message, reported = next(pair for pair in reversed(newest) if pair[1] is not None)
    [each] = transforms[-1][1].transforms
    assert (each.header.frame_id, each.child_frame_id) == ('map', 'odom')
    off, turn = each.transform.translation, 2.0 * np.arctan2(each.transform.rotation.z, each.transform.rotation.w)
    there = Pose(off.x, off.y, turn).apply(np.array((reported.position.x, reported.position.y)))
    np.testing.assert_allclose(there, (message.pose.pose.position.x, message.pose.pose.position.y), atol=1e-9)


def test_the_map_grows_until_it_is_the_answer(record, answer):
    times_s = record.times_s(POLYGON)
    assert 2.0 < times_s[0] < 20.0, 'the first pings close nothing'
    assert times_s[-12:] == list(np.arange(20.0, 32.0)), 'new pings come in every second'
    assert record.times_s(MAP) == times_s
    assert set(times_s) < set(record.times_s(MARKERS)) <= set(record.times_s(BEAM_MAP))
    assert record.times_s(BEAM_MAP) == list(np.arange(1.0, 32.0))
    drawings = [{each.ns: each for each in message.markers} for _, message in record.messages[MARKERS]]
    assert ['outline' in each for each in drawings] == [time_s >= times_s[0] for time_s in record.times_s(MARKERS)]
    paths = [len(each['path'].points) for each in drawings if 'path' in each]
    assert paths == sorted(paths)
    assert paths[-1] == answer['pings']['used'] > 10 * paths[0]
    assert_ends_with_the_answer(record, answer)


def test_every_drawing_takes_the_one_before_away(record):
    assert {message.markers[0].action for _, message in record.messages[MARKERS]} == {DELETE_ALL}


def test_diagnostics_come_every_second_and_know_no_other_clock(record, answer):
    assert record.times_s('/diagnostics') == list(np.arange(1.0, 32.0))
    begin = record.messages['/odom'][0][1].header.stamp.sec
    stamps = [message.header.stamp for _, message in record.messages['/diagnostics']]
    assert [stamp.sec - begin for stamp in stamps] == record.times_s('/diagnostics')
    looks = record.diagnostics()
    assert looks[0][1].startswith('no polygon: ')
    assert (looks[-1][0], looks[-1][1].split(',')[0]) == (0, 'closed: 3 edges')
    used = [int(values['pings used']) for _, _, values in looks]
    assert used == sorted(used)
    assert [values['odometry rate [Hz]'] for _, _, values in looks[:-1]] == ['8.0'] * 30
    assert not [key for key in looks[-1][2] if 'latency' in key or 'callback' in key or 'time' in key]


def test_the_odometry_is_copied_as_it_was_logged(folder, triangle):
    def odometry(path):
        with AnyReader([path]) as reader:
            return [(log_ns, raw) for each, log_ns, raw in reader.messages() if each.topic == '/odom']

    assert odometry(folder / 'result.mcap') == odometry(triangle)


def test_it_changes_no_byte_of_the_answer_and_is_the_same_every_time(folder, triangle, tmp_path):
    plain, again = replay(triangle, tmp_path / 'plain'), replay(triangle, tmp_path / 'again', '--record')
    assert not (plain / 'result.mcap').exists()
    for name in ('polygon.json', 'state.npz', 'map.pgm', 'map.yaml'):
        assert (folder / name).read_bytes() == (plain / name).read_bytes()
    assert (folder / 'result.mcap').read_bytes() == (again / 'result.mcap').read_bytes()


def test_a_recording_in_parts_and_a_compressed_one_give_the_same_bytes(triangle, tmp_path):
    compressed = Writer(tmp_path / 'compressed', version=9, storage_plugin=StoragePlugin.MCAP)
    compressed.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    (tmp_path / 'parts').mkdir()
    with (Recording.open(triangle) as source, compressed, RecordingWriter(tmp_path / 'parts' / 'run_0.mcap') as first,
          RecordingWriter(tmp_path / 'parts' / 'run_1.mcap') as second):
        connections = {topic: compressed.add_connection(topic, info.type_name, typestore=typestore())
                       for topic, info in source.topics.items()}
        for entry in source.messages():
            is_early = entry.log_ns < source.start_ns + 12 * SECOND_NS
            (first if is_early else second).write(entry.topic, entry.message, entry.log_ns)
            raw = typestore().serialize_cdr(entry.message, entry.type_name)
            compressed.write(connections[entry.topic], entry.log_ns, raw)
    folders = [replay(path, tmp_path / f'{path.name}-out', '--record', *FAST)
               for path in (triangle, tmp_path / 'parts', tmp_path / 'compressed')]
    assert len({(folder / 'result.mcap').read_bytes() for folder in folders}) == 1


def test_an_interval_is_recorded_from_its_start(triangle, tmp_path):
    interval = '--start', '10.5', '--end', '20'
    record, answer = recorded(triangle, tmp_path / 'out', *interval, '-p', 'solver.period_s:=2.5', *FAST)
    assert record.times_s('/diagnostics') == list(np.arange(11.5, 21.0))
    assert record.times_s(MARKERS) == [13.0, 15.5, 18.0, 20.5]
    assert_ends_with_the_answer(record, answer)


def test_a_solve_waits_for_the_work_of_the_one_before(triangle, tmp_path, monkeypatch):
    monkeypatch.setitem(outcome.STEP_NS, 'paper', SECOND_NS // 5)
    record, _ = recorded(triangle, tmp_path / 'out', *FAST)  # with a checkpoint every five iterations
    assert record.times_s(MARKERS) == list(np.arange(1.0, 32.0, 3.0))
    assert record.times_s('/diagnostics') == list(np.arange(1.0, 32.0))


def test_where_nothing_closes_the_record_says_why(triangle, tmp_path):
    record, answer = recorded(triangle, tmp_path / 'out', '--end', '1.2', status=1)
    assert answer['status'] == 'open'
    assert {topic: len(messages) for topic, messages in record.messages.items()} == {
        '/odom': 10, POLYGON: 0, MAP: 0, MARKERS: 2, BEAM_MAP: 2, PATH: 2, POSE: 4, '/diagnostics': 2}
    assert [level for level, _, _ in record.diagnostics()] == [1, 1]
    assert answer['warnings'][0]['text'] in record.diagnostics()[-1][1]


def test_odometry_that_goes_back_is_told_when_it_does_and_the_map_stays_as_the_answer_has_it(altered, tmp_path):
    def change(topic, index, message):
        if index >= (120 if topic == '/odom' else 30):
            message.header.stamp.sec -= 1000
        return [(topic, message)]

    record, answer = recorded(altered(change), tmp_path / 'out', *FAST)
    assert answer['pings']['used'] < 35
    assert_ends_with_the_answer(record, answer)
    sentences = [sentence for _, sentence, _ in record.diagnostics()]
    assert 'odometry is refused: ' in sentences[-2]
    assert not any('refused' in sentence for sentence in sentences[:14])


def test_silence_is_told(altered, tmp_path):
    path = altered(lambda topic, index, message: [(topic, message)] if topic == '/odom' or index < 30 else [])
    record, _ = recorded(path, tmp_path / 'out', *FAST)
    first = next(k for k, look in enumerate(record.diagnostics()) if look[1] == 'no message on /echo for 6 s')
    last_echo_s = 0.5 * 30
    assert record.times_s('/diagnostics')[first] == pytest.approx(last_echo_s + 6.0, abs=1.0)


def test_a_gap_of_years_is_left_empty(triangle, tmp_path):
    """Logged before and after a computer without a battery had learnt what day it is."""
    with Recording.open(triangle) as source, RecordingWriter(tmp_path / 'gap') as writer:
        for entry in source.messages():
            late = entry.log_ns >= source.start_ns + 10 * SECOND_NS
            writer.write(entry.topic, entry.message, entry.log_ns + late * 10**18)
    record, answer = recorded(tmp_path / 'gap', tmp_path / 'out', *FAST)
    assert 31 + 50 < len(record.messages['/diagnostics']) < 31 + 70
    assert_ends_with_the_answer(record, answer)
