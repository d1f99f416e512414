"""Recordings that are meant to do harm are refused or told: bounded memory and time, nothing outside of the folder."""

import os
import sqlite3
import struct
import tracemalloc

import lz4.frame
import pytest
import zstandard
from damage import raw_messages, write_mcap
from mcap.writer import CompressionType
from ruamel.yaml import YAML

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.decompression import decompressed, plain_message, unpack_file
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.truth import read_truth

MEGABYTE = 2**20
TOPICS = ['/odom', '/echo']


@pytest.fixture
def frugal():
    """No more than 64 MB are taken at a time."""
    tracemalloc.start()
    yield
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 64 * MEGABYTE


def read(path):
    with Recording.open(path) as recording:
        entries = list(recording.messages(TOPICS))
        return entries, recording.cautions([topic for topic in TOPICS if topic in recording.topics])


def refusal(path):
    with pytest.raises(RecordingError) as caught:
        read(path)
    assert '\n' not in str(caught.value)
    return str(caught.value)


def chunk(data, compression, size, crc=0):
    """A chunk record of an .mcap that says it holds `size` bytes."""
    body = struct.pack('<QQQI', 0, 1, size, crc) + struct.pack('<I', len(compression)) + compression.encode()
    body += struct.pack('<Q', len(data)) + data
    return struct.pack('<BQ', 6, len(body)) + body


BOMBS = {'zstd': zstandard.ZstdCompressor(level=19).compress, 'lz4': lz4.frame.compress}


@pytest.fixture(scope='module')
def bombs():
    """512 MB of zeros."""
    content = bytes(512 * MEGABYTE)
    return {name: compress(content) for name, compress in BOMBS.items()}


@pytest.mark.parametrize('compression', BOMBS)
@pytest.mark.parametrize('size', [100, MEGABYTE])
def test_a_chunk_that_becomes_more_than_it_promises(frugal, bombs, compression, size):
    with pytest.raises(ValueError, match=f'{size} bytes are promised, more are there'):
        decompressed(bombs[compression], compression, size)


@pytest.mark.parametrize('compression', BOMBS)
def test_a_bomb_in_a_recording_costs_its_chunk(write_recording, tmp_path, bombs, compression):
    messages = raw_messages(write_recording())
    whole = write_mcap(tmp_path / 'whole.mcap', messages).read_bytes()
    header = 8 + 9 + struct.unpack_from('<Q', whole, 9)[0]
    path = tmp_path / 'bomb.mcap'
    path.write_bytes(whole[:header] + chunk(bombs[compression], compression, 1000) + whole[header:])
    entries, cautions = read(path)
    assert len(entries) == len(messages)
    assert '1000 bytes are promised, more are there' in cautions[0].text


@pytest.mark.parametrize('size', [2**62, 2**40, 300 * MEGABYTE])
def test_a_chunk_that_promises_too_much(frugal, tmp_path, bombs, size):
    path = tmp_path / 'bomb.mcap'
    path.write_bytes(b'\x89MCAP0\r\n' + chunk(bombs['zstd'][:1000], 'zstd', size))
    assert 'bomb.mcap: ' in refusal(path)


def test_many_chunks_that_promise_much_together(frugal, tmp_path):
    path = tmp_path / 'bomb.mcap'
    path.write_bytes(b'\x89MCAP0\r\n' + 1000 * chunk(b'x', 'zstd', 200 * MEGABYTE))
    assert 'bytes promise to become' in refusal(path)


@pytest.mark.parametrize('length', [2**63, 2**40, 2**31])
def test_a_record_of_absurd_length(frugal, tmp_path, length):
    path = tmp_path / 'long.mcap'
    path.write_bytes(b'\x89MCAP0\r\n' + struct.pack('<BQ', 5, length) + bytes(1000))
    assert 'has no end' in refusal(path)


def test_a_message_that_becomes_too_much(frugal, bombs):
    with pytest.raises(ValueError, match='bytes become more than'):
        plain_message(bombs['zstd'][:20_000])


def test_a_file_that_becomes_too_much(frugal, bombs, tmp_path):
    (tmp_path / 'run.mcap.zstd').write_bytes(bombs['zstd'])
    (tmp_path / 'out').mkdir()
    with pytest.raises(RecordingError, match='a decompression bomb'):
        unpack_file(tmp_path / 'run.mcap.zstd', 'zstd', tmp_path / 'out' / 'content')
    assert sum(path.stat().st_size for path in (tmp_path / 'out').iterdir()) < 80 * MEGABYTE


def test_an_array_of_absurd_length_in_a_message(frugal, write_recording, tmp_path):
    messages = raw_messages(write_recording())
    topic, type_name, log_ns, raw = messages[2]
    assert topic == '/echo'
    at = raw.index(struct.pack('<I', 256), 4)  # the number of intensities; CDR's head looks alike
    messages[2] = topic, type_name, log_ns, raw[:at] + struct.pack('<I', 2**32 - 1) + raw[at + 4:]
    entries, cautions = read(write_mcap(tmp_path / 'run.mcap', messages))
    assert len(entries) == len(messages) - 1
    assert [caution.finding for caution in cautions] == ['/echo: 1 of 20 messages cannot be decoded']


def test_a_type_that_is_defined_otherwise_than_in_ros(write_recording, tmp_path):
    path = write_mcap(tmp_path / 'run.mcap', raw_messages(write_recording()), compression=CompressionType.NONE)
    path.write_bytes(path.read_bytes().replace(b'float64 x', b'float64 q'))
    with Recording.open(path) as recording, pytest.raises(RecordingError, match='otherwise than ROS 2 does'):
        recording.require('odom', 'nav_msgs/msg/Odometry', 'topics.odom')


@pytest.mark.parametrize('name', ['../secret.mcap', '/etc/passwd', '..', '', 'run.mcap/../../secret.mcap'])
def test_no_file_outside_of_the_folder_is_read(write_recording, tmp_path, name):
    path = write_recording()
    (path / 'run.mcap').rename(tmp_path / 'secret.mcap')
    metadata = YAML(typ='safe').load((path / 'metadata.yaml').read_text())
    metadata['rosbag2_bagfile_information']['relative_file_paths'] = [name]
    with (path / 'metadata.yaml').open('w') as file:
        YAML(typ='safe').dump(metadata, file)
    assert 'all files that metadata.yaml names are missing' in refusal(path)


def test_metadata_that_is_too_large(frugal, write_recording):
    path = write_recording()
    with (path / 'metadata.yaml').open('wb') as file:
        file.truncate(100 * MEGABYTE)
    entries, cautions = read(path)
    assert len(entries) == 61
    assert 'bytes, 1048576 are allowed' in cautions[0].text


def test_what_is_no_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / 'run.mcap')
    assert 'a recording is a rosbag2 directory' in refusal(tmp_path / 'run.mcap')


SCHEMAS = {
    'a view without end': 'CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) '
                          "SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n",
    'a computed column': 'CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
                         'data BLOB AS (zeroblob(1000000000)))',
    'no such columns': 'CREATE TABLE messages (id INTEGER PRIMARY KEY)',
}


@pytest.mark.parametrize('schema', SCHEMAS.values(), ids=SCHEMAS)
def test_a_database_that_computes(frugal, write_recording, schema):
    path = write_recording('run.db3')
    connection = sqlite3.connect(path)
    connection.execute('DROP TABLE messages')
    connection.execute(schema)
    connection.commit()
    connection.close()
    assert 'is no database of rosbag2' in refusal(path)


def test_times_that_are_none(write_recording):
    path = write_recording('run.db3')
    connection = sqlite3.connect(path)
    connection.execute("UPDATE messages SET timestamp = 'soon' WHERE id = 3")
    connection.execute('UPDATE messages SET data = 7 WHERE id = 4')
    connection.execute('UPDATE messages SET timestamp = -9223372036854775808 WHERE id = 5')
    connection.commit()
    connection.close()
    entries, cautions = read(path)
    assert len(entries) == 59
    assert {caution.code for caution in cautions} == {'recording_incomplete'}


@pytest.mark.parametrize('name', ['metadata.yaml', 'truth.json', 'run_1.mcap'])
def test_a_pipe_in_a_recordings_folder_is_not_waited_for(write_recording, tmp_path, name):
    folder = tmp_path / 'folder'
    folder.mkdir()
    write_recording('run_0.mcap').rename(folder / 'run_0.mcap')
    os.mkfifo(folder / name)
    entries, _ = read(folder)
    assert len(entries) == 61
    assert read_truth(folder) is None


def test_a_database_whose_index_lacks_messages_is_read_without_it(write_recording):
    path = write_recording('run.db3')
    connection = sqlite3.connect(path)
    connection.execute('CREATE TABLE other (timestamp INTEGER)')
    connection.execute('CREATE INDEX other_index ON other (timestamp)')
    connection.execute('DROP INDEX IF EXISTS timestamp_idx')
    connection.execute('CREATE INDEX timestamp_idx ON messages (timestamp)')
    connection.execute('PRAGMA writable_schema = ON')
    roots = dict(connection.execute("SELECT name, rootpage FROM sqlite_master WHERE type = 'index'"))
    for name, other in (('timestamp_idx', 'other_index'), ('other_index', 'timestamp_idx')):
        connection.execute('UPDATE sqlite_master SET rootpage = ? WHERE name = ?', (roots[other], name))
    connection.commit()
    connection.close()
    entries, cautions = read(path)
    assert len(entries) == 61
    assert [caution.code for caution in cautions] == ['recording_damaged']
    assert 'without its index' in cautions[0].text


def test_a_truth_with_a_number_beyond_floats(tmp_path):
    (tmp_path / 'truth.json').write_text(f'{{"vertices": [[{10**400}, 0], [1, 0], [0, 1]]}}')
    with pytest.raises(RecordingError, match=r'truth\.json: is no ground truth'):
        read_truth(tmp_path)
