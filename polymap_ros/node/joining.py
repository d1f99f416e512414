"""Joining ROS: what rcl and the middleware refuse is told in a line."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.exceptions import ParameterException
from rclpy.logging import LoggingSeverity

from polymap_ros.errors import UsageError

_REMEDIES = {
    'No value at line': '; a key with nothing after or below it: indent its parameters below it, or write such as '
                        'solver: {method: paper}',
    'initialize logging': '; set ROS_LOG_DIR to a folder that can be written',
}
"""What most likely is wrong, by what rcl says."""


def init(name: str, arguments: Sequence[str], **options: Any) -> None:
    """rclpy's `init` for a command line.

    Raises
    ------
    UsageError
        For arguments that ROS does not take, or surroundings that it cannot work in.
    """
    rclpy.logging.set_logger_level('rcl', LoggingSeverity.FATAL)  # what it says about arguments, the error says too
    with refusals_told():
        rclpy.init(args=[name, *arguments], **options)
    rclpy.logging.set_logger_level('rcl', LoggingSeverity.UNSET)


@contextmanager
def refusals_told() -> Iterator[None]:
    """What rcl refuses, such as a topic of two types, as `UsageError`, without the places in its sources."""
    try:
        yield
    except UnknownROSArgsError as error:
        raise UsageError(f'unknown ROS arguments: {error}') from error
    except (RCLError, RCLInvalidROSArgsError) as error:
        told = str(error).partition(', at ')[0]
        remedy = next((remedy for words, remedy in _REMEDIES.items() if words in told), '')
        raise UsageError(f'{told}{remedy}') from error
    except ParameterException as error:  # such as use_sim_time:=5
        raise UsageError(str(error)) from error
