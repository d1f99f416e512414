"""Starting and stopping the node."""

import gc
import sys
from collections.abc import Sequence
from contextlib import suppress

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from polymap_ros.errors import UsageError
from polymap_ros.node.joining import init, refusals_told
from polymap_ros.node.node import PolymapNode
from polymap_ros.parameters import NODE_NAME

SWITCH_S = 0.0005
"""Longest time the solver's thread keeps the interpreter while messages wait. With Python's 5 ms every round of the
executor would wait as long, and 200 messages a second would be too many."""

POLL_S = 0.2
"""Longest wait in one go: a signal that arrives just before a wait is seen after it."""


def run(arguments: Sequence[str]) -> None:
    """Run the node until Ctrl-C or SIGTERM, both of which end it in peace.

    Raises
    ------
    PolymapError
        For arguments or parameters that cannot work.
    """
    sys.setswitchinterval(SWITCH_S)
    init(NODE_NAME, arguments)
    try:
        with refusals_told():
            node = PolymapNode(arguments)
        _spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # while the node was being made
    except (RuntimeError, UsageError):  # RCLError, or what pybind11 makes of a call that the shutdown interrupts
        if rclpy.ok():
            raise
    finally:
        with suppress(RCLError):  # shut down by a signal between the look and the act
            rclpy.try_shutdown()


def _spin(node: PolymapNode) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        gc.collect()
        gc.freeze()  # all that was imported; to look through it for garbage takes 50 ms and more
        while rclpy.ok():
            executor.spin_once(timeout_sec=POLL_S)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:  # RCLError, or what pybind11 makes of a call that the shutdown interrupts
        if rclpy.ok():
            raise
    finally:
        executor.shutdown()
        node.close()
        node.destroy_node()
