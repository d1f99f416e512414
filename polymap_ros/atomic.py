"""Files that appear whole or not at all: written beside their place first, then renamed."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path


@contextmanager
def staging(target: Path) -> Iterator[Path]:
    """Give a temporary folder beside `target`, on the same file system; it is removed at the end in any case.

    The folder that is to hold `target` is made where it is missing. Temporary folders of processes that were killed
    are removed; those of processes that live are known by a lock, which ends with its process however that ends.
    """
    prefix = f'.{target.name}.polymap-'
    target.parent.mkdir(parents=True, exist_ok=True)
    for left in target.parent.glob(f'{escape(prefix)}*'):
        _clear(left)
    stage, lock = _locked_folder(target.parent, prefix)
    try:
        yield stage
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def move_into_place(source: Path, target: Path) -> None:
    """Rename `source` to `target` once its bytes are on the disk; an existing file is replaced."""
    for path in [source, *source.rglob('*')]:
        _sync(path)
    source.replace(target)
    _sync(target.parent)


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
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
