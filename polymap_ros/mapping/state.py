"""A mapper's state as one flat table of arrays, and the check that it may be continued."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import BadPing, StateError
from polymap_ros.geometry.plane import Plane, SpatialPose
from polymap_ros.geometry.pose import FARTHEST_M, Pose
from polymap_ros.packing import whole_number
from polymap_ros.parameters import Parameters

VERSION, READ = 4, (3, 4)
"""What is written, and what is read: version 3 (0.1) knows neither mount nor way driven."""

MATTERING = ('medium.', 'pulse.', 'sensor.', 'grid.', 'front_end.', 'free_area.', 'echo.kind', 'echo.t0_s',
             'echo.blanking_m', 'odometry.plane', 'odometry.scale', 'odometry.yaw_drift_deg_m', 'slam.map_origin')
"""Parameters that what is kept depends on; the path of a pulse's file says nothing about its content. Those that a
state of an earlier version lacks had the values that are the defaults now."""

Part = dict[str, NDArray[np.generic]]


def packed(parameters: Parameters, parts: Mapping[str, Part]) -> Part:
    """The arrays of all parts as ``part.name``, with the version and the parameters that matter."""
    values = _mattering(parameters)
    flat = {f'{part}.{name}': array for part, arrays in parts.items() for name, array in arrays.items()}
    return {'version': np.array(VERSION), 'parameters': np.array([*values.items()], dtype=str), **flat}


def unpacked(parameters: Parameters, state: Mapping[str, NDArray[np.generic]]) -> dict[str, Part]:
    """Undo `packed`.

    Raises
    ------
    StateError
        If the version is unknown or a parameter that matters has changed.
    """
    if whole_number(state['version']) not in READ:
        raise StateError(f'the state has version {state["version"]}; allowed: {READ[0]} to {READ[-1]}')
    then, now = _mattering(Parameters()) | dict(state['parameters'].tolist()), _mattering(parameters)
    for name in sorted(then.keys() | now.keys()):
        if then.get(name) != now.get(name):
            raise StateError(f'the saved map was made with {name} {then.get(name)}, now it is {now.get(name)}: set it '
                             'as it was, or begin a new map without output.load_path')
    parts: dict[str, Part] = {}
    for key, array in state.items():
        part, _, name = key.partition('.')
        parts.setdefault(part, {})[name] = array
    return parts


@contextmanager
def damage_told() -> Iterator[None]:
    """Turn what a damaged state raises where it is taken over into a `StateError`."""
    try:
        yield
    except KeyError as error:
        raise StateError(f'the state holds no {error.args[0]}') from error
    except (BadPing, ValueError, TypeError, IndexError, OverflowError) as error:
        raise StateError(f'the state is damaged: {" ".join(str(error).split())}') from error


def packed_frame(frame_id: str, start: Pose | None, plane: Plane | None, origin: Pose | None = None) -> Part:
    """The odometry's frame, the mapping plane in it, the map frame in that, and the start frame in the map's."""
    planes = [(*plane.frame.position, *plane.frame.orientation, plane.level_m)] if plane else []
    return {'id': np.array(frame_id), 'start': _rows(start), 'origin': _rows(origin),
            'plane': np.array(planes, dtype=float).reshape(-1, 8)}


def _rows(pose: Pose | None) -> NDArray[np.float64]:
    """A pose as the only row, or no row."""
    return np.array([(pose.x, pose.y, pose.yaw)] if pose else [], dtype=float).reshape(-1, 3)


def unpacked_frame(part: Part) -> tuple[str, Pose | None, Plane | None, Pose | None]:
    """Undo `packed_frame`; without an origin, as earlier, the map frame is the odometry's."""
    starts, planes = np.asarray(part['start'], float), np.asarray(part['plane'], float)
    origins = np.asarray(part['origin'], float) if 'origin' in part else np.zeros_like(starts)
    for rows, name in ((starts, 'start frame'), (origins, 'map frame')):
        if rows.shape not in ((0, 3), (1, 3)) or not np.all(np.abs(rows) <= FARTHEST_M):
            raise StateError(f'the {name} is not a pose')
    if planes.shape not in ((0, 8), (1, 8)) or not np.all(np.isfinite(planes)):
        raise StateError('the mapping plane is not a pose and a height')
    start, plane = (Pose(*row) for row in starts.tolist()), (_plane(*row) for row in planes.tolist())
    origin = (Pose(*row) for row in origins.tolist())
    return str(part['id']), next(start, None), next(plane, None), next(origin, None)


def _plane(x: float, y: float, z: float, qx: float, qy: float, qz: float, qw: float, level_m: float) -> Plane:
    if not np.hypot(np.hypot(qx, qy), np.hypot(qz, qw)) > 0.0:
        raise StateError('the mapping plane has no orientation')
    return Plane(SpatialPose((x, y, z), (qx, qy, qz, qw)), level_m)


def _mattering(parameters: Parameters) -> dict[str, str]:
    return {name: repr(value) for name, value in parameters.flat().items()
            if name.startswith(MATTERING) and name not in ('pulse.path', 'pulse.adapt')}
