"""Starting and stopping the node."""

from collections.abc import Sequence

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from polymap_ros.errors import UsageError
from polymap_ros.node.node import PolymapNode
from polymap_ros.parameters import NODE_NAME

POLL_S = 0.2
"""Longest wait in one go: a signal that arrives just before a wait is seen after it."""


def run(arguments: Sequence[str]) -> None:
    """Run the node until Ctrl-C or SIGTERM, both of which end it in peace.

    Raises
    ------
    PolymapError
        For arguments or parameters that cannot work.
    """
    try:
        rclpy.init(args=[NODE_NAME, *arguments])
    except (RCLError, RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        raise UsageError(f'{str(error).partition(", at ")[0]}') from error
    try:
        _spin(PolymapNode(arguments))
    finally:
        rclpy.try_shutdown()


def _spin(node: PolymapNode) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=POLL_S)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RCLError:
        if rclpy.ok():
            raise
    finally:
        executor.shutdown()
        node.close()
        node.destroy_node()
