"""A sound recording is read whatever its files are called, whatever metadata.yaml claims, and however it is packed."""

import gzip
import json
import os
import shlex
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from damage import raw_messages, split, write_mcap
from mcap.writer import Writer
from ruamel.yaml import YAML

from polymap_ros.errors import RecordingError
from polymap_ros.recordings import layout
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.storage import full_type_name
from polymap_ros.recordings.writing import make, typestore

ODOMETRY, SCAN = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan'
TOPICS = ['/odom', '/echo']
ZSTD = zstandard.ZstdCompressor().compress
SKIPPABLE = b'\x52\x2a\x4d\x18' + (7).to_bytes(4, 'little') + b'ignored'
PACKERS = {'zstd': ZSTD, 'zst': ZSTD, 'lz4': lz4.frame.compress, 'gz': gzip.compress}


def read(path):
    """Number of messages, and the cautions in one text, of a complete pass."""
    with Recording.open(path) as recording:
        found = [entry.log_ns for entry in recording.messages(TOPICS)]
        assert found == sorted(found)
        cautions = recording.cautions([topic for topic in TOPICS if topic in recording.topics])
    told = '; '.join(f'{caution.code}: {caution.finding}' for caution in cautions)
    assert 'polymap-' not in told  # no temporary path
    return len(found), told


def refusal(path):
    with pytest.raises(RecordingError) as caught:
        read(path)
    text = str(caught.value)
    assert '\n' not in text
    assert 'polymap-' not in text
    return text


def rewrite(folder, **changes):
    """Change entries of a folder's metadata.yaml."""
    metadata = YAML(typ='safe').load((folder / 'metadata.yaml').read_text())
    metadata['rosbag2_bagfile_information'].update(changes)
    with (folder / 'metadata.yaml').open('w') as file:
        YAML(typ='safe').dump(metadata, file)


def pack(file, kind='zstd'):
    """Compress a file in its place."""
    target = file.with_name(f'{file.name}.{kind}')
    target.write_bytes(PACKERS[kind](file.read_bytes()))
    file.unlink()
    return target


def loud(messages):
    """Twenty times the messages, with samples that cannot be compressed."""
    rng = np.random.default_rng(1)
    return [(topic, kind, ns, raw[:-1024] + rng.bytes(1024) if topic == '/echo' else raw)
            for topic, kind, ns, raw in sorted(20 * messages, key=lambda each: each[2])]


@pytest.fixture
def bare(write_recording):
    return write_recording('run.mcap')


# Names

@pytest.mark.parametrize('storage', ['mcap', 'db3'])
@pytest.mark.parametrize('name', ['drive', 'drive.bin', 'drive.mcap', 'drive.db3', 'Fahrt über Süd 7.data'])
def test_a_bare_file_under_any_name(write_recording, tmp_path, storage, name):
    path = write_recording(f'run.{storage}').rename(tmp_path / name)
    assert read(path) == (61, '')
    link = tmp_path / 'link'
    link.symlink_to(name)
    assert read(link) == (61, '')


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_data_file_that_its_owner_renamed(write_recording, storage):
    folder = write_recording(storage=storage)
    (file,) = (each for each in folder.iterdir() if each.name != 'metadata.yaml')
    file.rename(folder / 'monday')
    assert read(folder) == (61, f'recording_inconsistent: metadata.yaml names {file.name}, which is not there; read '
                                'instead: monday')
    assert read(folder / 'metadata.yaml')[0] == 61


def test_parts_that_were_renamed_and_change_their_order(write_recording, tmp_path):
    folder = split(write_recording(), tmp_path / 'parts')
    for k, name in enumerate(['c.mcap', 'b.mcap', 'a.mcap']):
        (folder / f'parts_{k}.mcap').rename(folder / name)
    number, told = read(folder)
    assert number == 61
    assert told.startswith('recording_inconsistent: metadata.yaml names parts_0.mcap, parts_1.mcap, parts_2.mcap')


def test_a_part_of_which_the_place_is_taken_by_a_file_of_another_time(write_recording, tmp_path):
    source = write_recording()
    folder = split(source, tmp_path / 'parts')
    later = [(topic, kind, ns + 10**15, raw) for topic, kind, ns, raw in raw_messages(source)]
    write_mcap(folder / 'parts_1.mcap', later).rename(folder / 'other.mcap')
    number, told = read(folder)
    assert number == 41
    assert 'left out: other.mcap, recorded at another time than metadata.yaml announces' in told
    assert 'messages found where the recording announces' in told


def test_files_beside_those_of_a_whole_recording_are_left_out_and_named(write_recording):
    folder = write_recording()
    shutil.copy(folder / 'run.mcap', folder / 'copy.mcap')
    shutil.copy(folder / 'run.mcap', folder / 'result.mcap')  # of an earlier replay
    (folder / '._run.mcap').write_bytes(b'Mac OS X')
    assert read(folder) == (61, 'recording_inconsistent: left out: copy.mcap, which metadata.yaml does not name')


# What metadata.yaml claims

@pytest.mark.parametrize('changes', [
    {'relative_file_paths': ['/home/anna/bags/run/run.mcap']}, {'relative_file_paths': ['C:\\bags\\run.mcap']},
    {'relative_file_paths': ['run.mcap', 'run.mcap']}, {'storage_identifier': 'sqlite3'},
    {'compression_format': 'zstd', 'compression_mode': 'FILE'},
    {'compression_format': 'lzma', 'compression_mode': 'MESSAGE'}, {'version': 1}, {'files': []}])
def test_claims_that_the_file_does_not_bear_out(write_recording, changes):
    folder = write_recording()
    rewrite(folder, **changes)
    assert read(folder) == (61, '')


def test_metadata_of_another_recording(write_recording):
    folder = write_recording()
    rewrite(folder, starting_time={'nanoseconds_since_epoch': 10**18}, topics_with_message_count=[])
    number, told = read(folder)
    assert number == 61
    assert told.startswith('recording_inconsistent: metadata.yaml is of another recording')


def test_a_topic_that_only_metadata_knows(write_recording):
    folder = write_recording()
    text = (folder / 'metadata.yaml').read_text()
    (folder / 'metadata.yaml').write_text(text.replace('/odom', '/wheels'))
    with Recording.open(folder) as recording, pytest.raises(RecordingError) as caught:
        recording.require('wheels', ODOMETRY, 'topics.odom')
    assert 'topic /wheels is announced by metadata.yaml, but none of the files that are there holds it' in str(
        caught.value)


def test_a_hash_that_is_not_that_of_a_sound_definition(write_recording):
    folder = write_recording()
    text = (folder / 'metadata.yaml').read_text()
    assert 'RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0' in text
    (folder / 'metadata.yaml').write_text(text.replace('RIHS01_3cc97d', 'RIHS01_000000'))
    number, told = read(folder)
    assert number == 61
    assert told == f'recording_inconsistent: metadata.yaml has another hash of {ODOMETRY} than its definition has'
    with Recording.open(folder) as recording:
        assert recording.require('odom', ODOMETRY, 'topics.odom') == '/odom'


def test_metadata_that_names_no_file(write_recording):
    folder = write_recording()
    rewrite(folder, relative_file_paths=[])
    assert read(folder) == (61, 'recording_inconsistent: metadata.yaml names no file; read instead: run.mcap')


@pytest.mark.parametrize('name', ['data/run.mcap', './data/run.mcap', 'data\\run.mcap', 'data/run.mcap.zstd'])
def test_a_file_in_a_folder_below_that_metadata_names(write_recording, name):
    folder = write_recording()
    (folder / 'data').mkdir()
    (folder / 'run.mcap').rename(folder / 'data' / 'run.mcap')
    rewrite(folder, relative_file_paths=[name])
    number, told = read(folder)
    assert (number, 'in the place of' in told) == (61, name.endswith('.zstd'))


def test_a_folder_below_that_is_a_link_out_of_the_recording_is_not_read(write_recording, tmp_path):
    folder = write_recording()
    (tmp_path / 'secret').mkdir()
    (folder / 'run.mcap').rename(tmp_path / 'secret' / 'run.mcap')
    (folder / 'data').symlink_to(tmp_path / 'secret')
    rewrite(folder, relative_file_paths=['data/run.mcap'])
    assert 'all files that metadata.yaml names are missing: run.mcap' in refusal(folder)


@pytest.mark.parametrize('metadata', [True, False])
def test_two_copies_of_one_recording_are_read_once(write_recording, metadata):
    folder = write_recording()
    shutil.copy(folder / 'run.mcap', folder / 'a_1.mcap')
    (folder / 'run.mcap').rename(folder / 'a_0.mcap')
    if not metadata:
        (folder / 'metadata.yaml').unlink()
    number, told = read(folder)
    assert number == 61
    assert 'left out: a_1.mcap, a copy of a_0.mcap' in told
    assert 'incomplete' not in told
    write_mcap(folder / 'a_0.mcap', raw_messages(folder / 'a_1.mcap')[:30])  # the other one was cut off
    number, told = read(folder)
    assert number == 61
    assert 'left out: a_0.mcap, a copy of a_1.mcap' in told


def test_a_copy_that_rsync_has_not_finished_is_named(write_recording):
    folder = write_recording()
    (folder / 'run.mcap').rename(folder / '.run.mcap.Xy12')
    assert '.run.mcap.Xy12 is hidden, as rsync leaves what it has not copied to the end' in refusal(folder)
    assert read(folder / '.run.mcap.Xy12') == (61, '')


def test_metadata_alone(write_recording):
    folder = write_recording()
    (folder / 'run.mcap').unlink()
    assert 'all files that metadata.yaml names are missing: run.mcap' in refusal(folder)


# Compression of files

@pytest.mark.parametrize('kind', PACKERS)
@pytest.mark.parametrize('storage', ['mcap', 'db3'])
def test_a_bare_file_that_is_compressed(write_recording, tmp_path, kind, storage):
    path = pack(write_recording(f'run.{storage}'), kind)
    assert read(path) == (61, '')
    assert read(path.rename(tmp_path / 'run.mcap')) == (61, '')


def test_several_frames_and_skippable_ones(bare):
    content = bare.read_bytes()
    pieces = [content[:100], content[100:7000], content[7000:]]
    bare.write_bytes(SKIPPABLE + SKIPPABLE.join(map(ZSTD, pieces)) + SKIPPABLE)
    assert read(bare) == (61, '')
    bare.write_bytes(ZSTD(lz4.frame.compress(content)))
    assert read(bare) == (61, '')


@pytest.mark.parametrize('kind', PACKERS)
def test_a_compressed_file_that_was_cut_off(write_recording, tmp_path, kind):
    path = pack(write_mcap(tmp_path / 'long.mcap', loud(raw_messages(write_recording())), 2**14), kind)
    whole = path.read_bytes()
    path.write_bytes(whole[:len(whole) * 2 // 3])
    number, told = read(path)
    assert 61 < number < 1220
    assert f'{path.name}: its compressed data ({"zstd" if kind == "zst" else "gzip" if kind == "gz" else kind})' in told
    assert 'have no end: it was cut off; the first' in told
    path.write_bytes(whole[:20])
    assert refusal(path).startswith(f'{path}: cannot be ')


def test_compressed_data_that_are_damaged(write_recording, tmp_path):
    path = pack(write_mcap(tmp_path / 'long.mcap', 5 * raw_messages(write_recording()), 2**14))
    path.write_bytes(path.read_bytes() + b'rubbish beyond the end')
    number, told = read(path)
    assert number == 305
    assert 'long.mcap.zstd: its compressed data (zstd) are damaged' in told


def test_what_a_kill_leaves_of_a_recording_compressed_by_file(write_recording, tmp_path):
    folder = split(write_recording(), tmp_path / 'parts')
    (folder / 'metadata.yaml').unlink()
    whole = (folder / 'parts_2.mcap').read_bytes()
    pack(folder / 'parts_0.mcap')
    pack(folder / 'parts_1.mcap')
    (folder / 'parts_2.mcap.zstd').write_bytes(ZSTD(whole)[:3000])  # the recorder was at it
    assert read(folder) == (61, 'recording_inconsistent: parts holds no metadata.yaml: what is missing cannot be told')
    for name in ('parts_1.mcap.zstd', 'parts_2.mcap.zstd', 'parts_2.mcap'):
        (folder / name).unlink()
    assert read(folder)[0] == 20


def test_a_file_unpacked_beside_the_compressed_one_is_read_once(write_recording):
    folder = write_recording()
    whole = (folder / 'run.mcap').read_bytes()
    pack(folder / 'run.mcap')
    rewrite(folder, relative_file_paths=['run.mcap.zstd'], compression_format='zstd', compression_mode='FILE')
    assert read(folder) == (61, '')
    (folder / 'run.mcap').write_bytes(whole[:2000])  # by a player that was killed
    assert read(folder) == (61, '')
    (folder / 'run.mcap.zstd').unlink()
    (folder / 'run.mcap').write_bytes(whole)
    assert read(folder) == (
        61, 'recording_inconsistent: read is run.mcap in the place of run.mcap.zstd, which metadata.yaml names')


def test_frames_that_look_back_further_than_usual(bare, tmp_path):
    """As ``zstd --ultra --long=31`` makes them."""
    window = zstandard.ZstdCompressionParameters(window_log=31)
    packed = zstandard.ZstdCompressor(compression_params=window).compressobj()  # of a size that is not announced
    path = tmp_path / 'run.mcap.zst'
    path.write_bytes(packed.compress(bare.read_bytes()) + packed.flush())
    assert zstandard.get_frame_parameters(path.read_bytes()).window_size == 2**31
    assert read(path) == (61, '')


def test_messages_of_ros_1_in_an_mcap_file_are_told_with_a_way_on(write_recording, tmp_path):
    path = tmp_path / 'old.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros1')
        for topic, kind, ns, raw in raw_messages(write_recording()):
            schema = writer.register_schema(kind.replace('/msg/', '/'), 'ros1msg', b'')
            writer.add_message(writer.register_channel(topic, 'ros1', schema), ns, raw, ns)
        writer.finish()
    with Recording.open(path) as recording, pytest.raises(RecordingError) as caught:
        recording.require('odom', ODOMETRY, 'topics.odom')
    assert str(caught.value).count('rosbags-convert --src NAME.bag --dst NAME') == 1


# Logs of databases

def test_a_database_whose_log_is_left_on_a_medium_that_cannot_be_written(write_recording, tmp_path, monkeypatch):
    source, folder = write_recording('run.db3'), tmp_path / 'card'
    folder.mkdir()
    with closing(sqlite3.connect(source)) as writer:
        writer.execute('PRAGMA journal_mode = WAL')
        writer.execute('PRAGMA wal_autocheckpoint = 0')
        writer.execute('INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, timestamp + 1, data '
                       'FROM messages ORDER BY id LIMIT 10')
        writer.commit()
        for name in ('run.db3', 'run.db3-wal'):
            shutil.copy(tmp_path / name, folder)
    monkeypatch.setattr('os.access', lambda path, mode: Path(path) != folder)
    assert read(folder / 'run.db3') == (71, '')
    assert {path.name for path in folder.iterdir()} == {'run.db3', 'run.db3-wal'}  # nothing was written beside them
    monkeypatch.setenv('TMPDIR', str(tmp_path))
    monkeypatch.setattr('shutil.disk_usage', lambda path: shutil._ntuple_diskusage(0, 0, 1000))
    assert 'its last messages are in run.db3-wal' in refusal(folder / 'run.db3')


# Compression of messages

@pytest.mark.parametrize(('change', 'told'), [
    (gzip.compress, 'they are compressed one by one with gzip; allowed: zstd, lz4'),
    (lambda raw: b'\0\7' + raw[2:],
     'they are CDR of version 2 (XCDR2), by their first bytes 00 07; allowed: plain CDR, 00 00 or 00 01')])
def test_messages_of_another_form_are_not_called_damaged_ones_to_copy_again(write_recording, change, told):
    path = write_recording('run.mcap')
    write_mcap(path, [(topic, kind, ns, change(raw)) for topic, kind, ns, raw in raw_messages(path)])
    with Recording.open(path) as recording:
        assert list(recording.messages(TOPICS)) == []
        for caution in recording.cautions(TOPICS):
            assert caution.text.endswith(f'messages cannot be decoded: {told}; record them as ROS 2 does by default')



@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('metadata', [True, False])
def test_messages_compressed_one_by_one(write_recording, storage, metadata):
    folder = write_recording(storage=storage)
    if storage == 'mcap':
        some = [(topic, kind, ns, ZSTD(raw) if k % 3 else raw)
                for k, (topic, kind, ns, raw) in enumerate(raw_messages(folder))]
        write_mcap(folder / 'run.mcap', some)
    else:
        with closing(sqlite3.connect(folder / 'run.db3')) as database, database:
            database.create_function('packed', 1, ZSTD)
            database.execute('UPDATE messages SET data = packed(data) WHERE id % 3 > 0')
    rewrite(folder, compression_format='zstd', compression_mode='MESSAGE')
    if not metadata:
        (folder / 'metadata.yaml').unlink()
    number, told = read(folder)
    assert number == 61
    assert 'decoded' not in told
    assert read(next(folder.glob('run.*')))[0] == 61


def test_messages_in_an_unknown_compression_say_so(write_recording):
    folder = write_recording()
    write_mcap(folder / 'run.mcap', [(topic, kind, ns, b'LZMA' + raw) for topic, kind, ns, raw in raw_messages(folder)])
    rewrite(folder, compression_format='lzma', compression_mode='MESSAGE')
    _, told = read(folder)
    assert "/odom: 41 of 41 messages cannot be decoded: the first begins with the bytes 4c 5a" in told
    assert "metadata.yaml says that they are compressed by 'lzma'; allowed: zstd, lz4" in told


# Channels

def write_channels(path, channels):
    """An .mcap of (topic, message encoding, schema name, schema encoding, definition, messages)."""
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('', 'test')
        for topic, encoding, name, schema_encoding, definition, messages in channels:
            schema = writer.register_schema(name, schema_encoding, definition.encode()) if name else 0
            channel = writer.register_channel(topic, encoding, schema)
            for log_ns, data in messages:
                writer.add_message(channel, log_ns, data, log_ns)
        writer.finish()
    return path


def definition_of(type_name, version=2):
    return typestore().generate_msgdef(type_name, ros_version=version)[0]


@pytest.mark.parametrize('encoding', ['json', 'protobuf', 'ros1'])
def test_channels_of_another_encoding_are_named_with_the_reason(bare, tmp_path, encoding):
    echoes = [(ns, raw) for topic, _, ns, raw in raw_messages(bare) if topic == '/echo']
    said = [(ns, json.dumps({'pose': 1}).encode()) for ns, _ in echoes]
    path = write_channels(tmp_path / 'foxglove.mcap', [
        ('/odom', encoding, 'nav_msgs/Odometry', '', '', said),
        ('/echo', 'cdr', SCAN, 'ros2msg', definition_of(SCAN), echoes)])
    with Recording.open(path) as recording:
        with pytest.raises(RecordingError) as caught:
            recording.require('odom', ODOMETRY, 'topics.odom')
        assert f'topic /odom cannot be read: it is {ODOMETRY} serialized as {encoding!r}; allowed: cdr' in str(
            caught.value)
        with pytest.raises(RecordingError, match=f"/odom .not read: {ODOMETRY} serialized as '{encoding}'"):
            recording.require('wheels', ODOMETRY, 'topics.odom')
        assert len(list(recording.messages())) == 20


def test_a_database_of_another_serialization(write_recording):
    path = write_recording('run.db3')
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("UPDATE topics SET serialization_format = 'json' WHERE name = '/odom'")
    with Recording.open(path) as recording, pytest.raises(RecordingError, match="serialized as 'json'; allowed: cdr"):
        recording.require('odom', ODOMETRY, 'topics.odom')


@pytest.mark.parametrize(('name', 'full'), [
    ('nav_msgs/Odometry', ODOMETRY), (ODOMETRY, ODOMETRY), ('nav_msgs::msg::dds_::Odometry_', ODOMETRY),
    ('nav_msgs::msg::Odometry', ODOMETRY), ('my_msgs/srv/Ask_Request', 'my_msgs/srv/Ask_Request'), ('', '')])
def test_ways_to_write_a_type(name, full):
    assert full_type_name(name) == full


@pytest.mark.parametrize('storage', ['mcap', 'db3'])
def test_types_without_msg_are_the_same_types(write_recording, tmp_path, storage):
    path = write_recording(f'run.{storage}')
    if storage == 'db3':
        with closing(sqlite3.connect(path)) as database, database:
            database.execute("UPDATE topics SET type = replace(type, '/msg/', '/')")
            database.execute("UPDATE message_definitions SET topic_type = replace(topic_type, '/msg/', '/')")
    else:
        messages = raw_messages(path)
        path = write_channels(tmp_path / 'short.mcap', [
            (topic, 'cdr', kind.replace('/msg/', '/'), 'ros2msg', definition_of(kind),
             [(ns, raw) for each, _, ns, raw in messages if each == topic])
            for topic, kind in (('/odom', ODOMETRY), ('/echo', SCAN))])
    with Recording.open(path) as recording:
        recording.require('odom', ODOMETRY, 'topics.odom')
        recording.require('echo', SCAN, 'topics.echo')
    assert read(path) == (61, '')


IDL = """================================================================================
IDL: my_msgs/msg/Depth
module my_msgs {
  module msg {
    struct Depth {
      float depth;
    };
  };
};
"""


def test_a_schema_in_idl(bare, tmp_path):
    depth = bytes.fromhex('00010000') + np.float32(7.5).tobytes()
    path = write_channels(tmp_path / 'idl.mcap', [
        ('/depth', 'cdr', 'my_msgs/msg/Depth', 'ros2idl', IDL, [(1, depth), (2, depth)])])
    with Recording.open(path) as recording:
        assert [entry.message.depth for entry in recording.messages()] == [7.5, 7.5]
        assert recording.cautions(['/depth']) == []


# What is no recording of rosbag2

def test_a_recording_of_ros_1_names_the_command_that_converts_it(tmp_path):
    path = tmp_path / 'old drive.bag'
    write_ros1(path)
    text = refusal(path)
    assert text.startswith(f'{path}: cannot be read: is a recording of ROS 1; convert it with: rosbags-convert ')
    command = shlex.split(text.partition('with: ')[2])
    command[0] = str(Path(sys.executable).with_name(command[0]))
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    with Recording.open(tmp_path / 'old drive') as recording:
        assert recording.require('odom', ODOMETRY, 'topics.odom') == '/odom'
        assert [entry.message.pose.pose.position.x for entry in recording.messages()] == [0.0, 1.0, 2.0]
    (tmp_path / 'folder').mkdir()
    path.rename(tmp_path / 'folder' / 'drive')
    assert 'rosbags-convert --src' in refusal(tmp_path / 'folder')
    write_ros1(path)
    path.rename(tmp_path / 'other.mcap')  # by whose ending rosbags-convert would take it for one of ROS 2
    folder = Path(sys.executable).parent
    subprocess.run(refusal(tmp_path / 'other.mcap').partition('with: ')[2], shell=True, check=True, timeout=120,
                   capture_output=True, env={**os.environ, 'PATH': f'{folder}:{os.environ["PATH"]}'})
    with Recording.open(tmp_path / 'other') as recording:
        assert len(list(recording.messages())) == 3


def write_ros1(path):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)

    def ros1(message):
        """The same message of ROS 1, whose headers count."""
        fields = {name: ros1(value) if hasattr(value, '__msgtype__') else value
                  for name, value in vars(message).items()}
        head = {'seq': 0} if message.__msgtype__ == 'std_msgs/msg/Header' else {}
        return store.types[message.__msgtype__](**head, **fields)

    with Writer(path) as writer:
        connection = writer.add_connection('/odom', ODOMETRY, typestore=store)
        for k in range(3):
            pose = make('geometry_msgs/msg/Pose', position=make('geometry_msgs/msg/Point', x=float(k)))
            message = make(ODOMETRY, pose=make('geometry_msgs/msg/PoseWithCovariance', pose=pose))
            writer.write(connection, k, store.serialize_ros1(ros1(message), ODOMETRY))


@pytest.mark.parametrize(('content', 'text'), [
    (b'', 'the file is empty'), (b'PK\x03\x04' + bytes(100), 'is packed (zip); unpack it first: unzip '),
    (b'version https://git-lfs.github.com/spec/v1\n', 'get that with: git lfs pull'),
    (b'<!DOCTYPE html>\n', 'is a web page'), (b'<?xml version="1.0"?><Error/>', "is a server's answer"),
    (b'{"error": 404}', "is a server's answer"), (bytes(1000), 'begins with zeros: room was made for it'),
    (b'\x89MCAP0\n\x01\x02', 'was copied as text'), (b'\x89MCAP0\r\r\n\x01', 'was copied as text'),
    (b'\x00\x01\x02', 'it begins with the bytes 00 01 02'),
    (ZSTD(b'PK\x03\x04' + bytes(100)), 'is packed (zip)'), (ZSTD(b''), 'it holds nothing'),
    (SKIPPABLE, 'neither MCAP')])
def test_what_is_none_is_called_by_its_name(tmp_path, content, text):
    path = tmp_path / 'run.mcap'
    path.write_bytes(content)
    assert text in refusal(path)
    assert 'content' not in refusal(path)  # the name of what was unpacked


def test_a_folder_of_recordings_names_them(write_recording):
    write_recording('b')
    folder = write_recording('a').parent
    assert refusal(folder).endswith('it is not a rosbag2 directory, but holds some: name a, b')


def test_a_broken_link(tmp_path):
    (tmp_path / 'run.mcap').symlink_to('gone.mcap')
    assert 'is a link to gone.mcap, which is not there' in refusal(tmp_path / 'run.mcap')


def test_a_file_beside_it_that_may_not_be_read_costs_nothing(write_recording, monkeypatch):
    """As root everything may be read, so it is said that it may not."""
    path = write_recording()
    for name in ('notes.txt', 'other.mcap'):
        (path / name).write_text('mine')
    given = layout.kind_of

    def kind_of(file):
        if file.name in barred:
            raise PermissionError(13, 'Permission denied', str(file))
        return given(file)

    monkeypatch.setattr(layout, 'kind_of', kind_of)
    barred = {'notes.txt'}
    with Recording.open(path) as recording:
        assert recording.topics['/echo'].message_count
    barred = {'other.mcap'}
    with pytest.raises(RecordingError, match=r'other\.mcap: cannot be read: Permission denied'), Recording.open(path):
        pass
