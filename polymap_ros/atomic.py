"""Files that appear whole or not at all: written beside their place first, then renamed."""

import errno
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from glob import escape
from pathlib import Path

from polymap_ros.errors import OutputError, in_words

_UNSUPPORTED = frozenset((
    errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EBADF, errno.EACCES, errno.EPERM, errno.EISDIR))
"""How file systems say that they do not sync this: shares, FUSE, and folders that may not be read."""
_NO_RENAME = frozenset((
    errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EEXIST, errno.EACCES, errno.EPERM, errno.EXDEV))
"""How file systems say that they do not rename this, or not over a file that is there."""
_PROBE_BYTES = 4096
"""Enough to need a block of the disk."""
_NAME_LENGTH = 40
"""So much of a name is in the temporary one, which may have no more than 255 bytes, four a letter."""


def staging(target: Path) -> AbstractContextManager[Path]:
    """Give a temporary folder beside `target`, on the same file system; it is removed at the end in any case.

    The folder that is to hold `target` is made where it is missing. Temporary folders of processes that were killed
    are removed; those of processes that live are known by a lock, which ends with its process however that ends.
    """
    return _staging(target.parent, f'.{target.name[:_NAME_LENGTH]}.polymap-')


def staging_inside(folder: Path) -> AbstractContextManager[Path]:
    """Give a temporary folder as `staging` does, in a folder that is there."""
    return _staging(folder, '.polymap-')


@contextmanager
def _staging(parent: Path, prefix: str) -> Iterator[Path]:
    parent.mkdir(parents=True, exist_ok=True)
    for left in parent.glob(f'{escape(prefix)}*'):
        _clear(left)
    stage, lock = _locked_folder(parent, prefix)
    try:
        yield stage
    finally:
        try:
            shutil.rmtree(stage, ignore_errors=True)
        except BaseException:  # a signal that ends the process, in the middle of it
            shutil.rmtree(stage, ignore_errors=True)
            raise
        finally:
            if lock is not None:
                os.close(lock)


def move_into_place(source: Path, target: Path) -> None:
    """Rename `source` to `target` once its bytes are on the disk; an existing file is replaced.

    Where the file system does not rename, the bytes are copied.
    """
    for path in [source, *source.rglob('*')]:
        _sync(path)
    try:
        source.replace(target)
    except OSError as error:
        if error.errno not in _NO_RENAME or (source.is_dir() and target.exists()):
            raise
        _copy(source, target)
    _sync(target.parent)


def _copy(source: Path, target: Path) -> None:
    """Copy a file or a folder; where that fails, no part of it is left."""
    if source.is_dir():
        target.mkdir()  # an error where it is there
    try:
        if source.is_dir():
            for path in source.iterdir():
                _copy(path, target / path.name)
        else:
            target.unlink(missing_ok=True)
            shutil.copyfile(source, target)
        _sync(target)
    except BaseException:
        with suppress(OSError):
            shutil.rmtree(target) if target.is_dir() else target.unlink()
        raise


def check_writable(folder: Path, target: Path | None = None, files: int = 1) -> None:
    """Raise `OutputError` unless files can be written into `folder`, or where that is missing, it can be made.

    The error names `target`, such as the file that is to be written there; by default the folder. A folder for each
    of `files` is tried, too, and for `folder`: a disk may have room for bytes, and for no more files.
    """
    target, there = target or folder, folder
    try:
        while not _exists(there):
            if there.is_symlink():
                raise OutputError(target, f'{there} is a link to {there.readlink()}, which is missing')
            there = there.parent
        if not there.is_dir():
            raise OutputError(target, f'{"it" if there == target else there} is a file')
        with staging_inside(there) as stage:
            for number in range(files):
                probe = stage / str(number) / 'probe'
                probe.parent.mkdir()
                probe.write_bytes(bytes(_PROBE_BYTES))
                _sync(probe)
            for missing in range(len(folder.parts) - len(there.parts)):
                (stage / f'missing-{missing}').mkdir()
    except (OSError, ValueError) as error:  # a name with a zero byte
        cause = in_words(error, there) if isinstance(error, OSError) else str(error)
        raise OutputError(target, cause) from error


def _exists(path: Path) -> bool:
    """Whether something is there; `Path.exists` says no where the name is too long, or it may not be looked for."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def _locked_folder(parent: Path, prefix: str) -> tuple[Path, int | None]:
    """A new folder and its lock; again where another process cleared it away before it was locked."""
    while True:
        stage = Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
        lock = _lock(stage, fcntl.LOCK_EX)
        if stage.exists():
            return stage, lock
        if lock is not None:
            os.close(lock)


def _clear(stage: Path) -> None:
    """Remove a temporary folder unless a process has it locked; where there are no locks, it stays."""
    lock = _lock(stage, fcntl.LOCK_EX | fcntl.LOCK_NB)
    if lock is not None:
        shutil.rmtree(stage, ignore_errors=True)
        os.close(lock)


def _lock(folder: Path, how: int) -> int | None:
    """An open descriptor that holds the folder's lock; None where it is held, cannot be had, or is no folder."""
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, how)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _sync(path: Path) -> None:
    """Wait until the bytes are on the disk, where the file system can tell."""
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except PermissionError:  # of a folder that may be written but not read
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
    finally:
        os.close(descriptor)
