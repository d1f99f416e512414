"""rclpy's side of the message factory that `polymap_ros.messages` builds through."""

import array
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from polymap_ros.errors import UsageError
from polymap_ros.messages.fields import Field

_NUMBERS = {'float': 'float32', 'double': 'float64', 'octet': 'uint8', 'char': 'uint8', 'boolean': 'bool'}
"""rclpy's names of numbers that are not numpy's."""


@cache
def message_class(type_name: str) -> Any:
    """The class of a type such as ``sensor_msgs/msg/LaserScan``.

    Raises
    ------
    UsageError
        Where it is not installed.
    """
    package, kind, name = type_name.split('/')
    try:
        return getattr(import_module(f'{package}.{kind}'), name)
    except (ImportError, AttributeError) as error:
        raise UsageError(f'message type {type_name} is not installed here ({error}): install or build the package '
                         f'{package}, and source its setup file') from error


def fields_of(type_name: str) -> dict[str, Field]:
    """What an installed type holds, by field."""
    return {name: _description(kind) for name, kind in message_class(type_name).get_fields_and_field_types().items()}


def _description(kind: str) -> Field:
    """A kind such as ``double``, ``double[36]``, ``sequence<float>`` or ``std_msgs/Header``."""
    element = kind.removeprefix('sequence<').rstrip('>').partition('[')[0].partition(',')[0]
    package, nested, name = element.partition('/')
    is_array = kind.startswith('sequence<') or kind.endswith(']')
    return Field(f'{package}/msg/{name}' if nested else _NUMBERS.get(element, element), is_array)


def make(type_name: str, /, **fields: Any) -> Any:
    """Build a message; numpy arrays become arrays of the field's type, which rclpy takes without a copy per number."""
    cls = message_class(type_name)
    types = cls.get_fields_and_field_types()
    return cls(**{name: _native(value, types[name]) for name, value in fields.items()})


def _native(value: Any, kind: str) -> Any:
    if isinstance(value, np.ndarray) and kind.startswith('sequence'):
        return _sequence(value)
    return bytes([value]) if kind == 'octet' else value


def _sequence(values: np.ndarray[Any, Any]) -> 'array.array[Any]':
    return array.array(values.dtype.char, values.tobytes())


def converted(message: Any, type_name: str) -> Any:
    """Any message with the fields of `type_name`, such as rosbags' dataclass, as rclpy's."""
    cls = message_class(type_name)
    if isinstance(message, cls):
        return message
    return cls(**{
        name: _field(getattr(message, name), kind) for name, kind in cls.get_fields_and_field_types().items()
    })


def _field(value: Any, kind: str) -> Any:
    """One field of a kind such as ``double``, ``double[36]``, ``sequence<float>`` or ``std_msgs/Header``."""
    package, nested, name = kind.removeprefix('sequence<').rstrip('>').partition('[')[0].partition('/')
    if not nested:
        is_array = kind.startswith('sequence<') and isinstance(value, np.ndarray)
        return _sequence(value) if is_array else value
    type_name = f'{package}/msg/{name}'
    if kind == f'{package}/{name}':
        return converted(value, type_name)
    return [converted(each, type_name) for each in value]
