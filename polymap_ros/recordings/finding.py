"""Where recordings are, and what they are called."""

import os
from pathlib import Path

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.layout import layout_of, part_name
from polymap_ros.recordings.metadata import NAME

_LEVELS = 2
"""How deep recordings are looked for, such as in a folder for each day."""


def recording_name(path: Path) -> str:
    """Return what a recording is called: the name of its folder, or of its file without what tells how it is stored."""
    folder = path.parent if path.name == NAME else path
    return part_name(os.path.basename(os.path.abspath(folder)))  # noqa: PTH100, PTH119, with no ..


def collection(path: Path) -> list[Path]:
    """Return the recordings in a folder that is none itself; none for a recording, or where there are none."""
    if not path.is_dir() or (path / NAME).is_file():
        return []
    found = _below(path, _LEVELS)
    is_one = _is_recording(path) and all(each.parent == path for each in found)  # whose parts they are
    return [] if is_one else found


def _below(folder: Path, levels: int) -> list[Path]:
    found = []
    try:
        children = sorted(path for path in folder.iterdir() if not path.name.startswith('.'))
    except OSError:
        return []
    for path in children:
        if _is_recording(path):
            found.append(path)
        elif levels > 1 and path.is_dir():
            found += _below(path, levels - 1)
    return found


def _is_recording(path: Path) -> bool:
    """Whether there is a recording, as far as can be told without reading it."""
    try:
        layout_of(path)
    except (RecordingError, OSError):
        return False
    return True
