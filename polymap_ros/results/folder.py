"""A result folder: the answer first, then what accompanies it, each file whole or not at all."""

import errno
import shutil
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from polymap_ros.atomic import check_writable, move_into_place, staging, staging_inside
from polymap_ros.errors import OutputError, in_words

POLYGON, STATE, MAP_IMAGE, MAP_YAML = 'polygon.json', 'state.npz', 'map.pgm', 'map.yaml'
PICTURE, SIGNALS, BEAM_MAP, RECORD = 'polygon.png', 'signals.png', 'beam_map.npz', 'result.mcap'
CALIBRATION, REPORT, TRAJECTORY = 'calibration.yaml', 'report.html', 'trajectory.tum'
PULSE = 'pulse.npy'
EXPORTS = 'polygon.csv', 'polygon.geojson', 'polygon.dxf'
NAMES = (POLYGON, STATE, TRAJECTORY, MAP_IMAGE, MAP_YAML, PICTURE, SIGNALS, BEAM_MAP, RECORD, CALIBRATION, REPORT,
         PULSE, *EXPORTS)
"""Everything that a run may leave behind, so that the next one can take it away."""


@dataclass(frozen=True)
class Entry:
    """Files of a result folder that are written together.

    Parameters
    ----------
    names : tuple of str
        Each one of `NAMES`.
    write : callable
        Puts these files into the empty folder it is given; none where there is nothing to write.
    """

    names: tuple[str, ...]
    write: Callable[[Path], object]

    @classmethod
    def of(cls, name: str, content: Callable[[], bytes | None]) -> 'Entry':
        """A single file of the bytes that `content` returns; None: there is nothing to write."""
        def write(folder: Path) -> None:
            if (data := content()) is not None:
                (folder / name).write_bytes(data)

        return cls((name,), write)


@dataclass(frozen=True)
class Unwritten:
    """Files that could not be written, and why."""

    names: tuple[str, ...]
    cause: str

    def __str__(self) -> str:
        return self.within(Path())

    def within(self, folder: Path) -> str:
        """Return what is missing from a folder, by its path, and why."""
        return f'{" and ".join(str(folder / name) for name in self.names)}: not written: {self.cause}'


def write_results(folder: Path, answer: Sequence[Entry], accompaniments: Iterable[Entry]) -> list[Unwritten]:
    """Write the answer into `folder`, and once it is there what accompanies it, entry by entry.

    Results of an earlier run are removed before the answer is moved in, polygon.json last: wherever the process is
    killed, no files are of two runs, and where polygon.json is, the rest of the answer is, too. Other files stay. What
    of the answer had no room beside the earlier results is tried again in their place.

    Parameters
    ----------
    folder : Path
        Made where it is missing.
    answer : sequence of Entry
        The first one is needed, and nothing of an earlier run is touched before it could be written.
    accompaniments : iterable of Entry
        Whatever one of them raises costs only its own files.

    Returns
    -------
    list of Unwritten
        Entries that failed.

    Raises
    ------
    OutputError
        Where the first entry of the answer cannot be written, or an earlier result cannot be removed, which is known
        before anything is touched; `folder` is as the user gave it.
    """
    unwritten: list[Unwritten] = []
    try:
        with _stage_for(folder) as stage:
            failed: list[Unwritten] = []
            made = {entry.names: _made(entry, stage / str(number), failed) for number, entry in enumerate(answer)}
            _refuse_without(answer[0], folder, failed)
            _clear(folder, unwritten)
            without_room = {each.names for each in failed}  # there may be some now
            for number, entry in reversed(list(enumerate(answer))):
                again = entry.names in without_room
                files = _made(entry, stage / str(number), unwritten) if again else made[entry.names]
                _place(entry, files, folder, unwritten)
            _refuse_without(answer[0], folder, unwritten)
            for number, entry in enumerate(accompaniments, start=len(answer)):
                _place(entry, _made(entry, stage / str(number), unwritten), folder, unwritten)
    except OSError as error:
        raise OutputError(folder, in_words(error, folder.parent)) from error
    return unwritten


def _stage_for(folder: Path) -> AbstractContextManager[Path]:
    """Inside an existing folder, which may be a file system of its own, or all that may be written to."""
    return staging_inside(folder) if folder.is_dir() else staging(folder)


def _made(entry: Entry, stage: Path, unwritten: list[Unwritten]) -> list[Path]:
    """The files of an entry, in a folder made for them; none where it fails, which is noted."""
    try:
        stage.mkdir()
        entry.write(stage)
    except Exception as error:  # of a library, or a fault of ours: it costs these files
        unwritten.append(Unwritten(entry.names, in_words(error, stage)))
        shutil.rmtree(stage, ignore_errors=True)  # half a file may take the room of a whole one
        return []
    return [path for path in map(stage.joinpath, entry.names) if path.exists()]


def _clear(folder: Path, unwritten: list[Unwritten]) -> None:
    """Remove the results of an earlier run: all of them, or none and `OutputError`, as far as can be known before."""
    folder.mkdir(exist_ok=True)
    _check_removable(folder)
    for name in NAMES:
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            if name == POLYGON:  # the first; nothing is touched yet
                raise _in_the_way(folder / name, error) from error
            unwritten.append(Unwritten((name,), f'one of an earlier run cannot be removed: {in_words(error, folder)}'))


def _place(entry: Entry, files: Sequence[Path], folder: Path, unwritten: list[Unwritten]) -> None:
    try:
        for path in files:
            move_into_place(path, folder / path.name)
    except OSError as error:
        unwritten.append(Unwritten(entry.names, in_words(error, folder)))


def _refuse_without(entry: Entry, folder: Path, unwritten: Sequence[Unwritten]) -> None:
    for each in unwritten:
        if set(each.names) & set(entry.names):
            raise OutputError(folder, each.cause)


def check_folder(folder: Path) -> None:
    """Raise `OutputError` where results could not be written into `folder`, as far as can be known before."""
    check_writable(folder, files=len((POLYGON, STATE, TRAJECTORY)))
    for path in map(folder.joinpath, NAMES):
        if path.is_dir():
            raise OutputError(path, 'it is a folder; move it away')
    _check_removable(folder)


def _check_removable(folder: Path) -> None:
    """Raise `OutputError` for a result of an earlier run that may not be removed, such as another user's.

    `rmdir` removes no file, and says first that it may not, before it says that this is no folder.
    """
    for path in map(folder.joinpath, NAMES):
        if not path.is_file():
            continue
        try:
            path.rmdir()
        except OSError as error:
            if error.errno in (errno.EPERM, errno.EACCES, errno.EROFS):
                raise _in_the_way(path, error) from error


def _in_the_way(path: Path, error: OSError) -> OutputError:
    return OutputError(path, f'it is of an earlier run, and cannot be removed: {error.strerror}; let its owner do that')


def holds_foreign(folder: Path) -> list[str]:
    """Names of files in the way of results that are not those of an earlier run, which has a state or a polygon."""
    found = [name for name in NAMES if (folder / name).exists()]
    return [] if {STATE, POLYGON} & set(found) else found
