"""What metadata.yaml says of a recording: believed where only it can tell, and no further than the files agree."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from polymap_ros.plain_yaml import read_yaml
from polymap_ros.recordings.storage import full_type_name

NAME = 'metadata.yaml'
_NEWEST, _MOST_BYTES = 9, 2**20
_AROUND_NS = 10**9
"""Files begin and end this close to what is announced."""


@dataclass(frozen=True)
class Metadata:
    """What rosbag2 wrote about a recording.

    Parameters
    ----------
    names : list of str
        Files, in the order in which they were written, by paths that need not be below the recording's folder.
    announced : dict of str to (str, int)
        Type and number of messages of each topic.
    digests : dict of str to str
        Hashes of the types' definitions.
    span_ns : tuple of int or None
        Log time of the first and the last message [ns].
    compression : str
        Such as ``zstd``; empty for none.
    faults : list of str
        What is odd about it.
    """

    names: list[str]
    announced: dict[str, tuple[str, int]] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    span_ns: tuple[int, int] | None = None
    compression: str = ''
    faults: list[str] = field(default_factory=list)

    def overlaps(self, start_ns: int, end_ns: int) -> bool:
        """Whether messages of this time may be of the recording; those of any may where no time is announced."""
        if self.span_ns is None:
            return True
        return start_ns <= self.span_ns[1] + _AROUND_NS and self.span_ns[0] - _AROUND_NS <= end_ns


def read_metadata(folder: Path) -> tuple[Metadata | None, str]:
    """Return what metadata.yaml says, or None and why that is not known."""
    file = folder / NAME
    if not file.is_file():
        return None, f'holds no {NAME}'
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise ValueError(f'{file.stat().st_size} bytes, {_MOST_BYTES} are allowed')
        content = read_yaml(file.read_text(encoding='utf-8'))
        if not content:
            raise ValueError('it is empty')
        return _parsed(content['rosbag2_bagfile_information']), ''
    except (TypeError, AttributeError):
        return None, f'has a {NAME} that cannot be read (its entries are not laid out as rosbag2 does)'
    except (OSError, yaml.YAMLError, ValueError, KeyError) as error:
        reason = f'missing {error}' if isinstance(error, KeyError) else str(error)
        return None, f'has a {NAME} that cannot be read ({" ".join(reason.split())})'


def _parsed(content: Any) -> Metadata:
    version = int(content['version'])
    announced: dict[str, tuple[str, int]] = {}
    digests: dict[str, str] = {}
    for each in content['topics_with_message_count']:
        topic, number = each['topic_metadata'], int(each['message_count'])
        type_name = full_type_name(str(topic['type']))
        before = announced.get(str(topic['name']), ('', 0))[1]
        announced[str(topic['name'])] = type_name, before + max(number, 0)
        digests[type_name] = str(topic.get('type_description_hash') or '')
    names = [str(name) for name in content['relative_file_paths']]
    packed = str(content.get('compression_mode') or '').lower() not in ('', 'none')
    return Metadata(
        list(dict.fromkeys(names)), announced, digests, _span(content),
        str(content.get('compression_format') or '') if packed else '',
        [f'{NAME} has version {version}, of which only what is as up to {_NEWEST} is understood']
        if version > _NEWEST else [])


def _span(content: Any) -> tuple[int, int] | None:
    if not isinstance(content.get('starting_time'), dict) or not isinstance(content.get('duration'), dict):
        return None
    start_ns = int(content['starting_time']['nanoseconds_since_epoch'])
    return start_ns, start_ns + int(content['duration']['nanoseconds'])
