"""A thread for what would keep messages waiting."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from rclpy.node import Node

from polymap_ros.node.stopwatch import Stopwatch


class Background:
    """Does jobs in a thread, one after the other, and what is to follow each in the executor's.

    Parameters
    ----------
    node : Node
        Whose executor it is.
    stopwatch : Stopwatch
        Times what follows.
    follow : callable
        Called in the executor's thread after each job; an error of the job is raised there in its place.
    """

    def __init__(self, node: Node, stopwatch: Stopwatch, follow: Callable[[], None]) -> None:
        self._follow = follow
        self._thread = ThreadPoolExecutor(1, thread_name_prefix='background')
        self._jobs: deque[Future[None]] = deque()
        self._ended = node.create_guard_condition(stopwatch.timed('filter ready', self._end))

    def __call__(self, job: Callable[[], None]) -> None:
        """Do a job."""
        self._jobs.append(self._thread.submit(job))
        self._jobs[-1].add_done_callback(lambda _: self._ended.trigger())

    def again(self) -> None:
        """Call `follow` again, after the callbacks that wait."""
        self._ended.trigger()

    def close(self) -> None:
        """Let the jobs end."""
        self._thread.shutdown()

    def _end(self) -> None:
        while self._jobs and self._jobs[0].done():
            self._jobs.popleft().result()
        self._follow()
