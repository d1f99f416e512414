"""Scenes as YAML files, and the built-in ones.

The keys are the fields of `Scene`; the path is either `poses`, a list of [x, y, yaw] in metres and radians, or a
`trajectory`, one of::

    trajectory: {start: [x, y, yaw_deg], legs: [[turn_deg, length_m], ...], step_m: 0.14}
    trajectory: {pings: 60, step_m: 0.14, clearance_m: 0.06}                        # drawn, from the seed
    trajectory: {recording: PATH, topic: odom, pings: 60, clearance_m: 0.06, turn_deg: 0.0}

The last takes the way that a recorded odometry went, scaled to fill the room. Holes, and walls inside that let some of
the wave through, such as stiffeners and weld seams, are lists::

    holes: [[[x, y], [x, y], [x, y]], {vertices: [[x, y], ...], reflection: 0.8}, {centre: [x, y], radius_m: 0.1}]
    inner_walls: [{start: [x, y], end: [x, y], reflection: 0.4, transmission: 0.9}]

A hole's reflection is 1 unless given, an inner wall's transmission sqrt(1 - reflection^2). An inner wall may reach
beyond the outline or into a hole: it ends where it meets them. `edges` and `height` do not go with holes or inner
walls, nor does a recorded way with holes, nor `edge_fading` with round ones.

What device and odometry do wrong is in `faults`, with the fields of `Faults`; what edges do to what they reflect in
`edges`, with those of `Edges`; what the medium does beside in `propagation`, with those of `Propagation`; a room's
floor and ceiling in `height`, with those of `Height`. With ``edge_fading: fresnel`` echoes fade over a Fresnel zone at
the ends of walls, and corners diffract. With ``echo_kind: envelope`` samples are magnitudes.
"""

import dataclasses
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from polymap_ros.acoustics.pulse import RecordedPulse, same_period
from polymap_ros.errors import ParameterError, SceneError
from polymap_ros.map_parameters import GridParameters
from polymap_ros.names import suggestion
from polymap_ros.parameters import MediumParameters, Parameters, PulseParameters, SensorParameters
from polymap_ros.paths import expanded
from polymap_ros.plain_yaml import read_small, read_yaml
from polymap_ros.pulse_file import read_pulse
from polymap_ros.simulation.corners import counter_clockwise
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.height import Height
from polymap_ros.simulation.inside import Hole, Partition, RoundHole, holes_of, named
from polymap_ros.simulation.propagation import Propagation
from polymap_ros.simulation.scenes import Scene, check_bounds
from polymap_ros.simulation.trajectories import check_count, fitted, legs, random_legs, recorded

ReadPath = Callable[[Path, str], NDArray[np.float64]]
"""Reads the poses (N, 3) of an odometry topic from a recording."""

_GROUPS = {'medium': MediumParameters, 'pulse': PulseParameters, 'sensor': SensorParameters, 'grid': GridParameters,
           'told_medium': MediumParameters, 'faults': Faults, 'edges': Edges, 'height': Height,
           'propagation': Propagation}
_INTEGERS = ('n_samples', 'order', 'seed', 'pings')
_SUFFIX = '.scene.yaml'
_PATH_STREAM = 4
_RANDOM_PATHS = 1000


def built_in_scenes() -> list[str]:
    """Names of the scenes that come with the package."""
    return sorted(entry.name.removesuffix(_SUFFIX) for entry in _folder().iterdir() if entry.name.endswith(_SUFFIX))


def load_scene(name: str | Path, read_path: ReadPath | None = None) -> Scene:
    """Read a scene file, or the built-in scene of that name.

    Parameters
    ----------
    name : str or Path
        A path, in which ``~`` is expanded, or one of `built_in_scenes`.
    read_path : callable, optional
        What reads a trajectory's recording; without it such a trajectory is refused.

    Returns
    -------
    Scene
        Its `vertices` and `poses` are the truth, `parameters` what a mapper is to be told.

    Raises
    ------
    SceneError
        Names the file and what is wrong with it.
    """
    if not isinstance(name, str | Path):
        raise SceneError(f'found {name!r:.80}; allowed: a scene file, or a built-in scene '
                         f'({", ".join(built_in_scenes())})')
    name = str(name)
    path = Path(_expanded(name))
    if name in built_in_scenes():
        text = (_folder() / f'{name}{_SUFFIX}').read_text(encoding='utf-8')
    else:
        try:
            text = read_small(path)
        except (OSError, UnicodeDecodeError) as error:
            known = ', '.join(built_in_scenes())
            raise SceneError(f'{name}: no scene file that can be read, nor a built-in scene ({known})') from error
    try:
        document = read_yaml(text)
        if not isinstance(document, dict):
            raise SceneError('expected a mapping with vertices, and poses or trajectory')
        with np.errstate(over='ignore', invalid='ignore'):  # what comes of absurd numbers is refused
            return _scene(document, path.name.partition('.')[0], path.parent, read_path)
    except yaml.YAMLError as error:
        raise SceneError(f'{name}: is not YAML: {" ".join(str(error).split())}') from error
    except (SceneError, ParameterError) as error:
        raise SceneError(f'{name}: {error}') from error


def _expanded(path: str) -> str:
    try:
        return expanded(path)
    except ValueError as error:
        raise SceneError(str(error)) from error


def _folder() -> Any:
    # From a room, since with a folder named polymap_ros about, Python may take polymap_ros for a namespace package.
    return resources.files('polymap_ros.simulation').parent / 'config'  # type: ignore[attr-defined]


def _scene(document: Mapping[str, Any], name: str, folder: Path, read_path: ReadPath | None) -> Scene:
    fields = [entry.name for entry in dataclasses.fields(Scene) if entry.name != 'recorded_pulse']
    _check_keys(document, [*fields, 'trajectory'], 'scene')
    if 'vertices' not in document or ('poses' in document) == ('trajectory' in document):
        raise SceneError('a scene needs vertices, and either poses or trajectory')
    values: dict[str, Any] = {'name': name}
    for key in fields:
        if key not in document:
            continue
        if key in _GROUPS:
            body = _mapping(document[key], key)
            _check_keys(body, [entry.name for entry in dataclasses.fields(_GROUPS[key])], key)
            values[key] = _GROUPS[key](**body)
        elif key in ('vertices', 'poses', 'reflection'):
            values[key] = _array(document[key], key)
        elif key in _INSIDE:
            values[key] = _inside(document[key], key)
        elif key in ('name', 'edge_fading', 'echo_kind') or (key == 'snr_db' and document[key] is None):
            values[key] = document[key]
        else:
            values[key] = _number(document, key)
            check_bounds(key, values[key])  # before a path is drawn from the seed
    pulse = values.get('pulse', PulseParameters())
    if recorded := read_pulse(Parameters(pulse=pulse, folder=folder)):
        values['recorded_pulse'] = _at_period(recorded, 1.0 / values.get('sample_rate_hz', Scene.sample_rate_hz))
    if 'trajectory' in document:
        body = _mapping(document['trajectory'], 'trajectory')
        vertices, seed = counter_clockwise(values['vertices'])[0], int(values.get('seed', 1))
        holes = [hole.vertices for hole in holes_of(vertices, values.get('holes', ()))]
        values['poses'] = _trajectory(body, vertices, holes, seed, folder, read_path)
    return Scene(**values)


def _inside(value: Any, key: str) -> list[Hole | RoundHole | Partition]:
    """Holes or inner walls, each with its number where it is wrong."""
    if not isinstance(value, list):
        raise SceneError(f'{key} must be a list')
    return [_INSIDE[key](body, f'{key}[{index}]') for index, body in enumerate(value)]


def _hole(body: Any, where: str) -> Hole | RoundHole:
    body = body if isinstance(body, dict) else {'vertices': body}
    if 'centre' in body or 'radius_m' in body:
        return _round_hole(body, where)
    _check_keys(body, ['vertices', 'reflection'], where)
    if 'vertices' not in body:
        raise SceneError(f'{where} needs vertices, or centre and radius_m')
    with named(where):
        return Hole(*(_array(body[key], key) for key in ('vertices', 'reflection') if key in body))


def _round_hole(body: Mapping[str, Any], where: str) -> RoundHole:
    _check_keys(body, [entry.name for entry in dataclasses.fields(RoundHole)], where)
    if missing := [key for key in ('centre', 'radius_m') if key not in body]:
        raise SceneError(f'{where} needs {" and ".join(missing)}')
    with named(where):
        return RoundHole(_array(body['centre'], 'centre'), _number(body, 'radius_m'),
                         *([_number(body, 'reflection')] if 'reflection' in body else ()))


def _inner_wall(body: Any, where: str) -> Partition:
    body = _mapping(body, where)
    _check_keys(body, [entry.name for entry in dataclasses.fields(Partition)], where)
    if missing := [key for key in ('start', 'end', 'reflection') if key not in body]:
        raise SceneError(f'{where} needs {" and ".join(missing)}')
    with named(where):
        return Partition(_array(body['start'], 'start'), _array(body['end'], 'end'), _number(body, 'reflection'),
                         _number(body, 'transmission') if 'transmission' in body else None)


_INSIDE: dict[str, Callable[[Any, str], Hole | RoundHole | Partition]] = {'holes': _hole, 'inner_walls': _inner_wall}


def _at_period(pulse: RecordedPulse, period_s: float) -> NDArray[np.float64]:
    if pulse.period_s and not same_period(pulse.period_s, period_s):
        raise SceneError(f'pulse.path is sampled at {1.0 / pulse.period_s:g} Hz, the scene at {1.0 / period_s:g} Hz '
                         '(sample_rate_hz); resample it')
    return pulse.recorded


def _trajectory(
    body: Mapping[str, Any], vertices: NDArray[np.float64], holes: list[NDArray[np.float64]], seed: int, folder: Path,
    read_path: ReadPath | None,
) -> NDArray[np.float64]:
    if 'legs' in body:
        _check_keys(body, ['start', 'legs', 'step_m'], 'trajectory')
        start, turns = _array(body.get('start'), 'start'), _array(body['legs'], 'legs')
        if start.shape != (3,) or turns.ndim != 2 or turns.shape[1] != 2:
            raise SceneError('trajectory: start must be [x, y, yaw_deg] and legs a list of [turn_deg, length_m]')
        first = (float(start[0]), float(start[1]), float(np.deg2rad(start[2])))
        return legs(first, np.deg2rad(turns[:, 0]).tolist(), turns[:, 1].tolist(), _number(body, 'step_m'))
    drive, drawn = ['recording', 'topic', 'pings', 'clearance_m', 'turn_deg'], ['pings', 'step_m', 'clearance_m']
    _check_keys(body, ['start', 'legs', *drive, *drawn], 'trajectory')
    count, clearance = int(_number(body, 'pings')), _number(body, 'clearance_m')
    check_count(count)
    if 'recording' in body:
        _check_keys(body, drive, 'trajectory')
        if holes:
            raise SceneError('trajectory: a recorded drive is fitted into rooms without holes only; give legs, or '
                             'pings and step_m')
        if read_path is None:
            raise SceneError('trajectory: recording cannot be read here')
        path = read_path(folder / _expanded(str(body['recording'])), str(body.get('topic', 'odom')))
        turn = np.deg2rad(_number(body, 'turn_deg')) if 'turn_deg' in body else 0.0
        return fitted(recorded(path, count), vertices, clearance, float(turn))
    _check_keys(body, drawn, 'trajectory')
    generator = np.random.default_rng([seed, _PATH_STREAM])
    if not (step_m := _number(body, 'step_m')) > 0.0:
        raise SceneError(f'trajectory: step_m must be above 0, found {step_m!r}')
    for _ in range(_RANDOM_PATHS):
        poses = random_legs(vertices, count, step_m, clearance, generator, holes)
        if poses is not None:
            return poses
    raise SceneError(f'trajectory: no path of {count} pings fits into the room with a clearance of {clearance:g} m')


def _check_keys(body: Mapping[str, Any], known: list[str], where: str) -> None:
    for key in body:
        if key not in known:
            raise SceneError(f'{where} has no key {key}; {suggestion(key, known)}')


def _mapping(value: Any, key: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise SceneError(f'{key} must be a mapping')
    return value


def _array(value: Any, key: str) -> NDArray[np.float64]:
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise SceneError(f'{key} must be numbers, all rows of the same length') from error
    if not np.isfinite(array).all():
        raise SceneError(f'{key} must be finite numbers')
    return array


def _number(body: Mapping[str, Any], key: str) -> float:
    """A number, an integer where the key is one of those."""
    value = body.get(key)
    try:
        if isinstance(value, bool) or value is None:
            raise ValueError
        number = float(value)
        if not np.isfinite(number):
            raise ValueError
        if key in _INTEGERS:
            if number != int(number):
                raise ValueError
            return int(number)
    except (TypeError, ValueError, OverflowError) as error:
        kind = 'an integer' if key in _INTEGERS else 'a number'
        raise SceneError(f'{key} must be {kind}, found {value!r}') from error
    return number
