"""Recordings are read in log order, and what is wrong with one is said in a line that names the remedy."""

import shutil
import sqlite3

import numpy as np
import pytest
from ruamel.yaml import YAML

from polymap_ros.errors import RecordingError
from polymap_ros.geometry.pose import Pose
from polymap_ros.recordings.reading import Recording, Topic
from polymap_ros.recordings.truth import read_true_inside, read_truth
from polymap_ros.recordings.writing import make

ODOMETRY, SCAN, STRING = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan', 'std_msgs/msg/String'
LAYOUTS = [('run', 'mcap'), ('run', 'sqlite3'), ('run.mcap', 'mcap'), ('run.db3', 'sqlite3')]


def refusal(path, topics=None):
    """What reading the whole recording complains about."""
    with pytest.raises(RecordingError) as caught, Recording.open(path) as recording:
        for _ in recording.messages(topics):
            pass
    assert '\n' not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(('name', 'storage'), LAYOUTS)
def test_every_layout_is_read_in_order_of_log_time(write_recording, name, storage):
    with Recording.open(write_recording(name, storage)) as recording:
        assert recording.topics == {'/echo': Topic(SCAN, 20), '/odom': Topic(ODOMETRY, 41)}
        assert recording.duration_s == pytest.approx(2.0, abs=1e-12)
        entries = list(recording.messages())
        assert recording.cautions(['/odom', '/echo']) == []
    assert len(entries) == 61
    times = [entry.log_ns for entry in entries]
    assert times == sorted(times)
    echoes = [entry.message for entry in entries if entry.topic == '/echo']
    samples = np.random.default_rng(3).normal(size=256).astype(np.float32)
    np.testing.assert_array_equal(echoes[1].intensities, samples)


@pytest.mark.parametrize(('name', 'storage'), LAYOUTS)
def test_a_span_of_time_is_half_open_and_counts_from_the_first_message(write_recording, name, storage):
    with Recording.open(write_recording(name, storage)) as recording:
        stamps = [entry.log_ns - 100 * 10**9 for entry in recording.messages(['/odom'], 0.5, 0.7)]
    assert stamps == [500_000_000, 550_000_000, 600_000_000, 650_000_000]


def test_topics_are_found_with_and_without_slash(write_recording):
    with Recording.open(write_recording()) as recording:
        assert recording.require('odom', ODOMETRY, 'topics.odom') == '/odom'
        assert recording.require('/echo', SCAN, 'topics.echo') == '/echo'
        assert list(recording.messages([])) == []


def test_a_missing_topic_names_those_of_its_type(write_recording):
    path = write_recording(odom_topic='/wheels/odom')
    with Recording.open(path) as recording, pytest.raises(RecordingError) as caught:
        recording.require('odom', ODOMETRY, 'topics.odom')
    assert str(caught.value) == (
        f'{path}: no topic /odom; topics of type {ODOMETRY}: /wheels/odom '
        '(choose with -p topics.odom:=/wheels/odom)')


def test_a_missing_topic_without_candidates_lists_what_there_is(write_recording):
    with Recording.open(write_recording()) as recording, pytest.raises(RecordingError) as caught:
        recording.require('sonar', 'sensor_msgs/msg/PointCloud2', 'topics.echo')
    assert 'no topic /sonar; no other topic is of type sensor_msgs/msg/PointCloud2' in str(caught.value)
    assert f'recorded: /echo ({SCAN}), /odom ({ODOMETRY})' in str(caught.value)


def test_a_topic_of_the_wrong_type_says_which(write_recording):
    path = write_recording(extra=[('/text', make(STRING, data='x'))])
    with Recording.open(path) as recording, pytest.raises(RecordingError) as caught:
        recording.require('text', SCAN, 'topics.echo')
    assert f'topic /text is of type {STRING}, not {SCAN}; topics of type {SCAN}: /echo' in str(caught.value)


def test_an_empty_topic_is_named(write_recording):
    path = write_recording(storage='sqlite3')
    database = next(path.glob('*.db3'))
    with sqlite3.connect(database) as connection:
        connection.execute('DELETE FROM messages WHERE topic_id = (SELECT id FROM topics WHERE name = "/echo")')
    connection.close()
    with Recording.open(database) as recording, pytest.raises(RecordingError, match='topic /echo is empty'):
        recording.require('echo', SCAN, 'topics.echo')


def test_messages_that_metadata_announces_and_the_file_lacks_are_a_caution(write_recording):
    path = write_recording(storage='sqlite3')
    with sqlite3.connect(next(path.glob('*.db3'))) as connection:
        connection.execute('DELETE FROM messages WHERE id IN (SELECT id FROM messages WHERE topic_id = 2 LIMIT 3)')
    connection.close()
    with Recording.open(path) as recording:
        seen = [entry.topic for entry in recording.messages()]
        (caution,) = recording.cautions(['/odom', '/echo'])
    assert seen.count('/echo') == 17
    assert (caution.code, caution.finding) == (
        'recording_incomplete', '/echo: 17 messages found where the recording announces 20')


def test_a_message_that_cannot_be_decoded_is_skipped_and_counted(write_recording):
    path = write_recording(storage='sqlite3')
    with sqlite3.connect(next(path.glob('*.db3'))) as connection:
        connection.execute('UPDATE messages SET data = substr(data, 1, 40) WHERE topic_id = 2 AND id < 10')
    connection.close()
    with Recording.open(path) as recording:
        seen = [entry.topic for entry in recording.messages()]
        assert recording.damaged == {'/echo': 3}
        (caution,) = recording.cautions(['/odom', '/echo'])
    assert seen.count('/echo') == 17
    assert (caution.code, caution.finding) == ('recording_damaged', '/echo: 3 of 20 messages cannot be decoded')


def test_nothing_there(tmp_path):
    assert refusal(tmp_path / 'none') == f'{tmp_path / "none"}: no such recording'


def test_a_folder_without_metadata_and_one_file_is_that_file_with_a_caution(write_recording):
    path = write_recording()
    (path / 'metadata.yaml').unlink()
    with Recording.open(path) as recording:
        assert len(list(recording.messages())) == 61
        (caution,) = recording.cautions(['/odom', '/echo'])
    assert caution.code == 'recording_inconsistent'
    assert caution.finding == 'run holds no metadata.yaml: what is missing cannot be told'


def test_a_folder_of_several_recordings_asks_for_one(write_recording):
    path = write_recording()
    (path / 'metadata.yaml').unlink()
    shutil.copy(path / 'run.mcap', path / 'other.mcap')
    assert refusal(path).endswith('holds no metadata.yaml; name the file itself: other.mcap, run.mcap')


def test_a_folder_that_is_no_recording(tmp_path):
    assert refusal(tmp_path).endswith('holds no metadata.yaml; it is not a rosbag2 directory')


def test_a_part_that_metadata_names_and_is_missing(write_recording):
    path = write_recording()
    (path / 'run.mcap').unlink()
    assert 'missing' in refusal(path)


@pytest.mark.parametrize('text', ['', '[', 'a: 1', '!!python/object/apply:os.getcwd []'])
def test_metadata_that_is_none(write_recording, text):
    path = write_recording()
    (path / 'metadata.yaml').write_text(text)
    with Recording.open(path) as recording:
        assert len(list(recording.messages())) == 61
        (caution,) = recording.cautions(['/odom', '/echo'])
    assert caution.code == 'recording_inconsistent'
    assert 'ros2 bag reindex' in caution.remedy
    assert 'NoneType' not in caution.text
    assert caution.text.startswith('run has a metadata.yaml that cannot be read (')


@pytest.mark.parametrize('name', ['run.mcap', 'run.db3', 'run.txt'])
@pytest.mark.parametrize('content', [b'', b'hello', bytes(4096)])
def test_a_file_that_is_no_recording(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    refusal(tmp_path / name)


def test_metadata_with_a_future_version_is_told_and_the_files_are_read(write_recording):
    path = write_recording()
    metadata = YAML(typ='safe').load((path / 'metadata.yaml').read_text())
    metadata['rosbag2_bagfile_information']['version'] = 99
    with (path / 'metadata.yaml').open('w') as file:
        YAML(typ='safe').dump(metadata, file)
    with Recording.open(path) as recording:
        assert len(list(recording.messages())) == 61
        (caution,) = recording.cautions(['/odom', '/echo'])
    assert (caution.code, caution.text[:28]) == ('recording_inconsistent', 'metadata.yaml has version 99')


def test_truth_is_found_inside_a_directory_and_beside_a_file(write_recording, tmp_path):
    path = write_recording()
    assert read_truth(path) is None
    (path / 'truth.json').write_text('{"vertices": [[0, 0], [1, 0], [0, 2]]}')
    np.testing.assert_array_equal(read_truth(path), [[0, 0], [1, 0], [0, 2]])
    np.testing.assert_array_equal(read_truth(path / 'run.mcap'), [[0, 0], [1, 0], [0, 2]])
    (path / 'truth.json').write_text('{"vertices": [[0, 2], [1, 0], [0, 0]]}')  # clockwise
    np.testing.assert_array_equal(read_truth(path), [[0, 0], [1, 0], [0, 2]])
    bare = shutil.copy(path / 'run.mcap', tmp_path / 'bare.mcap')
    assert read_truth(tmp_path / bare) is None


@pytest.mark.parametrize('text', [
    '', '[]', '{}', '{"vertices": 3}', '{"vertices": [[0, 0], [1, 0]]}', '{"vertices": [[0, 0], [1, 0], [NaN, 1]]}',
    '{"vertices": [["a", 0], [1, 0], [0, 1]]}', '{"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]]}'])
def test_a_truth_that_is_none_is_refused(tmp_path, text):
    (tmp_path / 'truth.json').write_text(text)
    with pytest.raises(RecordingError, match=r'truth\.json: '):
        read_truth(tmp_path)


def test_what_is_truly_inside_may_be_left_out_and_is_moved(tmp_path):
    assert read_true_inside(tmp_path).holes == ()
    (tmp_path / 'truth.json').write_text('{"vertices": [[0, 0], [1, 0], [0, 2]]}')
    assert (read_true_inside(tmp_path).holes, read_true_inside(tmp_path).inner_walls) == ((), ())
    (tmp_path / 'truth.json').write_text('{"holes": [{"vertices": [[0, 0], [1, 0], [0, 2]]}], '
                                         '"inner_walls": [{"start": [0, 1], "end": [1, 1], "reflection": 0.3}]}')
    moved = read_true_inside(tmp_path).moved(Pose(1.0, 2.0, np.pi / 2))
    np.testing.assert_allclose(moved.holes, [[[-1, 2], [1, 3], [1, 2]]], atol=1e-12)  # clockwise
    np.testing.assert_allclose(moved.inner_walls, [[[0, 2], [0, 3]]], atol=1e-12)


@pytest.mark.parametrize('text', [
    '', '[]', '{"holes": 3}', '{"inner_walls": {}}', '{"holes": [3]}', '{"holes": [{"vertices": [[0, 0], [1, 0]]}]}',
    '{"inner_walls": [3]}', '{"inner_walls": [{"start": [0, 1]}]}', '{"inner_walls": [{"start": [0, 1], "end": [0]}]}',
    '{"inner_walls": [{"start": [0, 1], "end": [0, NaN]}]}'])
def test_what_cannot_be_inside_is_refused(tmp_path, text):
    (tmp_path / 'truth.json').write_text(text)
    with pytest.raises(RecordingError, match=r'truth\.json: '):
        read_true_inside(tmp_path)
