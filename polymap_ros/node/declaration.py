"""The node's ROS parameters: declared, described and changed from the one source, `polymap_ros.parameters`."""

import dataclasses
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from polymap_ros.errors import ParameterError, UsageError
from polymap_ros.names import for_many, for_node, misplaced, stray
from polymap_ros.parameters import Parameters, specifications
from polymap_ros.plain_yaml import read_parameter_yaml, read_small
from polymap_ros.specification import Specification, Value

SPECIFICATIONS = {spec.name: spec for spec in specifications()}
GROUPS = {name.partition('.')[0] for name in SPECIFICATIONS}
UNBOUNDED = sys.float_info.max
UNBOUNDED_INTEGER = 2**63 - 1


def declare(node: Node, arguments: Sequence[str]) -> Parameters:
    """Declare every parameter of the one source with its descriptor.

    Parameters
    ----------
    node : Node
        Made with ``automatically_declare_parameters_from_overrides``: what the user gave is then there in
        whatever type it was given, and is declared anew in ours.
    arguments : sequence of str
        The command line; parameter files in it tell names for this node from names for all nodes.

    Raises
    ------
    ParameterError
        For an unknown name below one of our groups, unless it was given for all nodes (``/**``, ``/*``), a wrong type
        or a value that is not allowed.
    UsageError
        For a parameter file that holds something else.
    """
    given = _taken_overrides(node)
    files, full_name = list(_parameter_files(arguments)), node.get_fully_qualified_name()
    for path, keys in files:
        if keys and not any(for_node(key, full_name) for key in keys):
            node.get_logger().warning(f'parameter file {path}: nothing in it is for this node, {full_name}; it is for '
                                      f'{", ".join(keys)}. /**: is for all nodes')
    spared = _for_other_nodes(files, arguments, full_name)
    for name in given:
        if name in GROUPS:
            text = misplaced(name, given[name])
            if name not in spared:
                raise UsageError(text)
            node.get_logger().warning(text)
        elif (name.partition('.')[0] not in GROUPS or name in spared) and (text := stray(name, list(SPECIFICATIONS))):
            node.get_logger().warning(text)
    values = {name: value for name, value in given.items()
              if name.partition('.')[0] in GROUPS and (name in SPECIFICATIONS or name not in spared)}
    parameters = dataclasses.replace(Parameters().replaced(values), folder=_folder(files))
    for name, spec in SPECIFICATIONS.items():
        node.declare_parameter(name, parameters[name], _descriptor(spec), ignore_override=True)
    return parameters


class LiveParameters:
    """Changes of parameters while the node runs: first validated, then applied.

    Parameters
    ----------
    node : Node
        Whose parameters have been declared.
    parameters : Parameters
        As declared.
    apply : callable
        Called with the new set after a change.
    """

    def __init__(self, node: Node, parameters: Parameters, apply: Callable[[Parameters], None]) -> None:
        self.current = parameters
        self._apply = apply
        node.add_pre_set_parameters_callback(self._convert)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._take)

    def _convert(self, changes: list[Parameter]) -> list[Parameter]:
        """Ints given for doubles become doubles, as the contract promises."""
        return [_as_double(change) if _is_double(change.name) else change for change in changes]

    def _validate(self, changes: list[Parameter]) -> SetParametersResult:
        try:
            self.current.replaced(_ours(changes))
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take(self, changes: list[Parameter]) -> None:
        if values := _ours(changes):
            self.current = self.current.replaced(values)
            self._apply(self.current)


def _ours(changes: Sequence[Parameter]) -> dict[str, object]:
    return {change.name: change.value for change in changes if change.name.partition('.')[0] in GROUPS}


def _is_double(name: str) -> bool:
    return name in SPECIFICATIONS and SPECIFICATIONS[name].type is float


def _as_double(change: Parameter) -> Parameter:
    if change.type_ is not Parameter.Type.INTEGER:
        return change
    return Parameter(change.name, Parameter.Type.DOUBLE, float(change.value))


def _taken_overrides(node: Node) -> dict[str, Value]:
    """Undeclare what was declared from overrides and belongs to us or to QoS; return all values given for us."""
    given = node.get_parameters_by_prefix('')
    for name in list(given):
        if name.partition('.')[0] in GROUPS | {'qos_overrides'}:
            node.undeclare_parameter(name)
    return {name: parameter.value for name, parameter in given.items()}


def _descriptor(spec: Specification) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=f'{spec.text} [{spec.unit}]' if spec.unit else spec.text,
        additional_constraints=spec.allowed(), read_only=not spec.live,
    )
    low = spec.above if spec.above is not None else spec.minimum
    if low is None and spec.maximum is None:
        return descriptor
    if spec.type is int:
        descriptor.integer_range = [IntegerRange(
            from_value=-UNBOUNDED_INTEGER if low is None else int(low),
            to_value=UNBOUNDED_INTEGER if spec.maximum is None else int(spec.maximum), step=1)]
    else:
        descriptor.floating_point_range = [FloatingPointRange(
            from_value=-UNBOUNDED if low is None else float(low),
            to_value=UNBOUNDED if spec.maximum is None else float(spec.maximum), step=0.0)]
    return descriptor


def _parameter_files(arguments: Sequence[str]) -> Iterator[tuple[Path, dict[str, set[str]]]]:
    """Each parameter file of the command line with the names it gives, by node; rcl has read them before."""
    for flag, value in pairwise(arguments):
        if flag == '--params-file':
            try:
                tree = read_parameter_yaml(read_small(Path(value))) or {}
            except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
                raise UsageError(f'parameter file {value}: cannot be read: {" ".join(str(error).split())}') from error
            if not isinstance(tree, Mapping):
                raise UsageError(f'parameter file {value}: is not a ROS parameter file: expected polymap_node: '
                                 'ros__parameters: ...')
            yield Path(value), {node: set(_names(body)) for node, body in _sections(tree)}


def _sections(tree: Mapping[str, Any], prefix: str = '') -> Iterator[tuple[str, Mapping[str, Any]]]:
    for key, body in tree.items():
        if key == 'ros__parameters':
            yield prefix, body if isinstance(body, Mapping) else {}
        elif isinstance(body, Mapping):
            yield from _sections(body, f'{prefix}/{key}' if prefix else key)


def _names(tree: Mapping[str, Any], prefix: str = '') -> Iterator[str]:
    for key, body in tree.items():
        if isinstance(body, Mapping):
            yield from _names(body, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}'


def _for_other_nodes(
    files: Sequence[tuple[Path, dict[str, set[str]]]], arguments: Sequence[str], full_name: str
) -> set[str]:
    """Names given to nodes of any name in files (``/**``, ``/*``) and not to this one by itself."""
    shared: set[str] = set()
    own = {value.partition(':=')[0].rpartition(':')[2]
           for flag, value in pairwise(arguments) if flag in ('-p', '--param')}
    for _, keys in files:
        for key, names in keys.items():
            if for_node(key, full_name):
                (shared if for_many(key) else own).update(names)
    return shared - own


def _folder(files: Sequence[tuple[Path, dict[str, set[str]]]]) -> Path:
    """The folder of the last file that names a pulse, which relative names start from."""
    folders = [path.resolve().parent for path, keys in files if any('pulse.path' in names for names in keys.values())]
    return folders[-1] if folders else Path()
