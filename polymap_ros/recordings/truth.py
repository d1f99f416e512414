"""The ground truth that `polymap_simulate` leaves beside a recording."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import RecordingError
from polymap_ros.geometry.pose import Pose
from polymap_ros.plain_yaml import read_small

TRUTH_NAME, PATH_NAME = 'truth.json', 'truth.tum'


@dataclass(frozen=True, eq=False)
class TrueInside:
    """What stands inside a true polygon.

    Parameters
    ----------
    holes : tuple of ndarray, shape (n, 2)
        Corners of each hole, clockwise [m].
    inner_walls : tuple of ndarray, shape (2, 2)
        Ends of each inner wall [m].
    circles : tuple of ndarray, shape (3,)
        Centre and radius of each round hole [m].
    """

    holes: tuple[NDArray[np.float64], ...] = ()
    inner_walls: tuple[NDArray[np.float64], ...] = ()
    circles: tuple[NDArray[np.float64], ...] = ()

    def moved(self, frame: Pose) -> 'TrueInside':
        """The same, seen from the frame in which `frame` is its own origin."""
        return TrueInside(tuple(map(frame.apply, self.holes)), tuple(map(frame.apply, self.inner_walls)),
                          tuple(np.append(frame.apply(circle[:2]), circle[2]) for circle in self.circles))


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
    return _ring(_document(path), path)


def read_true_inside(recording: Path) -> TrueInside:
    """Holes and inner walls of the true polygon, none where truth.json has none.

    Raises
    ------
    RecordingError
        For holes that are not ``[{"vertices": [[x, y], ...]}]``, or ``[{"centre": [x, y], "radius_m": r}]``, or inner
        walls not ``[{"start": [x, y], "end": [x, y]}]``.
    """
    path = truth_path(recording)
    if not path.is_file():
        return TrueInside()
    document = _document(path)
    holes, walls = (document.get(key, []) for key in ('holes', 'inner_walls'))
    if not (isinstance(holes, list) and isinstance(walls, list)):
        raise RecordingError(f'{path}: allowed: lists of holes and of inner_walls')
    is_round = [isinstance(hole, dict) and 'radius_m' in hole for hole in holes]
    return TrueInside(tuple(_ring(hole, path)[::-1] for hole, bent in zip(holes, is_round, strict=True) if not bent),
                      tuple(_places(wall, ('start', 'end'), path) for wall in walls),
                      tuple(_circle(hole, path) for hole, bent in zip(holes, is_round, strict=True) if bent))


def _circle(body: dict[str, Any], path: Path) -> NDArray[np.float64]:
    """Centre and radius (3,)."""
    try:
        circle = np.array([*body['centre'], body['radius_m']], dtype=float)
        if circle.shape != (3,) or not np.isfinite(circle).all():
            raise ValueError
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f'{path}: a round hole: allowed: {{"centre": [x, y], "radius_m": r}}') from error
    return circle


def _document(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(read_small(path))
        if not isinstance(document, dict):
            raise TypeError
    except (OSError, UnicodeDecodeError, ValueError, TypeError, RecursionError) as error:
        raise RecordingError(f'{path}: is no ground truth: allowed: {{"vertices": [[x, y], ...]}}') from error
    return document


def _ring(body: Any, path: Path) -> NDArray[np.float64]:
    """Corners (n, 2), counter-clockwise."""
    try:
        vertices = np.array(body['vertices'], dtype=float)
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise RecordingError(f'{path}: is no ground truth: allowed: {{"vertices": [[x, y], ...]}}') from error
    if vertices.ndim != 2 or vertices.shape[0] < 3 or vertices.shape[1] != 2 or not np.isfinite(vertices).all():
        raise RecordingError(f'{path}: vertices of shape {vertices.shape}; allowed: at least three finite [x, y]')
    x, y = vertices.T
    clockwise = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0.0
    return vertices[::-1] if clockwise else vertices


def _places(body: Any, keys: tuple[str, str], path: Path) -> NDArray[np.float64]:
    try:
        places = np.array([body[key] for key in keys], dtype=float)
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise RecordingError(f'{path}: an inner wall needs {" and ".join(keys)}, each [x, y]') from error
    if places.shape != (2, 2) or not np.isfinite(places).all():
        raise RecordingError(f'{path}: an inner wall needs {" and ".join(keys)}, each a finite [x, y]')
    return places


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
