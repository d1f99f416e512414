"""What the commands that need ROS share: telling ROS's arguments from ours, and saying how to get ROS."""

import importlib.util
from collections.abc import Sequence

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


def require_ros() -> None:
    """Raise `UsageError` with the remedy where rclpy is not installed."""
    if importlib.util.find_spec('rclpy') is None:
        raise UsageError("rclpy is not installed: source /opt/ros/jazzy/setup.bash, or pip install 'polymap_ros[ros]'")
