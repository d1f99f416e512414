"""Small text files that nobody vouches for, and YAML of plain values: whatever is wrong is one kind of error."""

import errno
import math
import os
import re
import sys
from pathlib import Path
from typing import Any

import yaml

MOST_BYTES = 2**24
"""A million poses of a scene; no file of parameters comes near."""


def read_small(path: Path) -> str:
    """Text of a file of up to 16 MiB.

    Raises
    ------
    OSError
        For what cannot be read, is larger, or is no file: reading a pipe or a device might never end.
    UnicodeDecodeError
        For what is not UTF-8.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(errno.EINVAL, 'is no regular file', str(path))
    with path.open('rb') as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return data.decode('utf-8')


class _Loader(yaml.BaseLoader):
    """Composes nodes; scalars without quotes and tags are marked, since ROS reads those as more than text.

    An alias stands for all that it refers to, so that a few lines of aliases of aliases would become billions of
    values; ROS takes none in parameter files either.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.YAMLError(f'line {mark.line + 1}: aliases are not allowed')
        return super().compose_node(parent, index)

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        if kind is yaml.ScalarNode and implicit[0]:
            return _PLAIN
        return super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]


_PLAIN, _TEXT = '!plain', 'tag:yaml.org,2002:str'
_TAGS = {f'tag:yaml.org,2002:{kind}' for kind in ('str', 'bool', 'int', 'float', 'null', 'timestamp', 'seq', 'map')}

_TRUE = {'y', 'Y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'}
_FALSE = {'n', 'N', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'}
_NULL = {'', '~', 'null', 'Null', 'NULL'}
_INTEGER = re.compile(r'[-+]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)')
_MOST_DIGITS = 1000  # far beyond what 64 bits hold; the time to read more is not bounded by their number
_DECIMAL = re.compile(r'[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?')
_HEXADECIMAL = re.compile(r'[-+]?0[xX]([0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)([pP][-+]?[0-9]+)?')
_INFINITE = re.compile(r'([-+]?)(\.inf|\.Inf|\.INF|(?i:inf|infinity))')
_NOT_A_NUMBER = re.compile(r'\.nan|\.NaN|\.NAN|[-+]?(?i:nan)(\([0-9a-zA-Z_]*\))?')


def _scalar(text: str) -> bool | int | float | str:
    """Read a scalar without quotes as rcl_yaml_param_parser does, by C's strtol and strtod; all else is a string."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if len(text) < _MOST_DIGITS and _INTEGER.fullmatch(text):
        digits = text.lstrip('+-').lower()
        number = int(digits, 16 if digits.startswith('0x') else 8 if digits.startswith('0') else 10)
        number = -number if text.startswith('-') else number
        if -2**63 <= number < 2**63:
            return number
    return _real(text)


def _real(text: str) -> float | str:
    """Read a number that is not whole; one that no double holds is a string."""
    if found := _INFINITE.fullmatch(text):
        return float(f'{found[1]}inf')
    if _NOT_A_NUMBER.fullmatch(text):
        return math.nan
    try:
        if _DECIMAL.fullmatch(text):
            value, least, mantissa = float(text), sys.float_info.min, re.split('[eE]', text)[0]
        elif _HEXADECIMAL.fullmatch(text):
            value, least, mantissa = float.fromhex(text), math.ulp(0.0), re.split('[pP]', text)[0]
        else:
            return text
    except OverflowError:
        return text
    is_zero = not re.search('[1-9a-fA-F]', mantissa)
    return value if is_zero or least <= abs(value) < math.inf else text


def _value(node: yaml.Node, nulls: set[str]) -> Any:
    """Turn a node into plain values. Keys are strings; of one that is there twice a value would be lost."""
    line = node.start_mark.line + 1
    if node.tag not in _TAGS and node.tag != _PLAIN:
        raise yaml.YAMLError(f'line {line}: the tag {node.tag} is not allowed')
    if isinstance(node, yaml.ScalarNode):
        if node.style in ('"', "'") or (node.style is None and node.tag == _TEXT):
            return node.value
        return None if node.value in nulls else _scalar(node.value)
    if isinstance(node, yaml.SequenceNode):
        return [_value(each, nulls) for each in node.value]
    mapping: dict[str, Any] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise yaml.YAMLError(f'line {line}: a key is no scalar')
        if key.value in mapping:
            raise yaml.YAMLError(f'line {line}: {key.value} is given twice')
        mapping[key.value] = _value(value, nulls)
    return mapping


def read_yaml(text: str) -> Any:
    """Read a document of plain values: scalars as in `read_parameter_yaml`, but ``null`` and ``~`` are None.

    Raises
    ------
    yaml.YAMLError
        For what is no YAML, tags of other than plain values, and aliases.
    """
    return _read(text, _NULL)


def read_parameter_yaml(text: str) -> Any:
    """Read a document as ROS reads parameters; only what is not there at all is None.

    ``1e-6`` is a number, ``yes`` and ``n`` are booleans, ``010`` is 8; a date, ``1:30``, ``1_000``, ``~`` and ``null``
    are strings. Raises as `read_yaml` does.
    """
    return _read(text, {''})


def _read(text: str, nulls: set[str]) -> Any:
    try:
        node = yaml.compose(text, Loader=_Loader)
        return None if node is None else _value(node, nulls)
    except RecursionError as error:
        raise yaml.YAMLError('is nested too deeply') from error
