"""Recordings as the field leaves them: cut, flipped, unfinished, in parts, compressed."""

import struct
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.writing import RecordingWriter, typestore


def raw_messages(source):
    """Topic, type, log time and bytes of all messages, by rosbags."""
    from rosbags.highlevel import AnyReader

    with AnyReader([source]) as reader:
        return [(connection.topic, connection.msgtype, log_ns, bytes(raw))
                for connection, log_ns, raw in reader.messages()]


def write_mcap(path, messages, chunk_size=2**14, crcs=True, compression=CompressionType.ZSTD, finish=True, **options):
    """An .mcap by the reference library; without `finish` as a power cut leaves it, without the chunk begun last."""
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=chunk_size, compression=compression, enable_crcs=crcs, **options)
        writer.start('ros2', 'test')
        schemas, channels = {}, {}
        for topic, type_name, log_ns, raw in messages:
            if type_name not in schemas:
                text = typestore().generate_msgdef(type_name, ros_version=2)[0]
                schemas[type_name] = writer.register_schema(type_name, 'ros2msg', text.encode())
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, 'cdr', schemas[type_name])
            writer.add_message(channels[topic], log_ns, raw, log_ns)
        if finish:
            writer.finish()
    return path


def split(source, folder, parts=3):
    """A rosbag2 directory of several files, each with its share of the messages."""
    from ruamel.yaml import YAML

    messages = raw_messages(source)
    with Recording.open(source) as recording, RecordingWriter(folder) as writer:
        for entry in recording.messages():
            writer.write(entry.topic, entry.message, entry.log_ns)
    (folder / f'{folder.name}.mcap').unlink()
    names = [f'{folder.name}_{k}.mcap' for k in range(parts)]
    edges = np.linspace(0, len(messages), parts + 1).astype(int)
    for name, first, last in zip(names, edges, edges[1:], strict=False):
        write_mcap(folder / name, messages[first:last])
    metadata = YAML(typ='safe').load((folder / 'metadata.yaml').read_text())
    metadata['rosbag2_bagfile_information']['relative_file_paths'] = names
    with (folder / 'metadata.yaml').open('w') as file:
        YAML(typ='safe').dump(metadata, file)
    return folder


def cut(source, target, share):
    """The first `share` of a file."""
    whole = source.read_bytes()
    target.write_bytes(whole[:int(share * len(whole))])
    return target


def flipped(source, target, seed, bits=4):
    """A file with single bits flipped at random places."""
    content = np.frombuffer(source.read_bytes(), np.uint8).copy()
    rng = np.random.default_rng(seed)
    content[rng.integers(0, content.size, bits)] ^= (1 << rng.integers(0, 8, bits)).astype(np.uint8)
    target.write_bytes(content.tobytes())
    return target


def whole_chunks(path: Path):
    """First and last byte of each chunk of a sound or unfinished .mcap, from the lengths of its records alone."""
    content, offset, found = path.read_bytes(), 8, []
    while offset + 9 <= len(content):
        opcode, length = struct.unpack_from('<BQ', content, offset)
        if offset + 9 + length > len(content):
            break
        if opcode == 6:
            found.append((offset, offset + 9 + length))
        offset += 9 + length
        if opcode == 2:
            break
    return found
