"""What one file of a recording gives, whichever format it has."""

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

MOST_BYTES = 2**28
"""A message or a chunk of a recording may have this many: 256 MiB, a hundred times what recorders write."""

MOST_NS = 2**63
"""Log times are below this: they are 64 bits with a sign in rosbag2."""


def full_type_name(name: str) -> str:
    """Return a type's name as ROS 2 writes it: ``nav_msgs/Odometry`` and ``nav_msgs::msg::dds_::Odometry_``, too."""
    parts = re.split(r'/|::', name.strip())
    if len(parts) == 4 and parts[2] == 'dds_':
        parts = [*parts[:2], parts[3].removesuffix('_')]
    return '/'.join([parts[0], 'msg', parts[1]] if len(parts) == 2 else parts)


def why_left_out(serialization: str) -> str:
    """Say why messages of a serialization format are not read; empty where they are."""
    return '' if serialization.lower() in ('cdr', '') else f'serialized as {serialization!r}; allowed: cdr'


class Channel(NamedTuple):
    """What a file says of one topic: its type, the definition of that, and how many messages it should hold.

    `left_out` is why its messages are not read; empty where they are.
    """

    topic: str
    type_name: str
    definition: str
    encoding: str
    message_count: int
    left_out: str = ''


class RawMessage(NamedTuple):
    """A message as it was recorded."""

    log_ns: int
    topic: str
    type_name: str
    data: bytes


class StoredFile(Protocol):
    """An open file of a recording, damaged or not.

    Attributes
    ----------
    path : Path
        The file.
    channels : list of Channel
        Its topics.
    start_ns, end_ns : int
        Log time of the first and the last message [ns]; start_ns > end_ns where there is none.
    faults : list of str
        What is known to be damaged or missing; grows while messages are read.
    """

    path: Path
    channels: list[Channel]
    start_ns: int
    end_ns: int
    faults: list[str]

    def messages(self, topics: Collection[str], start_ns: int, end_ns: int) -> Iterator[RawMessage]:
        """The sound messages of some topics within a half-open interval, by log time."""

    def close(self) -> None:
        """Close the file."""
