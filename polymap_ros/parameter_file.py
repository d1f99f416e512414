"""Parameters from a ROS parameter file and from a command line's ``name:=value``, read as ROS reads them."""

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from polymap_ros.errors import ParameterError, UsageError
from polymap_ros.parameters import NODE_NAME, Parameters, specifications
from polymap_ros.plain_yaml import read_small, read_yaml


def parse_override(text: str) -> tuple[str, object]:
    """Split a command line's ``name:=value``; the value is read as YAML, as ROS does."""
    name, separator, value = text.partition(':=')
    if not separator or not name:
        raise ParameterError(text, 'expected name:=value')
    try:
        return name, read_yaml(value) if value else ''
    except yaml.YAMLError as error:
        raise ParameterError(name, f'{value!r} is not a YAML value') from error


def load_parameters(
    path: Path, overrides: Mapping[str, object] | None = None, node_name: str = NODE_NAME
) -> Parameters:
    """Read a ROS parameter file, and then `overrides` as of a command line; the result is checked as a whole.

    Keys ``/**``, ``node_name`` and ``/ns/node_name`` (or nested, ``ns: node_name:``) are taken, the most specific last.
    Unknown names below ``/**`` belong to other nodes and are left alone, and so are names outside our groups
    (``use_sim_time``).

    Raises
    ------
    UsageError
        For a file that cannot be read, or is not a parameter file.
    ParameterError
        For a name or value that is not allowed.
    """
    try:
        document = read_yaml(read_small(path))
    except OSError as error:
        raise UsageError(f'parameter file {path}: cannot be read: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UsageError(f'parameter file {path}: is not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(document, dict):
        raise UsageError(f'parameter file {path}: is not a ROS parameter file: expected polymap_node: '
                         'ros__parameters: ...')
    nodes = dict(_nodes(document, node_name))
    keys = [key for key in nodes if key == '/**' or key.rpartition('/')[2] == node_name]
    if not keys:
        raise UsageError(f'parameter file {path}: has no {node_name} or /** key, only {", ".join(map(str, document))}')
    others = [key for key in keys if key.strip('/') not in ('**', node_name, f'**/{node_name}')]
    if len(others) > 1:
        raise UsageError(f'parameter file {path}: is for several nodes, of which one is asked for: {", ".join(others)}')
    known = {spec.name for spec in specifications()}
    groups = {name.partition('.')[0] for name in known}
    values: dict[str, object] = {}
    for key in sorted(keys, key=lambda key: (key != '/**', key.count('/'), key)):
        body = nodes[key].get('ros__parameters') if isinstance(nodes[key], dict) else None
        if not isinstance(body, dict):
            raise UsageError(f'parameter file {path}: {key} has no ros__parameters')
        entries: dict[str, object] = {}
        for name, value in _flattened(body):
            if name in entries:
                raise UsageError(f'parameter file {path}: {key} has {name} twice')
            entries[name] = value
        if key == '/**':
            entries = {name: value for name, value in entries.items() if name in known}
        values |= {name: value for name, value in entries.items() if name.partition('.')[0] in groups}
    loaded = Parameters().replaced(values | dict(overrides or {}))
    return dataclasses.replace(loaded, folder=path.resolve().parent)


def _nodes(tree: Mapping[Any, Any], node_name: str, prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Full name and body of every node; any other key that holds keys is a namespace."""
    for key, body in tree.items():
        name = f'{prefix}/{key}' if prefix else str(key)
        if isinstance(body, dict) and 'ros__parameters' not in body and str(key) not in (node_name, '/**'):
            yield from _nodes(body, node_name, name)
        else:
            yield name, body


def _flattened(tree: Mapping[Any, Any], prefix: str = '') -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flattened(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value
