"""Reading rosbag2 directories and bare .mcap and .db3 files, without ROS."""

import heapq
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

from polymap_ros.errors import RecordingError
from polymap_ros.mapping.estimate import Caution
from polymap_ros.messages.fields import Field
from polymap_ros.recordings.decompression import message_of_zstd, unpack_file
from polymap_ros.recordings.definitions import Definitions
from polymap_ros.recordings.layout import Layout, layout_of
from polymap_ros.recordings.mcap_file import McapFile
from polymap_ros.recordings.sqlite_file import SqliteFile
from polymap_ros.recordings.storage import MOST_NS, StoredFile

_FOREVER_S = 1e9
"""Beyond any recording, and still within the 64 bits that log times have."""

Reader: TypeAlias = Callable[[bytes], Any]


class Topic(NamedTuple):
    """What a recording says it holds of one topic."""

    type_name: str
    message_count: int


class Entry(NamedTuple):
    """One recorded message, as a dataclass of rosbags or what a reader made of it."""

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

    def __init__(self, path: Path, layout: Layout, files: Sequence[StoredFile], faults: Sequence[str] = ()) -> None:
        self.path = path
        self._files, self._compression = files, layout.compression
        channels = [channel for file in files for channel in file.channels]
        self._definitions = Definitions(channels, layout.digests)
        self._faults = [*layout.faults, *faults, *self._definitions.faults]
        self.topics = _topics(layout, files)
        filled = [file for file in files if file.start_ns <= file.end_ns]
        self.start_ns = min((file.start_ns for file in filled), default=0)
        self.end_ns = max((file.end_ns for file in filled), default=0)
        self.damaged: Counter[str] = Counter()
        self._seen: Counter[str] = Counter()

    @classmethod
    @contextmanager
    def open(cls, path: Path) -> Iterator['Recording']:
        """Open a rosbag2 directory or a bare file and close it at the end of the ``with`` block.

        What is damaged or missing is left out and told by `cautions`.

        Raises
        ------
        RecordingError
            Where there is nothing, or nothing that can be read.
        """
        layout = layout_of(path)
        with ExitStack() as stack:
            files: list[StoredFile] = []
            failures: list[RecordingError] = []
            for file in layout.files:
                try:
                    if layout.compression == 'file':
                        folder = Path(stack.enter_context(TemporaryDirectory(prefix='polymap-')))
                        file = unpack_file(file, folder)
                    files.append(_opened(file))
                    stack.callback(files[-1].close)
                except RecordingError as error:
                    failures.append(error)
                except OSError as error:
                    failures.append(RecordingError(f'{file}: cannot be read: {error.strerror or error}'))
            if not files:
                raise failures[0]
            yield cls(path, layout, files, [str(failure) for failure in failures])

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
        if foreign := sorted(self._definitions.foreign.intersection(self._definitions.closure(type_name))):
            raise RecordingError(f'{self.path}: topic {found} cannot be read: the recording defines {foreign[0]} '
                                 'otherwise than ROS 2 does, or its definition is damaged')
        return found

    def fields_of(self, type_name: str) -> dict[str, Field]:
        """What a type holds, by field, as the recording defines it.

        Raises
        ------
        RecordingError
            Where it does not.
        """
        definitions = self._definitions.store.fielddefs
        if type_name not in definitions:
            raise RecordingError(f'{self.path}: holds no definition of {type_name}')
        return {name: _field(description) for name, description in definitions[type_name][1]}

    def messages(
        self, topics: Collection[str] | None = None, start_s: float | None = None, end_s: float | None = None,
        readers: Mapping[str, Reader] = MappingProxyType({}),
    ) -> Iterator[Entry]:
        """Read messages in the order of their log time; those that cannot be decoded are counted in `damaged`.

        Parameters
        ----------
        topics : collection of str, optional
            Recorded names; all topics where not given.
        start_s, end_s : float, optional
            Half-open interval of log time after the recording's first message [s].
        readers : mapping of str to callable
            By topic, what makes something quickly of a message's bytes; where that is None, they are decoded.

        Raises
        ------
        RecordingError
            Where a file cannot be read any longer, or its chunks are out of order.
        """
        wanted = self.topics.keys() if topics is None else topics
        start_ns, end_ns = self._log_time(start_s, -MOST_NS), self._log_time(end_s, MOST_NS)
        self._seen.clear()
        self.damaged.clear()
        streams = [file.messages(wanted, start_ns, end_ns) for file in self._files]
        ordered = streams[0] if len(streams) == 1 else heapq.merge(*streams, key=lambda message: message.log_ns)
        decode = self._definitions.store.deserialize_cdr
        for log_ns, topic, type_name, data in ordered:
            self._seen[topic] += 1
            try:
                content = message_of_zstd(data) if self._compression == 'message' else data
                message = readers[topic](content) if topic in readers else None
                if message is None:
                    message = decode(content, type_name)
            except Exception:  # any parser error on damaged bytes; counted and reported by `cautions`
                self.damaged[topic] += 1
                continue
            yield Entry(topic, type_name, message, log_ns)

    def _log_time(self, offset_s: float | None, without: int) -> int:
        return without if offset_s is None else self.start_ns + round(min(offset_s, _FOREVER_S) * 1e9)

    def cautions(self, topics: Collection[str], complete: bool = True) -> list[Caution]:
        """Say what is damaged, and what a pass of `messages` over `topics` found otherwise than announced.

        Parameters
        ----------
        topics : collection of str
            As given to `messages`.
        complete : bool
            Whether the pass had no limits of time; only then the numbers are compared.
        """
        faults = [*self._faults, *(fault for file in self._files for fault in file.faults)]
        found = [Caution('recording_damaged', _some(faults))] if faults else []
        for topic in topics:
            expected, seen, damaged = self.topics[topic].message_count, self._seen[topic], self.damaged[topic]
            if complete and seen != expected:
                text = f'{topic}: {seen} messages found where the recording announces {expected}'
                found.append(Caution('recording_incomplete', text))
            if damaged:
                text = f'{topic}: {damaged} of {seen} messages cannot be decoded'
                found.append(Caution('recording_damaged', text))
        return found


def _opened(path: Path) -> StoredFile:
    """A file of a recording, by its suffix."""
    return McapFile(path) if path.suffix == '.mcap' else SqliteFile(path)


def _some(faults: Sequence[str], at_most: int = 5) -> str:
    more = [f'{len(faults) - at_most} more of this kind'] if len(faults) > at_most else []
    return '; '.join([*faults[:at_most], *more])


def _field(description: Any) -> Field:
    """A field as rosbags describes it: a kind of node, and what it is made of."""
    from rosbags.interfaces import Nodetype

    node, detail = description
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return Field(_field(detail[0]).element, is_array=True)
    element = str(detail if node == Nodetype.NAME else detail[0])
    return Field('uint8' if element in ('octet', 'byte', 'char') else element)


def _topics(layout: Layout, files: Sequence[StoredFile]) -> dict[str, Topic]:
    """Type and number of messages by topic: what metadata.yaml announces, and without it the files."""
    topics: dict[str, Topic] = {}
    for channel in (channel for file in files for channel in file.channels):
        type_name, count = topics.get(channel.topic, Topic(channel.type_name, 0))
        if channel.type_name not in type_name.split(' and '):
            type_name = f'{type_name} and {channel.type_name}'
        topics[channel.topic] = Topic(type_name, count + channel.message_count)
    for name, (type_name, count) in layout.announced.items():
        topics[name] = topics.get(name, Topic(type_name, 0))._replace(message_count=count)
    return dict(sorted(topics.items()))
