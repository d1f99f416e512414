"""What one file of a recording gives, whichever format it has."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

MOST_BYTES = 2**28
"""A message or a chunk of a recording may have this many: 256 MiB, a hundred times what recorders write."""

MOST_NS = 2**63
"""Log times are below this: they are 64 bits with a sign in rosbag2."""


class Channel(NamedTuple):
    """What a file says of one topic: its type, the definition of that, and how many messages it should hold."""

    topic: str
    type_name: str
    definition: str
    encoding: str
    message_count: int


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
