"""What is to be done in the executor's thread, after the callbacks that wait."""

import threading
from collections.abc import Callable

from rclpy.node import Node

from polymap_ros.node.stopwatch import Stopwatch


class Later:
    """Jobs for the executor's thread, asked for in any thread and done one by one, messages in between.

    One guard condition serves all of them, since rclpy goes through every entity of a node at each message.

    Parameters
    ----------
    node : Node
        Whose executor it is.
    stopwatch : Stopwatch
        Times the jobs.
    """

    def __init__(self, node: Node, stopwatch: Stopwatch) -> None:
        self._stopwatch = stopwatch
        self._lock = threading.Lock()
        self._jobs: dict[str, Callable[[], None]] = {}
        self._wake = node.create_guard_condition(self._do_next)

    def __call__(self, name: str, job: Callable[[], None]) -> None:
        """Do a job; once, if it is asked for again by the same name before it was begun."""
        with self._lock:
            self._jobs[name] = self._stopwatch.timed(name, job)
        self._wake.trigger()

    def _do_next(self) -> None:
        with self._lock:
            job = self._jobs.pop(next(iter(self._jobs), ''), None)
            if self._jobs:
                self._wake.trigger()
        if job is not None:
            job()
