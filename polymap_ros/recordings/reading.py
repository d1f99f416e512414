"""Reading rosbag2 directories and bare .mcap and .db3 files, without ROS."""

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from polymap_ros.errors import PolymapError, RecordingError
from polymap_ros.mapping.estimate import Caution
from polymap_ros.messages.fields import Field

_MCAP_MAGIC = b'\x89MCAP0\r\n'
"""First and last bytes of an MCAP file."""

_FOREVER_S = 1e9
"""Beyond any recording, and still within the 64 bits that log times have."""


class Topic(NamedTuple):
    """What a recording says it holds of one topic."""

    type_name: str
    message_count: int


class Entry(NamedTuple):
    """One recorded message, as a dataclass of rosbags."""

    topic: str
    type_name: str
    message: Any
    log_ns: int


class Recording:
    """An open recording; made by `Recording.open`.

    Attributes
    ----------
    path : Path
        Where it was read from.
    topics : dict[str, Topic]
        Type and number of messages by topic, as the recording's own index or metadata.yaml has it.
    start_ns, end_ns : int
        Log time of the first and the last message [ns]; 0 where there is none.
    damaged : Counter[str]
        Messages by topic that `messages` met and could not decode.
    """

    def __init__(self, path: Path, reader: Any) -> None:
        self.path = path
        self._reader = reader
        self.topics = _topics(reader.connections)
        filled = reader.message_count > 0
        self.start_ns = int(reader.start_time) if filled else 0
        self.end_ns = int(reader.end_time) - 1 if filled else 0
        self.damaged: Counter[str] = Counter()
        self._seen: Counter[str] = Counter()

    @classmethod
    @contextmanager
    def open(cls, path: Path) -> Iterator['Recording']:
        """Open a rosbag2 directory or a bare file and close it at the end of the ``with`` block.

        Raises
        ------
        RecordingError
            Where there is nothing, or nothing that can be read.
        """
        if not path.exists():
            raise RecordingError(f'{path}: no such recording')
        if path.is_dir() and not (path / 'metadata.yaml').exists():
            files = sorted(file.name for file in path.iterdir() if file.suffix in ('.mcap', '.db3'))
            remedy = f'name the file itself: {", ".join(files)}' if files else 'it is not a rosbag2 directory'
            raise RecordingError(f'{path}: holds no metadata.yaml; {remedy}')
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        with _blaming(path):
            reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            reader.open()
        try:
            yield cls(path, reader)
        finally:
            reader.close()

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message [s]."""
        return (self.end_ns - self.start_ns) * 1e-9

    def require(self, name: str, type_name: str, parameter: str) -> str:
        """Return the recorded name of topic `name`, which has to be of `type_name` and to hold messages.

        Parameters
        ----------
        name : str
            With or without the leading slash.
        type_name : str
            Such as ``nav_msgs/msg/Odometry``.
        parameter : str
            The parameter that names the topic, for the message.

        Raises
        ------
        RecordingError
            Names the topics of that type.
        """
        found = next((topic for topic in self.topics if topic.lstrip('/') == name.lstrip('/')), None)
        filled = {topic: info for topic, info in self.topics.items() if info.message_count}
        alike = [topic for topic, info in filled.items() if info.type_name == type_name and topic != found]
        if alike:
            advice = f'topics of type {type_name}: {", ".join(alike)} (choose with -p {parameter}:={alike[0]})'
        else:
            all_topics = ', '.join(f'{topic} ({info.type_name})' for topic, info in self.topics.items())
            advice = f'no other topic is of type {type_name}; recorded: {all_topics or "nothing"}'
        if found is None:
            raise RecordingError(f'{self.path}: no topic /{name.lstrip("/")}; {advice}')
        if self.topics[found].type_name != type_name:
            raise RecordingError(
                f'{self.path}: topic {found} is of type {self.topics[found].type_name}, not {type_name}; {advice}'
            )
        if not self.topics[found].message_count:
            raise RecordingError(f'{self.path}: topic {found} is empty; {advice}')
        return found

    def fields_of(self, type_name: str) -> dict[str, Field]:
        """What a type holds, by field, as the recording defines it.

        Raises
        ------
        RecordingError
            Where it does not.
        """
        definitions = self._reader.typestore.fielddefs
        if type_name not in definitions:
            raise RecordingError(f'{self.path}: holds no definition of {type_name}')
        return {name: _field(description) for name, description in definitions[type_name][1]}

    def messages(
        self, topics: Collection[str] | None = None, start_s: float | None = None, end_s: float | None = None
    ) -> Iterator[Entry]:
        """Read messages in the order of their log time; those that cannot be decoded are counted in `damaged`.

        Parameters
        ----------
        topics : collection of str, optional
            Recorded names; all topics where not given.
        start_s, end_s : float, optional
            Half-open interval of log time after the recording's first message [s].

        Raises
        ------
        RecordingError
            Where the file ends early or its checksums fail.
        """
        connections = [each for each in self._reader.connections if topics is None or each.topic in topics]
        if not connections:
            return
        start_ns, end_ns = self._log_time(start_s), self._log_time(end_s)
        self._seen.clear()
        self.damaged.clear()
        raw_messages = self._reader.messages(connections, start_ns, end_ns)
        while True:
            with _blaming(self.path):
                item = next(raw_messages, None)
            if item is None:
                return
            connection, log_ns, raw = item
            self._seen[connection.topic] += 1
            try:
                message = self._reader.deserialize(raw, connection.msgtype)
            except Exception:  # any parser error on damaged bytes; counted and reported by `cautions`
                self.damaged[connection.topic] += 1
                continue
            yield Entry(connection.topic, connection.msgtype, message, log_ns)

    def _log_time(self, offset_s: float | None) -> int | None:
        return None if offset_s is None else self.start_ns + round(min(offset_s, _FOREVER_S) * 1e9)

    def cautions(self, topics: Collection[str]) -> list[Caution]:
        """Say what a complete pass of `messages` over `topics` did not find although the recording promised it."""
        found = []
        for topic in topics:
            expected, seen, damaged = self.topics[topic].message_count, self._seen[topic], self.damaged[topic]
            if seen < expected:
                text = f'{topic}: {seen} messages found where the recording announces {expected}'
                found.append(Caution('recording_incomplete', text))
            if damaged:
                text = f'{topic}: {damaged} of {seen} messages cannot be decoded'
                found.append(Caution('recording_damaged', text))
        return found


def _field(description: Any) -> Field:
    """A field as rosbags describes it: a kind of node, and what it is made of."""
    from rosbags.interfaces import Nodetype

    node, detail = description
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return Field(_field(detail[0]).element, is_array=True)
    element = str(detail if node == Nodetype.NAME else detail[0])
    return Field('uint8' if element in ('octet', 'byte', 'char') else element)


def _topics(connections: Any) -> dict[str, Topic]:
    topics: dict[str, Topic] = {}
    for connection in connections:
        type_name, count = topics.get(connection.topic, Topic(connection.msgtype, 0))
        if connection.msgtype not in type_name.split(' and '):
            type_name = f'{type_name} and {connection.msgtype}'
        topics[connection.topic] = Topic(type_name, count + connection.msgcount)
    return dict(sorted(topics.items()))


@contextmanager
def _blaming(path: Path) -> Iterator[None]:
    """Turn whatever a parser raises into a `RecordingError`: on damaged bytes that can be any exception."""
    from rosbags.highlevel import AnyReaderError

    try:
        yield
    except PolymapError:
        raise
    except (AnyReaderError, OSError) as error:
        raise RecordingError(f'{path}: cannot be read: {_broken_mcap(path) or " ".join(str(error).split())}') from error
    except Exception as error:
        detail = f'{type(error).__name__}: {" ".join(str(error).split())}'
        raise RecordingError(f'{path}: is damaged and cannot be read ({detail})') from error


def _broken_mcap(path: Path) -> str:
    """What is wrong with an MCAP file of the recording, and what to do; empty where that is not it."""
    with suppress(OSError):
        for file in [path] if path.is_file() else sorted(path.iterdir()):
            content = file.stat().st_size if file.suffix == '.mcap' else 0
            if content == 0:
                continue
            with file.open('rb') as stream:
                begins = stream.read(len(_MCAP_MAGIC)) == _MCAP_MAGIC
                stream.seek(max(content - len(_MCAP_MAGIC), 0))
                ends = stream.read() == _MCAP_MAGIC
            if not begins:
                return f'{file.name} is no MCAP file'
            if not ends:
                return (f'{file.name} has no end: it was cut off, or is still being written; stop the recorder, or '
                        'rescue what is there with `mcap recover`')
    return ''
