"""polymap_ros: the polygon around a robot from raw ultrasonic echoes and odometry.

For use as a library: all in `__all__` is imported from here, on first use. What lies deeper may change.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from polymap_ros.acoustics.ping import Ping
    from polymap_ros.acoustics.pulse import RecordedPulse
    from polymap_ros.cautions import Caution
    from polymap_ros.errors import (
        BadPing,
        ParameterError,
        PolymapError,
        RecordingError,
        SceneError,
        StateError,
        UsageError,
    )
    from polymap_ros.geometry.pose import Pose
    from polymap_ros.library import map_polygon
    from polymap_ros.mapping.mapper import PolygonMapper
    from polymap_ros.parameter_file import load_parameters
    from polymap_ros.parameters import Parameters
    from polymap_ros.simulation.scene_file import load_scene
    from polymap_ros.simulation.waveforms import simulate
    from polymap_ros.solvers.estimate import Candidate, Edge, Estimate

__version__ = '0.1.0'

__all__ = [
    'BadPing', 'Candidate', 'Caution', 'Edge', 'Estimate', 'ParameterError', 'Parameters', 'Ping', 'PolygonMapper',
    'PolymapError', 'Pose', 'RecordedPulse', 'RecordingError', 'SceneError', 'StateError', 'UsageError',
    'load_parameters', 'load_scene', 'map_polygon', 'simulate',
]

_ERRORS = {name for name in __all__ if name.endswith('Error')} | {'BadPing'}
_HOMES = dict.fromkeys(_ERRORS, 'errors') | {
    'Candidate': 'solvers.estimate', 'Caution': 'cautions', 'Edge': 'solvers.estimate', 'Estimate': 'solvers.estimate',
    'Parameters': 'parameters', 'Ping': 'acoustics.ping', 'PolygonMapper': 'mapping.mapper', 'Pose': 'geometry.pose',
    'RecordedPulse': 'acoustics.pulse', 'load_parameters': 'parameter_file', 'load_scene': 'simulation.scene_file',
    'map_polygon': 'library', 'simulate': 'simulation.waveforms',
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    found = getattr(import_module(f'{__name__}.{_HOMES[name]}'), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
