"""Reading a database of rosbag2's sqlite3 storage, as far as its pages are sound.

A damaged database is read row by row from both ends, which leaves out what lies on damaged pages.
"""

import os
import shutil
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.storage import MOST_BYTES, Channel, RawMessage, full_type_name, why_left_out

_ENCODINGS = {'ros2msg': 'msg', 'ros2idl': 'idl'}
_COLUMNS = {'topics': {'id', 'name', 'type', 'serialization_format'},
            'messages': {'id', 'topic_id', 'timestamp', 'data'}}

_UNREADABLE = sqlite3.Error, MemoryError, UnicodeDecodeError
"""SQLite says that it has no memory where a damaged page asks for more than it may have, and a message of an error may
quote a damaged name."""


class SqliteFile:
    """An open database; a `polymap_ros.recordings.storage.StoredFile`.

    Parameters
    ----------
    path : Path
        What the user calls it.
    content : Path, optional
        Where it lies, if not there.

    Raises
    ------
    RecordingError
        For what is no database of rosbag2, and one that nothing can be read from.
    """

    def __init__(self, path: Path, content: Path | None = None) -> None:
        self.path, self._content = path, content or path
        self.faults: list[str] = []
        self._copy = TemporaryDirectory(prefix='polymap-')
        try:
            self._database = sqlite3.connect(_address(self._whole_pages()), uri=True)
        except BaseException:
            self._copy.cleanup()
            raise
        try:
            self._database.text_factory = _text
            self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
            self._database.execute('PRAGMA trusted_schema = OFF')
            self._survey()
        except _UNREADABLE as error:
            self.close()
            raise RecordingError(f'{path}: cannot be read: {error}') from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the database."""
        self._database.close()
        self._copy.cleanup()

    def _whole_pages(self) -> Path:
        """The file, or a copy where SQLite could not read it as it is.

        A last page that is not whole is left out, as SQLite would fill it up with zeros. A log of what is not yet in
        the file is read where SQLite may write beside it only.
        """
        size, log = self._content.stat().st_size, _log_of(self._content)
        logged = log.stat().st_size if log.exists() else 0
        with self._content.open('rb') as stream:
            stored = int.from_bytes(stream.read(18)[16:], 'big')
            left = size % (2**16 if stored == 1 else max(stored, 1))
            sealed = logged and not os.access(self._content.parent, os.W_OK)
            if not left and not sealed:
                return self._content
            copy = Path(self._copy.name) / 'whole.db3'
            if size + logged > shutil.disk_usage(copy.parent).free // 2:
                raise RecordingError(f'{self.path}: cannot be read where it is: its last messages are in {log.name}, '
                                     'and SQLite has to write beside that; copy both files to a folder that can be '
                                     'written, or let TMPDIR name one with room for them' if sealed else
                                     f'{self.path}: was cut off, and TMPDIR has no room for a copy of what is whole')
            if logged:
                shutil.copyfile(log, _log_of(copy))
            stream.seek(0)
            with copy.open('wb') as whole:
                shutil.copyfileobj(stream, whole)
                whole.truncate(size - left)
        if left:
            self.faults.append(f'{self.path.name} was cut off: its last {left} bytes are no whole page')
        return copy

    def messages(self, topics: Collection[str], start_ns: int, end_ns: int) -> Iterator[RawMessage]:
        """The sound messages of some topics within a half-open interval, by log time; see `faults` afterwards."""
        wanted = {number: channel for number, channel in self._topics.items()
                  if channel.topic in topics and not channel.left_out}
        rows = self._by_time() if self._rows is None else self._rescued(self._rows)
        try:
            for number, log_ns, data in rows:
                sound = isinstance(log_ns, int) and isinstance(data, bytes)
                if sound and number in wanted and start_ns <= log_ns < end_ns:
                    yield RawMessage(log_ns, wanted[number].topic, wanted[number].type_name, data)
        except _UNREADABLE as error:
            fault = f'{self.path.name} cannot be read to its end: {error}'
            self.faults += [fault] if fault not in self.faults else []

    def _by_time(self) -> Iterator[tuple[int, int, bytes]]:
        yield from self._database.execute('SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp')

    def _survey(self) -> None:
        """Find the topics and the span of time; look for damaged pages."""
        sound = self._is_sound()
        for table, columns in _COLUMNS.items():
            found = {str(row[1]) for row in self._database.execute(f'PRAGMA table_xinfo({table})') if not row[6]}
            kind = self._database.execute(
                "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND rootpage > 0 AND name = ?", (table,))
            if kind.fetchone() != (1,) or not columns <= found:
                raise RecordingError(f'{self.path}: cannot be read: is no database of rosbag2')
        self._rows = None if sound and self._is_indexed() else self._sound_rows()
        self._topics = self._read_topics()
        if self._rows is None:
            counts = dict(self._database.execute('SELECT topic_id, count(*) FROM messages GROUP BY topic_id'))
            first, last = self._database.execute(
                "SELECT min(timestamp), max(timestamp) FROM messages WHERE typeof(timestamp) = 'integer'").fetchone()
        else:
            counts = Counter(number for _, number, _ in self._rows)
            first, last = (self._rows[0][0], self._rows[-1][0]) if self._rows else (None, None)
            where = 'read without its index, which lacks some' if sound else 'on sound pages'
            self.faults.append(f'{self.path.name} is damaged: {len(self._rows)} messages are {where}')
            if not self._rows:
                raise RecordingError(f'{self.path}: cannot be read: its pages are damaged, and no message can be '
                                     'rescued')
        if sound:
            self._look_beyond()
        self.start_ns, self.end_ns = (0, -1) if first is None else (int(first), int(last))
        self.channels = [channel._replace(message_count=counts.get(number, 0))
                         for number, channel in self._topics.items()]

    def _look_beyond(self) -> None:
        """Say that bytes follow the database: SQLite does not look at them."""
        pages, page = (self._database.execute(f'PRAGMA {name}').fetchone()[0] for name in ('page_count', 'page_size'))
        with self._content.open('rb') as stream:
            end = stream.seek(pages * page)
            if any(any(block) for block in iter(lambda: stream.read(2**20), b'')):
                size = self._content.stat().st_size
                self.faults.append(f'{self.path.name}: {size - end} bytes after its end, at byte {end}, are not read: '
                                   'if they are another recording, split the file there')

    def _is_sound(self) -> bool:
        try:
            return bool(self._database.execute('PRAGMA quick_check(1)').fetchone() == ('ok',))
        except _UNREADABLE as error:
            if 'not a database' in str(error):
                raise
            self._database.execute('PRAGMA writable_schema = ON')  # opens what is shorter than its header says
            return False

    def _is_indexed(self) -> bool:
        """Whether the index, by which messages are read in the order of time, has all of them."""
        numbers = [self._database.execute(f'SELECT count(*) FROM (SELECT timestamp FROM messages {how})').fetchone()
                   for how in ('NOT INDEXED', 'ORDER BY timestamp')]
        return bool(numbers[0] == numbers[1])

    def _read_topics(self) -> dict[int, Channel]:
        definitions: dict[str, tuple[str, str]] = {}
        with suppress(*_UNREADABLE):  # databases older than Iron have no definitions
            for name, encoding, text in self._database.execute(
                    'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'):
                definitions[full_type_name(str(name))] = str(text), _ENCODINGS.get(str(encoding), '')
        rows = self._database.execute('SELECT id, name, type, serialization_format FROM topics').fetchall()
        topics: dict[int, Channel] = {}
        for number, name, type_name, form in rows:
            if isinstance(number, int):
                kind = full_type_name(str(type_name))
                definition, encoding = definitions.get(kind, ('', ''))
                topics[number] = Channel(str(name), kind, definition, encoding, 0, why_left_out(str(form or '')))
        return topics

    def _sound_rows(self) -> list[tuple[int, int, int]]:
        """Log time, topic and id of the messages that can be reached from either end of a damaged table."""
        found: set[tuple[int, int, int]] = set()
        for direction in ('ASC', 'DESC'):
            with suppress(*_UNREADABLE):
                for log_ns, number, row in self._database.execute(
                        f'SELECT timestamp, topic_id, id FROM messages NOT INDEXED ORDER BY id {direction}'):
                    if isinstance(log_ns, int) and isinstance(number, int):
                        found.add((log_ns, number, row))
        return sorted(found)

    def _rescued(self, rows: list[tuple[int, int, int]]) -> Iterator[tuple[int, int, bytes]]:
        for log_ns, number, row in rows:
            try:
                found = self._database.execute('SELECT data FROM messages WHERE id = ?', (row,)).fetchone()
            except _UNREADABLE:
                continue  # counted: fewer messages are found than announced
            if found is not None:
                yield number, log_ns, found[0]


def _text(content: bytes) -> str:
    """Damaged text is text all the same."""
    return content.decode(errors='replace')


def _log_of(path: Path) -> Path:
    return path.with_name(f'{path.name}-wal')


def _address(path: Path) -> str:
    """A database whose writer was interrupted may have its last messages in a log beside it."""
    log = _log_of(path)
    unfinished = log.exists() and log.stat().st_size > 0
    return f'file:{quote(str(path.absolute()))}?{"mode=ro" if unfinished else "immutable=1"}'
