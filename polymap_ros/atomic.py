"""Files that appear whole or not at all: written beside their place first, then renamed."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def staging(target: Path) -> Iterator[Path]:
    """Give a temporary folder beside `target`, on the same file system; it is removed at the end in any case.

    The folder that is to hold `target` is made where it is missing.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    stage = Path(tempfile.mkdtemp(prefix=f'.{target.name}-', dir=target.parent))
    try:
        yield stage
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def move_into_place(source: Path, target: Path) -> None:
    """Rename `source` to `target` once its bytes are on the disk; an existing file is replaced."""
    for path in [source, *source.rglob('*')]:
        _sync(path)
    source.replace(target)
    _sync(target.parent)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
