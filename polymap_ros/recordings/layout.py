"""What a path holds: the files of a recording, and what its metadata.yaml says of them."""

import re
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from polymap_ros.errors import RecordingError
from polymap_ros.plain_yaml import read_yaml

SUFFIXES = ('.mcap', '.db3')
_NEWEST, _MOST_BYTES = 9, 2**20
_PART = re.compile(r'(.*)_\d+')


@dataclass(frozen=True)
class Layout:
    """The files of a recording, in the order in which they were written.

    Parameters
    ----------
    files : list of Path
        Those that are there.
    announced : dict of str to (str, int)
        Type and number of messages of each topic, as metadata.yaml has it; empty without one.
    digests : dict of str to str
        Hashes of the types' definitions, as metadata.yaml has them.
    compression : str
        ``file`` or ``message`` where rosbag2 compressed one or the other.
    faults : list of str
        What is missing.
    """

    files: list[Path]
    announced: dict[str, tuple[str, int]] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    compression: str = ''
    faults: list[str] = field(default_factory=list)


def layout_of(path: Path) -> Layout:
    """Find the files of a rosbag2 directory, or of a bare file.

    Raises
    ------
    RecordingError
        Where there is nothing, or nothing that is a recording.
    """
    if not path.exists():
        raise RecordingError(f'{path}: no such recording')
    if not path.is_dir():
        if not path.is_file() or path.suffix not in SUFFIXES:
            raise RecordingError(f'{path}: cannot be read: a recording is a rosbag2 directory, or a file whose name '
                                 f'ends in {" or ".join(SUFFIXES)}')
        return Layout([path])
    if not (path / 'metadata.yaml').is_file():
        return _without_metadata(path, 'holds no metadata.yaml')
    try:
        return _by_metadata(path, _read(path / 'metadata.yaml'))
    except (OSError, yaml.YAMLError, ValueError, TypeError, KeyError, AttributeError) as error:
        reason = f'missing {error}' if isinstance(error, KeyError) else str(error)
        return _without_metadata(path, f'has a metadata.yaml that cannot be read ({" ".join(reason.split())})')


def _without_metadata(path: Path, problem: str) -> Layout:
    """The parts of one recording, such as a power cut leaves them; other files may be of different recordings."""
    files = sorted((file for file in path.iterdir() if file.suffix in SUFFIXES and file.is_file()), key=_number)
    if not files:
        raise RecordingError(f'{path}: {problem}; it is not a rosbag2 directory')
    names = {match[1] if (match := _PART.fullmatch(file.stem)) else file.stem for file in files}
    if len(names) > 1 or len({file.suffix for file in files}) > 1:
        raise RecordingError(f'{path}: {problem}; name the file itself: {", ".join(file.name for file in files)}')
    return Layout(files, faults=[f'{path.name} {problem}: what is missing cannot be told'])


def _number(file: Path) -> tuple[int, str]:
    digits = re.search(r'_(\d+)$', file.stem)
    return int(digits[1]) if digits else 0, file.name


def _read(file: Path) -> Any:
    if file.stat().st_size > _MOST_BYTES:
        raise ValueError(f'{file.stat().st_size} bytes, {_MOST_BYTES} are allowed')
    return read_yaml(file.read_text(encoding='utf-8'))['rosbag2_bagfile_information']


def _by_metadata(path: Path, metadata: Any) -> Layout:
    if int(metadata['version']) > _NEWEST:
        raise RecordingError(f'{path}: metadata.yaml has version {metadata["version"]}; allowed: up to {_NEWEST}')
    # Only the names count: old versions wrote the folder before them, and no other folder is any of our business.
    names = [PurePosixPath(str(name)).name for name in metadata['relative_file_paths']]
    missing = [name for name in names if not name or not (path / name).is_file()]
    if len(missing) == len(names):
        raise RecordingError(f'{path}: cannot be read: all files that metadata.yaml names are missing: '
                             f'{", ".join(missing) or "none"}')
    compression = str(metadata.get('compression_mode') or '').lower()
    if compression not in ('', 'none') and metadata.get('compression_format') != 'zstd':
        raise RecordingError(f'{path}: compression format {metadata.get("compression_format")!r} is not supported; '
                             'allowed: zstd')
    announced: dict[str, tuple[str, int]] = {}
    digests: dict[str, str] = {}
    for each in metadata['topics_with_message_count']:
        topic, number = each['topic_metadata'], int(each['message_count'])
        before = announced.get(str(topic['name']), ('', 0))[1]
        announced[str(topic['name'])] = str(topic['type']), before + max(number, 0)
        digests[str(topic['type'])] = str(topic.get('type_description_hash') or '')
    return Layout([path / name for name in names if name not in missing], announced, digests,
                  '' if compression == 'none' else compression,
                  [f'{path.name}: the part {name} is missing' for name in missing])
