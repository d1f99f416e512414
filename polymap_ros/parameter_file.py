"""Parameters from a ROS parameter file and from a command line's ``name:=value``, read as ROS reads them."""

import dataclasses
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from polymap_ros.errors import ParameterError, UsageError
from polymap_ros.names import for_many, for_node, full_name_in, misplaced, misspelt, stray
from polymap_ros.parameters import NODE_NAME, Parameters, specifications
from polymap_ros.paths import expanded
from polymap_ros.plain_yaml import read_parameter_yaml, read_small


def parse_override(text: str) -> tuple[str, object]:
    """Split a command line's ``name:=value``; the value is read as YAML, as ROS does."""
    name, separator, value = text.partition(':=')
    if not separator or not name:
        meant = re.fullmatch(r'([\w.]+)\s*[:=]\s*(\S.*)', text)
        raise ParameterError(text, f'expected name:=value{f"; did you mean {meant[1]}:={meant[2]}?" if meant else ""}')
    try:
        return name, read_parameter_yaml(value) if value else ''
    except yaml.YAMLError as error:
        raise ParameterError(name, f'{value!r} is not a YAML value') from error


def load_parameters(
    path: str | Path, overrides: Mapping[str, object] | None = None, node_name: str = NODE_NAME,
    warn: Callable[[str], None] = lambda text: None,
) -> Parameters:
    """Read a ROS parameter file, and then what was given beside it; the result is checked as a whole.

    Keys ``node_name``, ``/ns/node_name`` (or nested, ``ns: node_name:``) and those whose ``*`` (one name) or ``**``
    (any number of them) stand for such are taken in the order of the file, as ROS does: what comes last counts. The
    namespace is that of the keys, if they are of one. Unknown names below ``/**`` or ``/*`` belong to other nodes and
    are left alone, and so are names outside our groups (``use_sim_time``); `warn` is told of those that look as if
    they were meant for us.

    Parameters
    ----------
    path : str or Path
        The file; ``~`` is expanded.
    overrides : mapping, optional
        Values by full name, as of a command line; they count after the file's.
    node_name : str, optional
        Name of the node whose parameters are read.
    warn : callable, optional
        Takes a sentence.

    Returns
    -------
    Parameters
        Those of the file and the overrides, and the defaults of all others.

    Raises
    ------
    UsageError
        For a file that cannot be read, or is not a parameter file.
    ParameterError
        For a name or value that is not allowed.
    """
    path = _path(path)
    document = _document(path)
    nodes = dict(_nodes(document, node_name))
    full_name = full_name_in(list(nodes), node_name)
    keys = [key for key in nodes if key.rpartition('/')[2] == node_name or for_node(key, full_name)]
    for key in (key for key in nodes if for_many(key) and key not in keys):
        warn(f'parameter file {path}: {key} is for nodes elsewhere than {full_name}, and left alone')
    if not keys:
        raise UsageError(f'parameter file {path}: has no {node_name} or /** key, only {", ".join(map(str, document))}'
                         f'{misspelt([part for key in nodes for part in key.split("/")], node_name)}')
    others = [key for key in keys if key.strip('/') != node_name and '*' not in key]
    if len(others) > 1:
        raise UsageError(f'parameter file {path}: is for several nodes, of which one is asked for: {", ".join(others)}')
    values: dict[str, object] = {}
    for key in keys:
        values |= _ours(f'parameter file {path}', key, nodes[key], warn)
    loaded = Parameters().replaced(values | dict(overrides or {}))
    return dataclasses.replace(loaded, folder=path.resolve().parent)


def _document(path: Path) -> dict[Any, Any]:
    try:
        document = read_parameter_yaml(read_small(path))
    except OSError as error:
        raise UsageError(f'parameter file {path}: cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise UsageError(f'parameter file {path}: is not UTF-8; save it in that encoding') from error
    except yaml.YAMLError as error:
        raise UsageError(f'parameter file {path}: is not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(document, dict):
        raise UsageError(f'parameter file {path}: is not a ROS parameter file: expected polymap_node: '
                         'ros__parameters: ...')
    return document


def _ours(file: str, key: str, node: object, warn: Callable[[str], None]) -> dict[str, object]:
    """What stands below one key of a parameter file and is for us; the rest is told where it may have been meant so."""
    body = node.get('ros__parameters') if isinstance(node, dict) else None
    if not isinstance(body, dict):
        raise UsageError(f'{file}: {key} has no ros__parameters'
                         f'{misspelt(list(node), "ros__parameters") if isinstance(node, dict) else ""}')
    known = {spec.name for spec in specifications()}
    groups = {name.partition('.')[0] for name in known}
    entries: dict[str, object] = {}
    for name, value in _flattened(body):
        if name in entries:
            raise UsageError(f'{file}: {key} has {name} twice')
        if name in groups and (value is None or not for_many(key)):
            raise UsageError(f'{file}: below {key}: {misplaced(name, value)}')
        entries[name] = value
    for name, value in entries.items():
        if name in groups:
            warn(f'{file}: below {key}: {misplaced(name, value)}')
        elif (for_many(key) or name.partition('.')[0] not in groups) and (text := stray(name, sorted(known))):
            warn(f'{file}: below {key}: {text}')
    return {name: value for name, value in entries.items()
            if name.partition('.')[0] in groups and (name in known or not for_many(key))}


def _path(path: str | Path) -> Path:
    try:
        return Path(expanded(os.fspath(path)))
    except TypeError as error:
        raise UsageError(f'parameter file: found {path!r:.80}; allowed: the path of a YAML file') from error
    except ValueError as error:
        raise UsageError(f'parameter file {error}') from error


def _nodes(tree: Mapping[Any, Any], node_name: str, prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Full name and body of every node; any other key that holds keys is a namespace."""
    for key, body in tree.items():
        name = f'{prefix}/{key}' if prefix else str(key)
        if isinstance(body, dict) and 'ros__parameters' not in body and (
                key not in (node_name, '/**') or any(isinstance(each, dict) and 'ros__parameters' in each
                                                     for each in body.values())):
            yield from _nodes(body, node_name, name)
        else:
            yield name, body


def _flattened(tree: Mapping[Any, Any], prefix: str = '') -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flattened(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value
