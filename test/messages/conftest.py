"""Both worlds of messages: rclpy's classes (where installed) and rosbags' dataclasses."""

import importlib.util
from collections.abc import Callable
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)


def make_rosbags(type_name: str, /, **fields: Any) -> Any:
    return STORE.types[type_name](**fields)


def make_rclpy(type_name: str, /, **fields: Any) -> Any:
    from polymap_ros.node.factory import make

    return make(type_name, **fields)


@pytest.fixture(params=['rosbags', 'rclpy'])
def make(request: pytest.FixtureRequest) -> Any:
    if request.param == 'rosbags':
        return make_rosbags
    if importlib.util.find_spec('rclpy') is None:
        pytest.skip('rclpy is not installed')
    return make_rclpy


@pytest.fixture
def transported(make: Any) -> Callable[[Any, str], Any]:
    """Sends a message through its serialised bytes; rosbags reads them, whoever built it."""
    def send(message: Any, type_name: str) -> Any:
        if make is make_rosbags:
            raw = bytes(STORE.serialize_cdr(message, type_name))
        else:
            from rclpy.serialization import serialize_message

            raw = serialize_message(message)
        return STORE.deserialize_cdr(raw, type_name)

    return send


@pytest.fixture
def header(make: Any) -> Any:
    return make('std_msgs/msg/Header', stamp=make('builtin_interfaces/msg/Time', sec=12, nanosec=345),
                frame_id='sonar')
