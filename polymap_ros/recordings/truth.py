"""The ground truth that `polymap_simulate` leaves beside a recording."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import RecordingError
from polymap_ros.plain_yaml import read_small

TRUTH_NAME, PATH_NAME = 'truth.json', 'truth.tum'


def truth_path(recording: Path) -> Path:
    """Where a recording's truth is: inside a rosbag2 directory, next to a bare file."""
    return (recording if recording.is_dir() else recording.parent) / TRUTH_NAME


def read_truth(recording: Path) -> NDArray[np.float64] | None:
    """Corners of the true polygon, counter-clockwise, shape (n, 2) [m] in the odometry's frame; None if not known.

    Raises
    ------
    RecordingError
        For a truth.json that is not ``{"vertices": [[x, y], ...]}`` with at least three corners.
    """
    path = truth_path(recording)
    if not path.is_file():
        return None
    try:
        vertices = np.array(json.loads(read_small(path))['vertices'], dtype=float)
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise RecordingError(f'{path}: is no ground truth: allowed: {{"vertices": [[x, y], ...]}}') from error
    if vertices.ndim != 2 or vertices.shape[0] < 3 or vertices.shape[1] != 2 or not np.isfinite(vertices).all():
        raise RecordingError(f'{path}: vertices of shape {vertices.shape}; allowed: at least three finite [x, y]')
    x, y = vertices.T
    clockwise = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0.0
    return vertices[::-1] if clockwise else vertices


def read_true_path(recording: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Return stamps (n,) [ns] and poses (n, 3) of truth.tum; None where there is none.

    Raises
    ------
    RecordingError
        For a file whose lines are not eight numbers each, with stamps that increase.
    """
    path = truth_path(recording).with_name(PATH_NAME)
    if not path.is_file():
        return None
    try:
        rows = [line.split() for line in read_small(path).splitlines() if line.strip() and not line.startswith('#')]
        stamps = np.array([_nanoseconds(row[0]) for row in rows], np.int64)
        numbers = np.array([[float(word) for word in row[1:]] for row in rows]).reshape(len(rows), -1)
    except (OSError, UnicodeDecodeError, ValueError, OverflowError) as error:
        raise RecordingError(f'{path}: is no path in the TUM format: allowed: lines of a stamp and seven '
                             'numbers') from error
    if len(rows) and (numbers.shape[1] != 7 or not np.isfinite(numbers).all() or np.any(np.diff(stamps) <= 0)):
        raise RecordingError(f'{path}: allowed: lines of a stamp, which increases, and seven finite numbers')
    if not len(rows):
        return None
    return stamps, np.column_stack((numbers[:, 0], numbers[:, 1], 2.0 * np.arctan2(numbers[:, 5], numbers[:, 6])))


def _nanoseconds(text: str) -> int:
    """Return a stamp in seconds as a whole number of nanoseconds, none of which a double would keep."""
    seconds, _, rest = text.partition('.')
    return int(seconds) * 10**9 + int(rest[:9].ljust(9, '0') or '0')
