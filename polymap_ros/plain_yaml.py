"""YAML of files that nobody vouches for: plain values, no aliases, whatever is wrong is one kind of error."""

import re
from typing import Any

import yaml


class _Loader(yaml.SafeLoader):
    """YAML as ROS reads it: 1e-6 is a number, as in YAML 1.2, where PyYAML's 1.1 asks for 1.0e-6.

    An alias stands for all that it refers to, so that a few lines of aliases of aliases would become billions of
    values; ROS takes none in parameter files either.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.YAMLError(f'line {mark.line + 1}: aliases are not allowed')
        return super().compose_node(parent, index)


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$'), list('-+.0123456789'))


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
