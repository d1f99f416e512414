"""A result folder: all files of one run, together or not at all."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from polymap_ros.atomic import move_into_place, staging

POLYGON, STATE, MAP_IMAGE, MAP_YAML = 'polygon.json', 'state.npz', 'map.pgm', 'map.yaml'
PICTURE, SIGNALS, BEAM_MAP, RECORD = 'polygon.png', 'signals.png', 'beam_map.npz', 'result.mcap'
CALIBRATION = 'calibration.yaml'
EXPORTS = 'polygon.csv', 'polygon.geojson', 'polygon.dxf'
NAMES = (  # in the order in which they are moved into place
    STATE, MAP_IMAGE, MAP_YAML, PICTURE, SIGNALS, BEAM_MAP, RECORD, CALIBRATION, *EXPORTS, POLYGON)


@contextmanager
def result_folder(folder: Path) -> Iterator[Path]:
    """Collect result files in a temporary folder and move them into `folder` at the end of the block.

    An exception in the block leaves `folder` as it was. A new folder appears with all its files at once. Results of an
    earlier run are removed before those of this one are moved in, polygon.json last: where the process is killed
    meanwhile, some are missing, but none are of another run. Other files stay.

    Raises
    ------
    OSError
        Where `folder` cannot be written.
    """
    with staging(folder) as stage:
        files = stage / 'files'
        files.mkdir()
        yield files
        if not folder.exists():
            move_into_place(files, folder)
            return
        folder.mkdir(exist_ok=True)  # an error where it is a file
        for path in map(folder.joinpath, NAMES):
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        made = [name for name in NAMES if (files / name).exists()]
        for name in reversed(NAMES):
            if name not in made[:1]:  # which is replaced at once
                (folder / name).unlink(missing_ok=True)
        for name in made:
            move_into_place(files / name, folder / name)


def holds_foreign(folder: Path) -> list[str]:
    """Names of files in the way of results that are not those of an earlier run, which has a state or a polygon."""
    found = [name for name in NAMES if (folder / name).exists()]
    return [] if {STATE, POLYGON} & set(found) else found
