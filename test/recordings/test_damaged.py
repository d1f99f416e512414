"""What can be rescued from a damaged recording is, and what is missing is said; the rest is refused in one line."""

import sqlite3
from contextlib import closing, suppress

import numpy as np
import pytest
import zstandard
from damage import cut, flipped, raw_messages, split, whole_chunks, write_mcap
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.storage import MOST_BYTES

TOPICS = ['/odom', '/echo']


def read(path):
    """Log times by topic, and the cautions, of a complete pass."""
    with Recording.open(path) as recording:
        entries = list(recording.messages(TOPICS))
        topics = [topic for topic in TOPICS if topic in recording.topics]
        return [(entry.topic, entry.log_ns) for entry in entries], recording.cautions(topics)


def rescued(path):
    """The same, or None where the recording is refused in one line."""
    try:
        return read(path)
    except RecordingError as error:
        lines = str(error).splitlines()
    assert len(lines) == 1
    return None


def refusal(path):
    with pytest.raises(RecordingError) as caught:
        read(path)
    assert '\n' not in str(caught.value)
    assert path.name in str(caught.value)
    return str(caught.value)


@pytest.fixture
def messages(write_recording):
    return raw_messages(write_recording('whole'))


@pytest.fixture
def told(messages):
    return [(topic, log_ns) for topic, _, log_ns, _ in messages]


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('chunk_size', [2**10, 2**12, 2**20])
def test_a_sound_file_of_the_reference_writer_is_read_whole(tmp_path, messages, told, compression, chunk_size):
    path = write_mcap(tmp_path / 'run.mcap', messages, chunk_size, compression=compression)
    assert read(path) == (told, [])


def test_a_file_without_chunks(tmp_path, messages, told):
    assert read(write_mcap(tmp_path / 'run.mcap', messages, use_chunking=False)) == (told, [])


def test_chunks_that_overlap_in_time_are_read_in_order_of_log_time(tmp_path, messages, told):
    shuffled = [messages[k] for k in np.random.default_rng(1).permutation(len(messages))]
    found, cautions = read(write_mcap(tmp_path / 'run.mcap', shuffled, 2**12))
    assert ([log_ns for _, log_ns in found], sorted(found)) == ([log_ns for _, log_ns in told], sorted(told))
    assert cautions == []


def test_an_unfinished_file_gives_what_the_reference_reader_finds(tmp_path, messages):
    path = write_mcap(tmp_path / 'run.mcap', messages, 2**12, finish=False)
    with path.open('rb') as stream:
        reader = NonSeekingReader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        expected = []
        with suppress(EndOfFile):
            for _, channel, message in reader:
                expected.append((channel.topic, message.log_time))
    found, (caution,) = read(path)
    assert found == expected
    assert 0 < len(found) < len(messages)
    assert caution.code == 'recording_damaged'
    assert caution.text.startswith('run.mcap has no end: it was cut off, or is still being written; of its')


@pytest.mark.parametrize('crcs', [True, False])
def test_of_a_file_cut_anywhere_the_whole_chunks_are_rescued(tmp_path, messages, told, crcs):
    path = write_mcap(tmp_path / 'run.mcap', messages, 2**12, crcs)
    chunks, numbers = whole_chunks(path), set()
    counts = [len(read_chunk(path, chunk)) for chunk in chunks]
    for share in np.linspace(0.0, 0.999, 40):
        damaged = cut(path, tmp_path / 'cut.mcap', share)
        whole = sum(number for (_, end), number in zip(chunks, counts, strict=True)
                    if end <= damaged.stat().st_size)
        if not whole:
            refusal(damaged)
            continue
        found, cautions = read(damaged)
        assert found == told[:whole]
        assert any('has no end' in caution.text for caution in cautions)
        numbers.add(whole)
    assert len(numbers) == len(chunks)


def read_chunk(path, chunk):
    """Messages of a chunk, by the reference library."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk, Message
    from mcap.stream_reader import breakup_chunk

    with path.open('rb') as stream:
        stream.seek(chunk[0] + 9)
        return [record for record in breakup_chunk(Chunk.read(ReadDataStream(stream)), validate_crc=True)
                if isinstance(record, Message)]


def test_a_chunk_with_a_wrong_checksum_is_left_out_and_the_others_are_not(tmp_path, messages, told):
    path = write_mcap(tmp_path / 'run.mcap', messages, 2**12, compression=CompressionType.NONE)
    chunks = whole_chunks(path)
    content = bytearray(path.read_bytes())
    content[chunks[2][1] - 100] ^= 1
    path.write_bytes(content)
    found, cautions = read(path)
    numbers = [len(read_chunk(path, chunk)) for chunk in (*chunks[:2], *chunks[3:])]
    assert len(found) == sum(numbers)
    assert found[:sum(numbers[:2])] == told[:sum(numbers[:2])]
    assert 'its checksum is wrong' in cautions[0].text
    assert 'found where the recording announces 20' in cautions[-1].text


def test_a_chunk_with_a_wrong_length_does_not_hide_those_after_it(tmp_path, messages, told):
    path = write_mcap(tmp_path / 'run.mcap', messages, 2**12)
    chunks = whole_chunks(path)
    content = bytearray(path.read_bytes())
    content[chunks[1][0] + 6] ^= 1  # the length of the second chunk's record
    path.write_bytes(content)
    found, cautions = read(path)
    lost = len(read_chunk(path, chunks[1]))
    assert len(found) == len(told) - lost
    assert found[-1] == told[-1]
    assert f'bytes {chunks[1][0]} to {chunks[2][0]} are damaged and left out' in cautions[0].text


@pytest.fixture
def halves(tmp_path, messages):
    """The bytes of two MCAP files; the second one has its topics in another order, so other numbers of them."""
    half = len(messages) // 2
    while messages[half][0] == messages[0][0]:
        half += 1
    return [write_mcap(tmp_path / f'{k}.mcap', part, 2**12).read_bytes()
            for k, part in enumerate((messages[:half], messages[half:]))]


@pytest.mark.parametrize('pack', [bytes, zstandard.ZstdCompressor().compress])
def test_a_file_that_was_appended_to_another_is_read_too(tmp_path, halves, told, pack):
    path = tmp_path / 'both.mcap'
    path.write_bytes(b''.join(map(pack, halves)))
    assert read(path) == (told, [])


def test_damage_of_a_file_that_was_appended_is_told(tmp_path, messages, halves, told):
    path, (first, second) = tmp_path / 'both.mcap', halves
    (start, stop), (then, _), *_ = whole_chunks(tmp_path / '1.mcap')
    hurt = bytearray(second)
    hurt[start + 6] ^= 1  # the length of its first chunk's record
    path.write_bytes(first + hurt)
    found, cautions = read(path)
    assert cautions[0].text.startswith(f'both.mcap: bytes {len(first) + start} to {len(first) + then} are damaged')
    assert len(found) == len(told) - len(read_chunk(tmp_path / '1.mcap', (start, stop)))
    path.write_bytes(first + second[:300])
    found, (caution,) = read(path)
    assert (len(found) < len(told), 'what follows from byte' in caution.text) == (True, True)
    path.write_bytes(first + first)
    found, (caution,) = read(path)
    assert (found, caution.code) == (told[:len(found)], 'recording_inconsistent')


@pytest.mark.parametrize(('kind', 'rest', 'is_told'), [
    ('mcap', bytes(4096), False), ('mcap', bytes(4096) + b'x', True), ('db3', bytes(4096), False), ('db3', None, True)])
def test_what_follows_the_end_is_told_unless_it_is_zeros(write_recording, told, kind, rest, is_told):
    path = write_recording(f'run.{kind}')
    content = path.read_bytes()
    path.write_bytes(content + (content if rest is None else rest))
    found, cautions = read(path)
    number = len(content if rest is None else rest)
    assert found == told
    assert [f'{path.name}: {number} bytes after its end, at byte {len(content)}, are not read' in caution.text
            for caution in cautions] == [True] * is_told


def test_a_folder_after_a_power_cut(tmp_path, messages, told):
    folder = tmp_path / 'drive'
    folder.mkdir()
    half = len(messages) // 2
    write_mcap(folder / 'drive_0.mcap', messages[:half], 2**12)
    write_mcap(folder / 'drive_1.mcap', messages[half:], 2**12, finish=False)
    found, (damaged, unnamed) = read(folder)
    assert found == told[:len(found)]
    assert half < len(found) < len(told)
    assert damaged.text.startswith('drive_1.mcap has no end')
    assert unnamed.text.startswith('drive holds no metadata.yaml: what is missing cannot be told')


def test_a_split_recording_is_read_as_one(write_recording, tmp_path, told):
    folder = split(write_recording(), tmp_path / 'parts')
    assert read(folder) == (told, [])


def test_a_missing_part_costs_its_messages(write_recording, tmp_path, told):
    folder = split(write_recording(), tmp_path / 'parts')
    (folder / 'parts_1.mcap').unlink()
    found, cautions = read(folder)
    assert found == told[:20] + told[40:]
    assert cautions[0].finding == 'parts: the part parts_1.mcap is missing'
    assert {caution.code for caution in cautions[1:]} == {'recording_incomplete'}


@pytest.mark.parametrize(('name', 'told_of'), [('run_{}', ['run_1']), ('run_{:03d}', ['run_001']), ('run_{}7', [])])
def test_without_metadata_a_gap_in_the_numbers_is_a_missing_part(tmp_path, messages, name, told_of):
    folder = tmp_path / 'run'
    folder.mkdir()
    for number in (0, 2):
        write_mcap(folder / f'{name.format(number)}.mcap', messages[20 * number:20 * number + 20])
    found, cautions = read(folder)
    assert len(found) == 40
    assert [part in cautions[0].text for part in told_of] == [True] * len(told_of)
    assert ('the part ' in cautions[0].finding) == bool(told_of)


def test_a_part_that_cannot_be_read_costs_its_messages(write_recording, tmp_path, told):
    folder = split(write_recording(), tmp_path / 'parts')
    (folder / 'parts_2.mcap').write_bytes(b'')
    found, cautions = read(folder)
    assert found == told[:40]
    assert 'parts_2.mcap: cannot be read: the file is empty' in cautions[0].text


@pytest.fixture
def database(write_recording):
    return write_recording('run.db3')


def test_of_a_database_with_damaged_pages_the_sound_ones_are_rescued(database, told):
    content = bytearray(database.read_bytes())
    page = int.from_bytes(content[16:18], 'big')
    middle = len(content) // page // 2 * page
    content[middle:middle + page] = bytes(page)
    database.write_bytes(content)
    found, cautions = read(database)
    assert 0 < len(found) < len(told)
    assert set(found) <= set(told)
    assert found == sorted(found, key=lambda each: each[1])
    assert 'messages are on sound pages' in cautions[0].text


def test_a_row_said_to_be_larger_than_memory_costs_itself_and_those_after_it(database, told):
    content = bytearray(database.read_bytes())
    page = int.from_bytes(content[16:18], 'big')
    leaf = next(start for start in range(page, len(content), page)
                if content[start] == 13 and int.from_bytes(content[start + 3:start + 5], 'big') > 3)
    cell = leaf + int.from_bytes(content[leaf + 10:leaf + 12], 'big')
    content[cell:cell + 17] = bytes.fromhex(14 * 'ff' + '3e855a')  # its length, its id, and its columns'
    database.write_bytes(content)
    with closing(sqlite3.connect(database)) as connection:
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
        with pytest.raises(MemoryError):
            connection.execute('SELECT timestamp FROM messages NOT INDEXED').fetchall()
    found, cautions = read(database)
    assert set() < set(found) < set(told)
    assert 'messages are on sound pages' in cautions[0].text


def test_a_schema_whose_names_are_no_text_is_refused(database):
    content = database.read_bytes()
    damaged = content.replace(b'tablemessagesmessages', b'table\x86essagesmessages').replace(
        b'CREATE TABLE messages', b'CREATE XABLE messages')
    assert damaged != content
    database.write_bytes(damaged)
    with closing(sqlite3.connect(database)) as connection, pytest.raises(UnicodeDecodeError):
        connection.execute('PRAGMA quick_check(1)')
    with pytest.raises(RecordingError, match='cannot be read'):
        read(database)


def test_a_database_cut_off_gives_its_first_messages_or_is_refused(database, tmp_path, told):
    outcomes = []
    for share in np.linspace(0.0, 0.99, 12):
        if (result := rescued(cut(database, tmp_path / 'cut.db3', share))) is None:
            continue
        found, cautions = result
        assert cautions
        assert set(found) <= set(told)
        outcomes.append(len(found))
    assert outcomes
    assert max(outcomes) > len(told) // 2


def test_what_lies_in_the_log_of_an_interrupted_writer_is_read(database, tmp_path, told):
    """A copy of database and log while the writer still has them open: what a power cut leaves."""
    writer = sqlite3.connect(database)
    writer.execute('PRAGMA journal_mode = WAL')
    writer.execute('PRAGMA wal_autocheckpoint = 0')
    rows = writer.execute('SELECT topic_id, timestamp + 10000000000, data FROM messages').fetchall()
    writer.executemany('INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)', rows)
    writer.commit()
    for name in ('run.db3', 'run.db3-wal'):
        (tmp_path / 'left').mkdir(exist_ok=True)
        (tmp_path / 'left' / name).write_bytes((tmp_path / name).read_bytes())
    writer.close()
    found, cautions = read(tmp_path / 'left' / 'run.db3')
    assert (len(found), cautions) == (2 * len(told), [])


def test_text_of_a_database_that_is_none(database, told):
    writer = sqlite3.connect(database)
    writer.execute("UPDATE topics SET name = CAST(x'2fba' AS TEXT) WHERE name = '/odom'")
    writer.commit()
    writer.close()
    with Recording.open(database) as recording:
        assert sorted(recording.topics) == ['/echo', '/\ufffd']


@pytest.mark.parametrize('kind', ['crc', 'plain', 'sqlite3'])
def test_flipped_bits_are_told_or_harmless(messages, told, write_recording, tmp_path, kind):
    """Nothing but RecordingError comes out; with checksums no message that is altered comes out either."""
    if kind == 'sqlite3':
        whole = write_recording('whole.db3')
    else:
        whole = write_mcap(tmp_path / 'whole.mcap', messages, 2**12, kind == 'crc')
    outcomes = {'whole': 0, 'told': 0, 'refused': 0}
    for seed in range(40):
        damaged = flipped(whole, tmp_path / f'damaged{whole.suffix}', seed)
        if (result := rescued(damaged)) is None:
            outcomes['refused'] += 1
            continue
        found, cautions = result
        if kind == 'crc':
            assert set(found) <= set(told)
        if cautions:
            outcomes['told'] += 1
        else:
            assert len(found) == len(told)
            outcomes['whole'] += 1
    assert outcomes['told'] > 0
    if kind == 'crc':
        assert outcomes['told'] + outcomes['refused'] >= 30
