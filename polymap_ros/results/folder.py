"""A result folder: all files of one run, together or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from polymap_ros.atomic import move_into_place, staging

POLYGON, STATE, MAP_IMAGE, MAP_YAML = 'polygon.json', 'state.npz', 'map.pgm', 'map.yaml'
PICTURE, SIGNALS, BEAM_MAP, RECORD = 'polygon.png', 'signals.png', 'beam_map.npz', 'result.mcap'
CALIBRATION = 'calibration.yaml'
EXPORTS = 'polygon.csv', 'polygon.geojson', 'polygon.dxf'
NAMES = (STATE, MAP_IMAGE, MAP_YAML, PICTURE, SIGNALS, BEAM_MAP, RECORD, CALIBRATION, *EXPORTS, POLYGON)


@contextmanager
def result_folder(folder: Path) -> Iterator[Path]:
    """Collect result files in a temporary folder and move them into `folder` at the end of the block.

    An exception in the block leaves `folder` as it was. Results of an earlier run in `folder` are replaced, and
    those the new run does not have are removed; other files stay. polygon.json comes last.

    Raises
    ------
    OSError
        Where `folder` cannot be written.
    """
    with staging(folder) as stage:
        yield stage
        folder.mkdir(exist_ok=True)
        made = {path.name for path in stage.iterdir()}
        for name in NAMES:
            if name not in made:
                (folder / name).unlink(missing_ok=True)
        for name in sorted(made, key=lambda name: name == POLYGON):
            move_into_place(stage / name, folder / name)
