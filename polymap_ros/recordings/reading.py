"""Reading rosbag2 directories and bare MCAP and SQLite files, without ROS."""

import heapq
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

from polymap_ros.cautions import Caution
from polymap_ros.echo_parameters import A_SCAN_TYPES
from polymap_ros.errors import RecordingError
from polymap_ros.messages.fields import Field
from polymap_ros.recordings.decompression import plain_message
from polymap_ros.recordings.definitions import Definitions
from polymap_ros.recordings.layout import layout_of
from polymap_ros.recordings.metadata import NAME, Metadata
from polymap_ros.recordings.opening import Parts, open_parts
from polymap_ros.recordings.sniff import bytes_shown, kind_of_bytes
from polymap_ros.recordings.storage import MOST_NS, Channel

_FOREVER_S = 1e9
"""Beyond any recording, and still within the 64 bits that log times have."""

_CDR = b'\0\0', b'\0\1'
"""How plain CDR begins, big-endian and little-endian."""
_ENCAPSULATIONS = {
    **dict.fromkeys((2, 3), 'CDR with a parameter list'), **dict.fromkeys(range(6, 12), 'CDR of version 2 (XCDR2)')}
"""Other encodings of DDS, by the second byte of a message."""
_FROM_ROS_1 = '; convert the .bag that it was made from: rosbags-convert --src NAME.bag --dst NAME'
_COMPRESSIONS = 'gzip', 'bzip2', 'xz', 'zip'

Reader: TypeAlias = Callable[[bytes], Any]


class Topic(NamedTuple):
    """What a recording says it holds of one topic."""

    type_name: str
    message_count: int


class Message(NamedTuple):
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
    left_out : dict[str, str]
        Topics whose messages are not read, or not all of them, and why.
    damaged : Counter[str]
        Messages by topic that `messages` met and could not decode.
    """

    def __init__(self, path: Path, parts: Parts) -> None:
        self.path = path
        self._files, self._metadata = parts.files, parts.metadata or Metadata([])
        channels = [channel for file in parts.files for channel in file.channels]
        read = [channel for channel in channels if not channel.left_out]
        self._definitions = Definitions(read, self._metadata.digests)
        self._faults = [*parts.faults, *self._definitions.faults]
        self._remarks = [*parts.remarks, *self._definitions.remarks]
        self.left_out = {channel.topic: f'{channel.type_name or "of no type"} {channel.left_out}'
                         for channel in channels if channel.left_out}
        self.topics = _topics(self._metadata, read, self.left_out)
        filled = [file for file in parts.files if file.start_ns <= file.end_ns]
        self.start_ns = min((file.start_ns for file in filled), default=0)
        self.end_ns = max((file.end_ns for file in filled), default=0)
        self.damaged: Counter[str] = Counter()
        self._seen: Counter[str] = Counter()
        self._first_damaged: dict[str, bytes] = {}

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
            yield cls(path, open_parts(path, layout, stack))

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message [s]."""
        return (self.end_ns - self.start_ns) * 1e-9

    @property
    def faults(self) -> list[str]:
        """What is damaged, as far as it has been read."""
        return [*self._faults, *(fault for file in self._files for fault in file.faults)]

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
        found = self._recorded(name, self.topics)
        advice = self._advice(found, type_name, parameter)
        if found is None:
            unread = self._recorded(name, self.left_out)
            problem = f'no topic /{name.lstrip("/")}'
            if unread is not None:
                problem = f'topic {unread} cannot be read: it is {self.left_out[unread]}'
                problem += _FROM_ROS_1 if "'ros1'" in problem else ''
            raise RecordingError(f'{self.path}: {problem}; {advice}')
        if self.topics[found].type_name != type_name:
            kind = self.topics[found].type_name
            if parameter == 'topics.echo' and kind in A_SCAN_TYPES:
                advice = f'if these are the echoes, -p echo.type:={kind}; {advice}'
            raise RecordingError(f'{self.path}: topic {found} is of type {kind}, not {type_name}; {advice}')
        if not self.topics[found].message_count:
            raise RecordingError(f'{self.path}: topic {found} is empty; {advice}')
        if all(found != channel.topic for file in self._files for channel in file.channels):
            raise RecordingError(f'{self.path}: topic {found} is announced by {NAME}, but none of the files that are '
                                 'there holds it')
        if foreign := sorted(self._definitions.foreign.intersection(self._definitions.closure(type_name))):
            raise RecordingError(f'{self.path}: topic {found} cannot be read: the recording defines {foreign[0]} '
                                 'otherwise than ROS 2 does, or its definition is damaged')
        return found

    @staticmethod
    def _recorded(name: str, topics: Collection[str]) -> str | None:
        return next((topic for topic in topics if topic.lstrip('/') == name.lstrip('/')), None)

    def _advice(self, found: str | None, type_name: str, parameter: str) -> str:
        """Name what could be read in the place of topic `found`."""
        alike = [topic for topic, info in self.topics.items()
                 if info.message_count and info.type_name == type_name and topic != found]
        if alike:
            return f'topics of type {type_name}: {", ".join(alike)} (choose with -p {parameter}:={alike[0]})'
        held = [*(f'{topic} ({info.type_name})' for topic, info in self.topics.items()),
                *(f'{topic} (not read: {why})' for topic, why in self.left_out.items() if topic not in self.topics)]
        return f'no other topic is of type {type_name}; recorded: {", ".join(held) or "nothing"}'

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
    ) -> Iterator[Message]:
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
        self._first_damaged.clear()
        streams = [file.messages(wanted, start_ns, end_ns) for file in self._files]
        ordered = streams[0] if len(streams) == 1 else heapq.merge(*streams, key=lambda message: message.log_ns)
        decode = self._definitions.store.deserialize_cdr
        for log_ns, topic, type_name, data in ordered:
            self._seen[topic] += 1
            type_name = type_name or self.topics[topic].type_name
            content = data
            try:
                content = plain_message(data)
                if content[:2] not in _CDR:
                    raise ValueError('is no CDR')
                message = readers[topic](content) if topic in readers else None
                if message is None:
                    message = decode(content, type_name)
            except Exception:  # any parser error on damaged bytes; counted and reported by `cautions`
                self.damaged[topic] += 1
                self._first_damaged.setdefault(topic, content[:8])
                continue
            yield Message(topic, type_name, message, log_ns)

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
        faults = self.faults
        found = [Caution('recording_damaged', _some(faults))] if faults else []
        if self._remarks:
            found.append(Caution('recording_inconsistent', _some(self._remarks)))
        for topic in topics:
            expected, seen, damaged = self.topics[topic].message_count, self._seen[topic], self.damaged[topic]
            if complete and seen != expected:
                text = f'{topic}: {seen} messages found where the recording announces {expected}'
                found.append(Caution('recording_incomplete', text))
            if topic in self.left_out:
                text = f'{topic}: some messages are left out: {self.left_out[topic]}'
                found.append(Caution('recording_incomplete', text, 'record the topic as CDR alone'))
            if damaged:
                text = f'{topic}: {damaged} of {seen} messages {self.why(topic)}'
                remedy = 'record them as ROS 2 does by default' if self._form_of(topic) else ''
                found.append(Caution('recording_damaged', text, remedy))
        return found

    def why(self, topic: str) -> str:
        """Say why messages of a topic that `messages` met are in `damaged`."""
        head, packed = self._first_damaged.get(topic, b''), self._metadata.compression
        reason = 'cannot be decoded'
        if form := self._form_of(topic):
            return f'{reason}: {form}'
        if head[:1] != b'\0':
            reason += f': the first begins with {bytes_shown(head)}, CDR with a byte 00'
        if packed and packed != 'zstd':
            reason += f'; {NAME} says that they are compressed by {packed!r}; allowed: zstd, lz4'
        return reason

    def _form_of(self, topic: str) -> str:
        """What the first message that could not be decoded is; empty where that is not known."""
        head = self._first_damaged.get(topic, b'')
        if (kind := kind_of_bytes(head)) in _COMPRESSIONS:
            return f'they are compressed one by one with {kind}; allowed: zstd, lz4'
        if len(head) > 1 and head[0] == 0 and (name := _ENCAPSULATIONS.get(head[1])):
            return f'they are {name}, by their first bytes {head[:2].hex(" ")}; allowed: plain CDR, 00 00 or 00 01'
        return ''


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


def _topics(metadata: Metadata, channels: Sequence[Channel], left_out: Collection[str]) -> dict[str, Topic]:
    """Type and number of messages by topic: by the files, and the number that metadata.yaml announces."""
    topics: dict[str, Topic] = {}
    for channel in channels:
        name = channel.type_name or metadata.announced.get(channel.topic, ('',))[0]
        type_name, count = topics.get(channel.topic, Topic(name, 0))
        if name not in type_name.split(' and '):
            type_name = f'{type_name} and {name}'
        topics[channel.topic] = Topic(type_name, count + channel.message_count)
    for name, (type_name, count) in metadata.announced.items():
        if name not in left_out:
            topics[name] = topics.get(name, Topic(type_name, 0))._replace(message_count=count)
    return dict(sorted(topics.items()))
