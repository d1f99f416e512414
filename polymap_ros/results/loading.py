"""What `output.load_path` brings into a mapper: a saved state to go on from, or the outline to be localised in."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.pulse import RecordedPulse
from polymap_ros.errors import ParameterError, StateError, UsageError
from polymap_ros.hearing.listening import Later, at_once
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.outline import known_outline
from polymap_ros.parameters import Parameters
from polymap_ros.results.arrays import naming, read_state

_LARGEST = 100_000_000
"""Bytes of a polygon.json, at most."""


def loaded_mapper(
    parameters: Parameters, pulse: RecordedPulse | None, later: Later = at_once, at_most: int | None = None
) -> PolygonMapper:
    """Return a mapper as the parameters ask for: a fresh one, one that goes on, or one in a map that is given.

    Raises
    ------
    ParameterError
        For ``slam.mode: localization`` without a map.
    StateError
        For a file that cannot be read, or is not what it has to be.
    """
    path = parameters.output.load_path
    if parameters.localises:
        return PolygonMapper(parameters, pulse, later, at_most, outline=_outline_of(parameters))
    if not path:
        return PolygonMapper(parameters, pulse, later, at_most)
    state = read_state(Path(path))
    with naming(path):
        return PolygonMapper.from_state(parameters, state, pulse, later, at_most)


def check_loading(parameters: Parameters) -> None:
    """Raise what `loaded_mapper` would for the files."""
    if parameters.localises:
        _outline_of(parameters)
    elif path := parameters.output.load_path:
        read_state(Path(path))


def _outline_of(parameters: Parameters) -> NDArray[np.float64]:
    if not parameters.output.load_path:
        raise ParameterError('output.load_path', "'' is no map; allowed with slam.mode: localization: the folder of a "
                                                 'saved map, or a polygon.json')
    return read_outline(Path(parameters.output.load_path))


def read_outline(path: Path) -> NDArray[np.float64]:
    """Return the vertices (n, 2) of a polygon.json, given by itself, by its folder or by the state.npz beside it.

    Raises
    ------
    StateError
        For a file that is missing, is none, holds no polygon, or one that is not convex.
    """
    if path.is_dir() or path.suffix == '.npz':
        path = (path if path.is_dir() else path.parent) / 'polygon.json'
    try:
        if path.exists() and not path.is_file():
            raise StateError(f'{path}: is no file')
        with path.open('rb') as stream:
            document = json.loads(stream.read(_LARGEST).decode())
    except OSError as error:
        raise StateError(f'{path}: cannot be read: {error.strerror or error}; slam.mode: localization takes the folder '
                         'of a saved map, or a polygon.json') from error
    except (ValueError, RecursionError) as error:
        raise StateError(f'{path}: is no polygon.json: {type(error).__name__}') from error
    vertices = document.get('vertices') if isinstance(document, dict) else None
    if not isinstance(vertices, list):
        raise StateError(f'{path}: is no polygon.json: it has no vertices')
    if not vertices:
        raise StateError(f"{path}: its map is {document.get('status', 'unknown')}: it holds no polygon to be localised "
                         'in; map the place until it closes')
    try:
        return known_outline(vertices)
    except UsageError as error:
        raise StateError(f'{path}: {error}') from error
