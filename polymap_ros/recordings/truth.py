"""The ground truth that `polymap_simulate` leaves beside a recording."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import RecordingError
from polymap_ros.plain_yaml import read_small

TRUTH_NAME = 'truth.json'


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
        raise RecordingError(f'{path}: is no ground truth ({type(error).__name__}: {error})') from error
    if vertices.ndim != 2 or vertices.shape[0] < 3 or vertices.shape[1] != 2 or not np.isfinite(vertices).all():
        raise RecordingError(f'{path}: vertices of shape {vertices.shape}; allowed: at least three finite [x, y]')
    x, y = vertices.T
    clockwise = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0.0
    return vertices[::-1] if clockwise else vertices
