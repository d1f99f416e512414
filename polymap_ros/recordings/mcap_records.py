"""The records of an MCAP file as bytes: see https://mcap.dev/spec."""

import struct
from collections.abc import Iterator

from polymap_ros.recordings.decompression import decompressed, has_checksum

MAGIC = b'\x89MCAP0\r\n'
"""First and last bytes of an MCAP file."""

FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, STATISTICS, DATA_END = 2, 3, 4, 5, 6, 8, 11, 15
"""Opcodes."""

RECORD = struct.Struct('<BQ')
"""Before each record: opcode, length."""

CHUNK_HEAD = struct.Struct('<QQQII')
"""First and last log time, size of the content and its CRC-32, length of the compression's name."""

MESSAGE_HEAD = struct.Struct('<HIQQ')
"""Channel, sequence number, log time, publish time."""


def records_of(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Opcode and bytes of one record after the other.

    Raises
    ------
    ValueError, struct.error
        Where the last one is not whole.
    """
    offset = 0
    while offset < len(content):
        opcode, length = RECORD.unpack_from(content, offset)
        start = offset + RECORD.size
        offset = start + length
        if offset > len(content):
            raise ValueError('a record reaches beyond its end')
        yield opcode, content[start:offset]


def records_in(chunk: bytes) -> bytes:
    """The content of a chunk, of the promised size and with the promised checksum.

    Raises
    ------
    ValueError, struct.error
        Where it is not.
    """
    _, _, size, crc, length = CHUNK_HEAD.unpack_from(chunk)
    stop = CHUNK_HEAD.size + length
    (stored,) = struct.unpack_from('<Q', chunk, stop)
    if stop + 8 + stored != len(chunk):
        raise ValueError('its lengths contradict each other')
    content = decompressed(chunk[stop + 8:], chunk[CHUNK_HEAD.size:stop].decode(), size)
    if not has_checksum(content, crc):
        raise ValueError('its checksum is wrong')
    return content
