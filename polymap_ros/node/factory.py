"""rclpy's side of the message factory that `polymap_ros.messages` builds through."""

import array
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np


@cache
def message_class(type_name: str) -> Any:
    """The class of a type such as ``sensor_msgs/msg/LaserScan``."""
    package, kind, name = type_name.split('/')
    return getattr(import_module(f'{package}.{kind}'), name)


def make(type_name: str, /, **fields: Any) -> Any:
    """Build a message; numpy arrays become arrays of the field's type, which rclpy takes without a copy per number."""
    cls = message_class(type_name)
    types = cls.get_fields_and_field_types()
    return cls(**{
        name: _sequence(value) if isinstance(value, np.ndarray) and types[name].startswith('sequence') else value
        for name, value in fields.items()
    })


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
