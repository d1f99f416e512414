"""Starting and stopping the node."""

import gc
import signal
import sys
import threading
import time
from collections.abc import Sequence

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from polymap_ros.errors import UsageError
from polymap_ros.node.joining import init, refusals_told
from polymap_ros.node.node import PolymapNode
from polymap_ros.parameters import NODE_NAME

SWITCH_S = 0.0005
"""Longest time the solver's thread keeps the interpreter while messages wait. With Python's 5 ms every round of the
executor would wait as long, and 200 messages a second would be too many."""

POLL_S = 0.2
"""Longest wait in one go: Python hears of a signal after it."""

ANSWER_S = 20.0
"""Longest time that the end waits for a save that a client asked for: its answer says where the files are."""


def run(arguments: Sequence[str]) -> None:
    """Run the node until Ctrl-C, SIGTERM or a terminal that closes, all of which end it in peace.

    Raises
    ------
    PolymapError
        For arguments or parameters that cannot work.
    KeyboardInterrupt
        For a signal while the node is being made.
    """
    sys.setswitchinterval(SWITCH_S)
    # rclpy's own handlers shut it down in the middle of a callback, and leave the next signal to Python.
    init(NODE_NAME, arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        with refusals_told():
            node = PolymapNode(arguments)
        _spin(node, _ending())
    except (RuntimeError, UsageError):  # RCLError, or what pybind11 makes of a call that a shutdown interrupts
        if rclpy.ok():
            raise
    finally:
        rclpy.try_shutdown()


def _ending() -> threading.Event:
    """Set by the first signal that is to end the node; what comes later does not cut short what is being saved."""
    ending = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, lambda *_: ending.set())
    return ending


def _spin(node: PolymapNode, ending: threading.Event) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        gc.collect()
        gc.freeze()  # all that was imported; to look through it for garbage takes 50 ms and more
        while rclpy.ok() and not ending.is_set():
            executor.spin_once(timeout_sec=POLL_S)
        last_s = time.monotonic() + ANSWER_S
        while rclpy.ok() and node.answering and time.monotonic() < last_s:
            executor.spin_once(timeout_sec=POLL_S)
    finally:
        executor.shutdown()
        node.close()
        node.destroy_node()
