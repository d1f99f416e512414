"""Reading an MCAP file chunk by chunk, so that a damaged chunk or a missing end costs no more than itself.

rosbags and mcap's own readers give up where a file has no end, and rosbags unpacks a chunk however large it becomes.
The records themselves are parsed by the package mcap. See https://mcap.dev/spec.
"""

import heapq
import itertools
import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.decompression import most_of
from polymap_ros.recordings.mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_HEAD,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    RECORD,
    SCHEMA,
    STATISTICS,
    records_in,
    records_of,
)
from polymap_ros.recordings.storage import MOST_BYTES, MOST_NS, Channel, RawMessage, full_type_name, why_left_out

_ENCODINGS = {'ros2msg': 'msg', 'ros2idl': 'idl', 'omgidl': 'idl', '': ''}


class _Piece(NamedTuple):
    """A chunk, or a message outside of chunks: where it is in the file, and the log times it says it has."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    is_chunk: bool


class McapFile:
    """An open MCAP file; a `polymap_ros.recordings.storage.StoredFile`.

    Parameters
    ----------
    path : Path
        What the user calls it.
    content : Path, optional
        Where it lies, if not there.
    begin : int, optional
        Its first byte there, where it was appended to another one.

    Attributes
    ----------
    next : int or None
        First byte of the MCAP file that was appended to this one; None where there is none.

    Raises
    ------
    RecordingError
        For what is no MCAP file, and one that nothing can be read from.
    """

    def __init__(self, path: Path, content: Path | None = None, begin: int = 0) -> None:
        self.path = path
        self.next: int | None = None
        self._begin = begin
        self.faults: list[str] = []
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._pieces: list[_Piece] = []
        self._counts: dict[int, int] | None = None
        self._lost: set[int] = set()
        self._stream = (content or path).open('rb')
        try:
            self._survey()
            if self._counts is None or not set(self._counts) <= set(self._channels):
                self._count()
        except BaseException:
            self._stream.close()
            raise
        counts: dict[int, int] = self._counts or {}
        self.channels = [self._described(number, counts.get(number, 0)) for number in self._channels]
        filled = [piece for piece in self._pieces if piece.start_ns <= piece.end_ns]
        self.start_ns = min((piece.start_ns for piece in filled), default=0)
        self.end_ns = max((piece.end_ns for piece in filled), default=-1)

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def messages(self, topics: Collection[str], start_ns: int, end_ns: int) -> Iterator[RawMessage]:
        """The sound messages of some topics within a half-open interval, by log time; see `faults` afterwards."""
        wanted = {number: (channel.topic, self._type_of(channel))
                  for number, channel in self._channels.items()
                  if channel.topic in topics and not why_left_out(channel.message_encoding)}
        waiting: list[tuple[int, int, int, bytes]] = []  # a heap, by log time and, where that is the same, as written
        written, size = itertools.count(), 0
        for piece in [*sorted(self._pieces), None]:
            while waiting and (piece is None or waiting[0][0] < piece.start_ns):
                log_ns, _, number, data = heapq.heappop(waiting)
                size -= len(data)
                yield RawMessage(log_ns, *wanted[number], data)
            if piece is None or piece.end_ns < start_ns or piece.start_ns >= end_ns:
                continue
            for log_ns, number, data in self._read(piece):
                if start_ns <= log_ns < end_ns and number in wanted:
                    heapq.heappush(waiting, (log_ns, next(written), number, data))
                    size += len(data)
            if size > 4 * MOST_BYTES:
                raise RecordingError(f'{self.path}: is out of order: more than {size} bytes of chunks of the same time')

    def _survey(self) -> None:
        """Find the chunks, and what lies outside of them; the chunks themselves are not read."""
        size = self._stream.seek(0, 2)
        if not self._is_magic(self._begin):
            raise RecordingError(f'{self.path}: cannot be read: is no MCAP file')
        offset, promised, ended = self._begin + len(MAGIC), 0, False
        while not ended:
            opcode, length = self._head(offset, size)
            if not opcode:
                known = [start for start in self._indexed(size) if start > offset]
                if not known:
                    break
                self.faults.append(f'{self.path.name}: bytes {offset} to {min(known)} are damaged and left out')
                offset = min(known)
                continue
            promised += self._note(opcode, offset + RECORD.size, length)
            offset += RECORD.size + length
            ended = opcode == FOOTER
        if promised > most_of(size):
            raise RecordingError(f'{self.path}: its {size} bytes promise to become {promised}, which is refused')
        if not ended or not self._is_magic(offset):
            self._counts = None
            self.faults.append(f'{self.path.name} has no end: it was cut off, or is still being written; of its {size} '
                               f'bytes the first {offset} are whole')
        else:
            offset += len(MAGIC)
        if self._is_magic(offset):
            self.next = offset
        elif ended and any(any(self._bytes(start, 2**20)) for start in range(offset, size, 2**20)):
            self.faults.append(f'{self.path.name}: {size - offset} bytes after its end, at byte {offset}, are not '
                               'read: if they are another recording, split the file there')

    def _is_magic(self, offset: int) -> bool:
        return self._bytes(offset, len(MAGIC)) == MAGIC

    def _head(self, offset: int, size: int) -> tuple[int, int]:
        """Opcode and length of a record; 0 for what is none, or reaches beyond the end of the file."""
        head = self._bytes(offset, RECORD.size)
        opcode, length = RECORD.unpack(head) if len(head) == RECORD.size else (0, 0)
        return (opcode, length) if offset + RECORD.size + length <= size else (0, 0)

    def _indexed(self, size: int) -> list[int]:
        """Where the file's own index says that chunks, and the index itself, begin; nothing where it has no end."""
        footer = size - len(MAGIC) - 20
        try:
            summary, _, _ = struct.unpack('<QQI', self._bytes(footer, 20))
            begin = self._begin + summary
            records = records_of(self._bytes(begin, footer - RECORD.size - begin)) if summary else []
            return [begin, *(self._begin + struct.unpack_from('<Q', record, 16)[0] for opcode, record in records
                             if opcode == CHUNK_INDEX)] if summary else []
        except (struct.error, ValueError, OSError):
            return []

    def _note(self, opcode: int, start: int, length: int) -> int:
        """Take what a record outside of chunks says; returns the bytes that a chunk promises to hold."""
        try:
            if opcode == CHUNK:
                first_ns, last_ns, size, *_ = CHUNK_HEAD.unpack(self._bytes(start, CHUNK_HEAD.size))
                self._pieces.append(_Piece(first_ns, last_ns, start, length, True))
                return int(size)
            if opcode == MESSAGE:
                _, _, log_ns, _ = MESSAGE_HEAD.unpack(self._bytes(start, MESSAGE_HEAD.size))
                self._pieces.append(_Piece(log_ns, log_ns, start, length, False))
            elif opcode in (SCHEMA, CHANNEL, STATISTICS):
                self._learn(opcode, self._bytes(start, length))
            elif opcode == DATA_END and not self._sums_up(self._begin, start - RECORD.size, self._bytes(start, 4)):
                self.faults.append(f'{self.path.name}: the checksum of its data is wrong')
            elif opcode == FOOTER:
                self._check_summary(start)
        except (struct.error, ValueError, EOFError) as error:
            self.faults.append(f'{self.path.name}: a record at byte {start} is damaged ({error})')
        return 0

    def _check_summary(self, footer: int) -> None:
        summary, _, _ = struct.unpack('<QQI', self._bytes(footer, 20))
        if summary and not self._sums_up(self._begin + summary, footer + 16, self._bytes(footer + 16, 4)):
            self.faults.append(f'{self.path.name}: the checksum of its summary is wrong')

    def _sums_up(self, begin: int, end: int, stored: bytes) -> bool:
        (expected,) = struct.unpack('<I', stored)
        if not expected:
            return True
        found = 0
        for offset in range(begin, end, 2**20):
            found = zlib.crc32(self._bytes(offset, min(2**20, end - offset)), found)
        return bool(found == expected)

    def _learn(self, opcode: int, content: bytes) -> None:
        """Take a schema, a channel or the statistics."""
        from mcap.data_stream import ReadDataStream
        from mcap.exceptions import McapError
        from mcap.records import Channel as ChannelRecord
        from mcap.records import Schema, Statistics

        stream = ReadDataStream(BytesIO(content))
        try:
            if opcode == SCHEMA:
                schema = Schema.read(stream)
                self._schemas.setdefault(schema.id, schema)
            elif opcode == CHANNEL:
                channel = ChannelRecord.read(stream)
                self._channels.setdefault(channel.id, channel)
            else:
                self._counts = Statistics.read(stream).channel_message_counts
        except McapError as error:
            raise ValueError(f'{type(error).__name__}: {error}') from error

    def _count(self) -> None:
        """Read all chunks, where the file does not say what is in them."""
        counts: Counter[int] = Counter()
        sound = []
        for piece in self._pieces:
            times = []
            for log_ns, number, _ in self._read(piece):
                counts[number] += 1
                times.append(log_ns)
            if times:
                sound.append(piece._replace(start_ns=min(times), end_ns=max(times)))
        if not sound and self.faults:
            raise RecordingError(f'{self.path}: cannot be read: {self.faults[0]}, and no message can be rescued')
        self._pieces, self._counts = sound, dict(counts)

    def _read(self, piece: _Piece) -> list[tuple[int, int, bytes]]:
        """Log time, channel and bytes of every message of a piece; nothing, and a fault, where it is damaged."""
        try:
            content = self._bytes(piece.offset, piece.length)
            records = records_of(records_in(content)) if piece.is_chunk else [(MESSAGE, content)]
            found = []
            for opcode, record in records:
                if opcode == MESSAGE:
                    number, _, log_ns, _ = MESSAGE_HEAD.unpack_from(record)
                    if log_ns >= MOST_NS:
                        raise ValueError(f'a message has the log time {log_ns} ns')
                    found.append((log_ns, number, record[MESSAGE_HEAD.size:]))
                elif opcode in (SCHEMA, CHANNEL):
                    self._learn(opcode, record)
        except (struct.error, ValueError, EOFError, MemoryError) as error:
            if piece.offset not in self._lost:
                self._lost.add(piece.offset)
                self.faults.append(f'{self.path.name}: the chunk at byte {piece.offset} is damaged and left out '
                                   f'({" ".join(str(error).split()) or "too large"})')
            return []
        return found

    def _bytes(self, offset: int, length: int) -> bytes:
        if length > 2 * MOST_BYTES:
            raise ValueError(f'a record has {length} bytes, {2 * MOST_BYTES} are allowed')
        self._stream.seek(offset)
        return self._stream.read(length)

    def _described(self, number: int, message_count: int) -> Channel:
        channel = self._channels[number]
        schema = self._schemas.get(channel.schema_id)
        encoding = _ENCODINGS.get(schema.encoding, '') if schema else ''
        definition = schema.data.decode(errors='replace') if schema and encoding else ''
        return Channel(channel.topic, self._type_of(channel), definition, encoding, message_count,
                       why_left_out(channel.message_encoding))

    def _type_of(self, channel: Any) -> str:
        schema = self._schemas.get(channel.schema_id)
        return full_type_name(schema.name) if schema else ''
