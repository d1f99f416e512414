"""From the files of a recording to what can be read of them: unpacked where need be, the sound ones of several."""

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.decompression import unpack_file
from polymap_ros.recordings.layout import Layout, are_one_recording
from polymap_ros.recordings.mcap_file import McapFile
from polymap_ros.recordings.metadata import NAME, Metadata
from polymap_ros.recordings.sniff import PACKED, kind_of, refusal
from polymap_ros.recordings.sqlite_file import SqliteFile
from polymap_ros.recordings.storage import StoredFile

_DEEPEST = 3
"""A file may be compressed this often: by rosbag2, and again by who kept it."""


class Parts(NamedTuple):
    """The open files of a recording, what metadata.yaml says if it is of them, what is lost, and what is odd."""

    files: list[StoredFile]
    metadata: Metadata | None
    faults: list[str]
    remarks: list[str]


def open_parts(path: Path, layout: Layout, stack: ExitStack) -> Parts:
    """Open every part; `stack` closes them, and takes what was unpacked away.

    Raises
    ------
    RecordingError
        Where none can be read.
    """
    files: list[StoredFile] = []
    failures: list[RecordingError] = []
    for part in layout.parts:
        try:
            files += _soundest(part, stack)
        except RecordingError as error:
            failures.append(error)
    if not files:
        raise failures[0]
    faults = [*layout.faults, *map(str, failures)]
    files, copies = _without_copies(files)
    return _of_one_time(path, layout, Parts(files, layout.metadata, faults, [*layout.remarks, *copies]))


def _without_copies(files: list[StoredFile]) -> tuple[list[StoredFile], list[str]]:
    """Leave out copies, whole ones or cut off: files of the same topics that begin at the same time as another one."""
    alike: dict[object, list[StoredFile]] = {}
    for file in files:
        topics = frozenset(channel.topic for channel in file.channels if channel.message_count)
        alike.setdefault((file.start_ns, topics) if file.start_ns < file.end_ns else file.path, []).append(file)
    most = {id(file): max(same, key=_message_count) for same in alike.values() for file in same}
    copies = [(file.path.name, most[id(file)].path.name) for file in files if most[id(file)] is not file]
    return ([file for file in files if most[id(file)] is file],
            [f'left out: {name}, a copy of {other}' if name != other else
             f'left out of {name}: a recording that was appended and is a copy of another one in it'
             for name, other in copies])


def _message_count(file: StoredFile) -> int:
    return sum(channel.message_count for channel in file.channels)


def _soundest(part: list[Path], stack: ExitStack) -> list[StoredFile]:
    """What the first file without a fault holds, or else the first that can be read."""
    found: list[list[StoredFile]] = []
    failures: list[RecordingError] = []
    for path in part:
        try:
            found.append(_opened(path, stack))
        except RecordingError as error:
            failures.append(error)
            continue
        if not any(file.faults for file in found[-1]):
            return found[-1]
    if not found:
        raise failures[0]
    return found[0]


def _opened(path: Path, stack: ExitStack) -> list[StoredFile]:
    """A file by its content, which is what comes out where it is compressed; the user's path names it."""
    content, faults = path, list[str]()
    try:
        for _ in range(_DEEPEST):
            kind = kind_of(content)
            if kind not in PACKED:
                break
            target = Path(stack.enter_context(TemporaryDirectory(prefix='polymap-'))) / 'content'
            fault = unpack_file(path, kind, target, content)
            faults += [fault] if fault else []
            content = target
        if kind not in ('mcap', 'sqlite3'):
            raise RecordingError(f'{path}: cannot be read: {refusal(content, kind, path)}')
        files = _appended(path, content, stack) if kind == 'mcap' else [_kept(SqliteFile(path, content), stack)]
    except OSError as error:
        raise RecordingError(f'{path}: cannot be read: {error.strerror or error}') from error
    except RecordingError as error:
        raise RecordingError('; '.join([str(error), *faults])) from error
    files[0].faults[:0] = faults
    return files


def _appended(path: Path, content: Path, stack: ExitStack) -> list[StoredFile]:
    """The MCAP file, and those that were appended to it, as by ``cat``."""
    files: list[StoredFile] = []
    begin: int | None = 0
    while begin is not None:
        try:
            file = McapFile(path, content, begin)
        except RecordingError as error:
            if not files:
                raise
            files[-1].faults.append(f'what follows from byte {begin} on is not read: {error}')
            break
        files.append(_kept(file, stack))
        begin = file.next
    return files


def _kept(file: StoredFile, stack: ExitStack) -> StoredFile:
    stack.callback(file.close)
    return file


def _of_one_time(path: Path, layout: Layout, parts: Parts) -> Parts:
    """Without files of another recording than metadata.yaml is of, or else without that."""
    files, metadata, faults, remarks = parts
    filled = [file for file in files if file.start_ns <= file.end_ns]
    if metadata is None or not filled:
        return parts
    if not any(metadata.overlaps(file.start_ns, file.end_ns) for file in filled):
        if not are_one_recording(file.path for file in files):
            raise RecordingError(f'{path}: {NAME} is of another recording; name the file itself: '
                                 f'{", ".join(file.path.name for file in files)}')
        return Parts(files, None, faults, [f'{NAME} is of another recording: it announces another time than is found, '
                                           'and is not used'])
    foreign = [file for file in filled
               if file.path in layout.strays and not metadata.overlaps(file.start_ns, file.end_ns)]
    if foreign:
        names = ', '.join(file.path.name for file in foreign)
        remarks.append(f'left out: {names}, recorded at another time than {NAME} announces')
    return Parts([file for file in files if file not in foreign], metadata, faults, remarks)
