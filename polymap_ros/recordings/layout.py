"""Which files of a folder are the parts of one recording: by their content, and by their names."""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.metadata import NAME, Metadata, read_metadata
from polymap_ros.recordings.sniff import PACKED, READABLE, kind_of, refusal
from polymap_ros.results.folder import POLYGON, RECORD

_SUFFIXES = ('.mcap', '.db3')
_PACKED_SUFFIXES = ('.zstd', '.zst', '.lz4', '.gz')
_PART = re.compile(r'(.*)_(\d+)')


@dataclass(frozen=True)
class Layout:
    """The parts of a recording, in the order in which they were written.

    Parameters
    ----------
    parts : list of list of Path
        Of each part the files that may hold it, such as a compressed and an unpacked one; the first that is sound does.
    metadata : Metadata or None
        What metadata.yaml says, where there is one.
    strays : frozenset of Path
        Files that metadata.yaml does not name, and which are parts if their time is that of the recording.
    faults : list of str
        What is missing.
    remarks : list of str
        Where names and metadata.yaml disagree with what is there, which costs nothing.
    """

    parts: list[list[Path]]
    metadata: Metadata | None = None
    strays: frozenset[Path] = frozenset()
    faults: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def files(self) -> list[Path]:
        """All that may be read."""
        return [file for part in self.parts for file in part]


def layout_of(path: Path) -> Layout:
    """Find the files of a rosbag2 directory, or of a bare file.

    Raises
    ------
    RecordingError
        Where there is nothing, or nothing that is a recording.
    """
    if not path.exists():
        where = f': is a link to {path.readlink()}, which is not there' if path.is_symlink() else ''
        raise RecordingError(f'{path}: no such recording{where}')
    if path.name == NAME and path.is_file():
        path = path.parent
    if path.is_dir():
        return _of_folder(path)
    try:
        kind = kind_of(path)
        if kind in (*READABLE, *PACKED):
            return Layout([[path]])
        raise RecordingError(f'{path}: cannot be read: {refusal(path, kind)}')
    except OSError as error:
        raise RecordingError(f'{path}: cannot be read: {error.strerror or error}') from error


def _of_folder(path: Path) -> Layout:
    metadata, problem = read_metadata(path)
    try:
        names = list(dict.fromkeys(_name_inside(path, name) for name in metadata.names)) if metadata else []
        folders = dict.fromkeys([path, *((path / name).parent for name in names if '/' in name)])
        found = [file for folder in folders for file in sorted(folder.iterdir()) if _may_be_data(file)]
        kinds = {file: _kind(file, {path / name for name in names}) for file in found}
    except OSError as error:
        raise RecordingError(f'{path}: cannot be read: {error.strerror or error}') from error
    called = [file for file in kinds if _is_called_data(file)]
    # By their content alone only where no name tells: other programs have databases and archives, too.
    files = called or [file for file, kind in kinds.items() if kind in (*READABLE, *PACKED)]
    plain = {file for file in files if kinds[file] in READABLE}
    if metadata is not None:
        metadata = replace(metadata, names=names)
        named = [path / name for name in names if path / name in kinds]
        if files or named:
            return _by_metadata(path, metadata, sorted({*files, *named}, key=lambda file: (file not in plain, file)))
        problem = f'all files that metadata.yaml names are missing: {", ".join(names) or "none"}'
    if not files:
        raise RecordingError(f'{path}: {problem}{_found_instead(path, kinds)}')
    return _without_metadata(path, problem, sorted(files, key=lambda file: (file not in plain, file)))


def _name_inside(path: Path, name: str) -> str:
    """Return where metadata.yaml says that a file is, below the folder: in the folder itself, unless it is elsewhere.

    Old versions of rosbag2 wrote the folder before the name; no folder outside is any of our business.
    """
    *folders, last = [part for part in re.split(r'[/\\]', name) if part not in ('', '.')] or ['']
    inside = path.joinpath(*folders)
    if '..' in folders or not inside.is_dir() or not inside.resolve().is_relative_to(path.resolve()):
        return last
    there = any(part_name(file.name) == part_name(last) for file in inside.iterdir() if _may_be_data(file))
    return '/'.join([*folders, last]) if there else last


def _kind(file: Path, named: Collection[Path]) -> str:
    """The kind of a file; one that may not be read, and that nothing says is part of the recording, is none."""
    try:
        return kind_of(file)
    except OSError as error:
        if file in named or _is_called_data(file):
            raise RecordingError(f'{file}: cannot be read: {error.strerror or error}') from error
        return 'unknown'


def _may_be_data(file: Path) -> bool:
    """Neither hidden, nor the log of a database, nor a result of a replay, which may lie in the same folder."""
    return (file.is_file() and not file.name.startswith('.') and file.name not in (NAME, RECORD)
            and not file.name.endswith(('-wal', '-shm', '-journal')))


def _is_called_data(file: Path) -> bool:
    return _unpacked_name(file.name).endswith(_SUFFIXES)


def _unpacked_name(name: str) -> str:
    while name.endswith(_PACKED_SUFFIXES):
        name = name[:name.rindex('.')]
    return name


def part_name(name: str) -> str:
    """Return the name of a file without what says how it is stored: ``run_0`` of ``run_0.mcap.zstd``."""
    name = _unpacked_name(name)
    return name[:name.rindex('.')] if name.endswith(_SUFFIXES) else name


def _found_instead(path: Path, kinds: dict[Path, str]) -> str:
    """What a folder without a recording holds."""
    for file in sorted(path.iterdir()):
        if file.name.startswith('.') and file.is_file() and kind_of(file) in (*READABLE, *PACKED):
            return (f'; {file.name} is hidden, as rsync leaves what it has not copied to the end: copy the recording '
                    'again, or name that file itself')
    if (path / POLYGON).is_file():
        return f'; it holds results of polymap_ros ({POLYGON}), not a recording'
    for file, kind in kinds.items():
        if kind != 'unknown' or file.suffix == '.bag':
            return f', and {file.name} {refusal(file, kind).removeprefix("the file ")}'
    inside = [each.name for each in sorted(path.iterdir()) if (each / NAME).is_file()]
    if inside:
        return f'; it is not a rosbag2 directory, but holds some: name {", ".join(inside[:5])}' + (
            f' or one of {len(inside) - 5} more' if len(inside) > 5 else '')
    return '; it is not a rosbag2 directory'


def _without_metadata(path: Path, problem: str, files: Sequence[Path]) -> Layout:
    """The parts of one recording, such as a power cut leaves them; other files may be of different recordings."""
    parts = _grouped(path, files)
    if len({_recording(part) for part in parts}) > 1:
        names = ', '.join(sorted(file.name for file in files))
        raise RecordingError(f'{path}: {problem}; name the file itself: {names}')
    faults = [f'{path.name}: the part {name} is missing' for name in _between(list(parts))]
    return Layout(list(parts.values()), faults=faults,
                  remarks=[f'{path.name} {problem}: what {"else " if faults else ""}is missing cannot be told'])


def _between(parts: Sequence[str]) -> list[str]:
    """The parts whose numbers are left out; none where most would be, as where the numbers are dates."""
    found = [match for part in parts if (match := _PART.fullmatch(part))]
    numbers = {int(match[2]) for match in found}
    if not numbers or max(numbers) - min(numbers) >= 2 * len(numbers):
        return []
    return [f'{found[0][1]}_{number:0{len(found[0][2])}d}' for number in range(min(numbers), max(numbers))
            if number not in numbers]


def _grouped(path: Path, files: Iterable[Path]) -> dict[str, list[Path]]:
    """The files that may hold each part, by its name, in the order of their numbers."""
    parts: dict[str, list[Path]] = {}
    for file in files:
        parts.setdefault(part_name(_within(path, file)), []).append(file)
    return dict(sorted(parts.items(), key=lambda part: (_number(part[0]), part[0])))


def _within(path: Path, file: Path) -> str:
    """The name of a file as metadata.yaml has it."""
    return file.relative_to(path).as_posix()


def _number(part: str) -> int:
    match = _PART.fullmatch(part)
    return int(match[2]) if match else 0


def _recording(part: str) -> str:
    match = _PART.fullmatch(part)
    return match[1] if match else part


def _by_metadata(path: Path, metadata: Metadata, files: Sequence[Path]) -> Layout:
    """The files that are named, as they are or under the same name otherwise stored; where some are missing, others."""
    there = _grouped(path, files)
    parts, missing, others = [], [], []
    for name in dict.fromkeys(map(part_name, metadata.names)):
        whole = [each for each in metadata.names if part_name(each) == name]
        if name not in there:
            missing += whole
            continue
        part = sorted(there.pop(name), key=lambda file: _within(path, file) not in whole)
        first = _within(path, part[0])
        others += [f'{first} in the place of {whole[0]}'] if first not in whole else []
        parts.append(part)
    strays = list(there.values()) if missing or not parts else []
    remarks = [f'read is {", ".join(others)}, which {NAME} names'] if others else []
    faults = [f'{path.name}: the part {name} is missing' for name in missing]
    if strays:
        names = f'{", ".join(missing)}, which is not there' if missing else 'no file'
        text = f'{NAME} names {names}; read instead: {", ".join(_within(path, part[0]) for part in strays)}'
        (faults, remarks) = ([], [*remarks, text]) if len(strays) >= len(missing) else ([text], remarks)
    elif there:
        left = ', '.join(_within(path, file) for part in there.values() for file in part)
        remarks.append(f'left out: {left}, which {NAME} does not name')
    return Layout([*parts, *strays], metadata, frozenset(file for part in strays for file in part), faults,
                  [*metadata.faults, *remarks])


def are_one_recording(files: Iterable[Path]) -> bool:
    """Whether the names are those of the parts of one recording."""
    return len({_recording(part_name(file.name)) for file in files}) == 1
