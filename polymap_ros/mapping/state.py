"""A mapper's state as one flat table of arrays, and the check that it may be continued."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.mapping.pose import Pose
from polymap_ros.parameters import Parameters

VERSION = 1

MATTERING = ('medium.', 'pulse.', 'sensor.', 'grid.', 'echo.kind', 'echo.t0_s', 'echo.blanking_m')
"""Parameters that what is kept depends on; the path of a pulse's file says nothing about its content."""

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
    if int(state['version']) != VERSION:
        raise StateError(f'the state has version {state["version"]}; allowed: {VERSION}')
    then, now = dict(state['parameters'].tolist()), _mattering(parameters)
    for name in sorted(then.keys() | now.keys()):
        if then.get(name) != now.get(name):
            raise StateError(f'the state was taken with {name} {then.get(name)}, now it is {now.get(name)}')
    parts: dict[str, Part] = {}
    for key, array in state.items():
        part, _, name = key.partition('.')
        parts.setdefault(part, {})[name] = array
    return parts


def packed_frame(frame_id: str, start: Pose | None) -> Part:
    """The odometry's frame and the start frame in it."""
    rows = [(start.x, start.y, start.yaw)] if start else []
    return {'id': np.array(frame_id), 'start': np.array(rows, dtype=float).reshape(-1, 3)}


def unpacked_frame(part: Part) -> tuple[str, Pose | None]:
    """Undo `packed_frame`."""
    rows = np.asarray(part['start'], float)
    if rows.shape not in ((0, 3), (1, 3)) or not np.all(np.isfinite(rows)):
        raise StateError('the start frame is not a pose')
    return str(part['id']), Pose(*rows[0].tolist()) if len(rows) else None


def _mattering(parameters: Parameters) -> dict[str, str]:
    return {name: repr(value) for name, value in parameters.flat().items()
            if name.startswith(MATTERING) and name != 'pulse.path'}
