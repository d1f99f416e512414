"""Small text files that nobody vouches for, and YAML of plain values: whatever is wrong is one kind of error."""

import errno
import os
import re
from collections import Counter
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


class _Loader(yaml.SafeLoader):
    """YAML as ROS reads it: 1e-6 is a number, for which PyYAML's 1.1 asks for 1.0e-6, and 1:30 and 1_000 are none.

    An alias stands for all that it refers to, so that a few lines of aliases of aliases would become billions of
    values; ROS takes none in parameter files either. Of a key that is there twice one value would be lost.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.YAMLError(f'line {mark.line + 1}: aliases are not allowed')
        return super().compose_node(parent, index)


    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        if len(mapping) < len(node.value):
            counts = Counter(self.construct_object(key, deep) for key, _ in node.value)
            raise yaml.YAMLError(f'line {node.start_mark.line + 1}: {counts.most_common(1)[0][0]} is given twice')
        return mapping


_INTEGER, _FLOAT = 'tag:yaml.org,2002:int', 'tag:yaml.org,2002:float'
_Loader.yaml_implicit_resolvers = {
    first: [entry for entry in entries if entry[0] not in (_INTEGER, _FLOAT)]
    for first, entries in yaml.SafeLoader.yaml_implicit_resolvers.items()}
_Loader.add_implicit_resolver(
    _INTEGER, re.compile(r'[-+]?(0b[01]+|0x[0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)$'), list('-+0123456789'))
_Loader.add_implicit_resolver(
    _FLOAT, re.compile(r'([-+]?(\d+\.\d*|\.\d+|\d+(?=[eE]))([eE][-+]?\d+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))$'),
    list('-+.0123456789'))


def read_yaml(text: str) -> Any:
    """Read a document.

    Raises
    ------
    yaml.YAMLError
        For what is no YAML, tags of other than plain values, aliases, and values that do not exist.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except RecursionError as error:
        raise yaml.YAMLError('is nested too deeply') from error
    except (ValueError, OverflowError, KeyError, TypeError, AttributeError) as error:  # such as 30 February
        raise yaml.YAMLError(f'holds a value that does not exist: {error}') from error
