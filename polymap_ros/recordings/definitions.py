"""What the types of a recording hold: as the recording defines it, and as ROS does where it does not."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from polymap_ros.recordings.storage import Channel

_MOST_CHARACTERS = 2**18
"""A definition, with all that it refers to, is shorter."""


class Definitions:
    """The message types of a recording.

    Parameters
    ----------
    channels : sequence of Channel
        With the definitions that the recording carries.
    digests : mapping of str to str
        Hashes that the definitions should have (REP 2016), as far as known.

    Attributes
    ----------
    store : rosbags' Typestore
        Decodes messages.
    faults : list of str
        Definitions that cannot be used.
    remarks : list of str
        Hashes that are not those of definitions which are sound.
    """

    def __init__(self, channels: Sequence[Channel], digests: Mapping[str, str]) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.faults: list[str] = []
        self.remarks: list[str] = []
        self.store = get_typestore(Stores.ROS2_JAZZY)
        known = self.store.fielddefs
        recorded: dict[str, Any] = {}
        for channel in {channel.type_name: channel for channel in channels if channel.definition}.values():
            recorded |= self._parsed(channel)
        self.foreign = {name for name in recorded.keys() & known.keys() if recorded[name][1] != known[name][1]}
        sound = recorded.keys() & known.keys() - self.foreign
        if self.foreign:
            self.store = get_typestore(Stores.EMPTY)
            recorded = {**known, **recorded}
        else:
            recorded = {name: recorded[name] for name in recorded.keys() - known.keys()}
        try:
            self.store.register(recorded)
        except Exception as error:  # any parser error on damaged text
            self.faults.append(f'the definitions of its messages contradict each other: {" ".join(str(error).split())}')
        for name, digest in digests.items():
            if not digest or name not in self.store.fielddefs or self._digest(name) == digest:
                continue
            if name in sound and not self.foreign:
                self.remarks.append(f'metadata.yaml has another hash of {name} than its definition has')
            else:
                self.faults.append(f'the definition of {name} is not the one that was recorded')
                self.foreign.add(name)

    def closure(self, type_name: str) -> Iterator[str]:
        """A type, and those it is made of."""
        waiting, seen = [type_name], set[str]()
        while waiting:
            name = waiting.pop()
            if name not in seen and name in self.store.fielddefs:
                seen.add(name)
                yield name
                waiting += [part for _, description in self.store.fielddefs[name][1] for part in _parts(description)]

    def _digest(self, name: str) -> str:
        try:
            return str(self.store.hash_rihs01(name))
        except Exception as error:  # such as types that contain themselves
            return f'{type(error).__name__}: {error}'

    def _parsed(self, channel: Channel) -> dict[str, Any]:
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

        try:
            if len(channel.definition) > _MOST_CHARACTERS:
                raise ValueError(f'{len(channel.definition)} characters, {_MOST_CHARACTERS} are allowed')
            if channel.encoding == 'msg':
                return dict(get_types_from_msg(channel.definition, channel.type_name))
            separator = '=' * 80 + '\nIDL: '
            texts = [text.partition('\n')[2] for text in channel.definition.split(separator)[1:]]
            found: dict[str, Any] = {}
            for text in texts or [channel.definition]:
                found |= get_types_from_idl(text)
            return found
        except Exception as error:  # any parser error on damaged text
            self.faults.append(f'the definition of {channel.type_name} cannot be read: '
                               f'{" ".join(str(error).split())[:200]}')
            return {}


def _parts(description: Any) -> Iterator[str]:
    from rosbags.interfaces import Nodetype

    node, detail = description
    if node == Nodetype.NAME:
        yield str(detail)
    elif node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        yield from _parts(detail[0])
