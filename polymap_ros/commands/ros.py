"""What the commands that need ROS share: telling ROS's arguments from ours, and saying how to get ROS."""

import importlib.util
from collections.abc import Sequence
from itertools import pairwise

from polymap_ros.errors import UsageError


def without_ros_arguments(arguments: Sequence[str]) -> list[str]:
    """What is left without the stretches from ``--ros-args`` to ``--`` or the end."""
    ours, within = [], False
    for argument in arguments:
        if argument == '--ros-args':
            within = True
        elif within and argument == '--':
            within = False
        elif not within:
            ours.append(argument)
    return ours


def refuse_ros_arguments(ours: Sequence[str], options: Sequence[str]) -> int:
    """Return 0, or raise `UsageError` with the remedy for ROS's options that do not follow ``--ros-args``."""
    for option, value in pairwise([*ours, '']):
        if option in options:
            given = f'{option} {value}'.strip()
            raise UsageError(f"{given}: ROS's own arguments follow --ros-args, as in --ros-args {given}")
    return 0


def require_ros() -> None:
    """Raise `UsageError` with the remedy where rclpy is not installed."""
    if importlib.util.find_spec('rclpy') is None:
        raise UsageError("rclpy is not installed: source /opt/ros/jazzy/setup.bash, or pip install 'polymap_ros[ros]'")
