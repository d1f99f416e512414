"""A thread for what would keep messages waiting."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from polymap_ros.node.later import Later


class Background:
    """Does jobs in a thread, one after the other, and what is to follow each in the executor's.

    Parameters
    ----------
    later : Later
        The executor's thread.
    follow : callable
        Called in the executor's thread after each job; an error of the job is raised there in its place.
    """

    def __init__(self, later: Later, follow: Callable[[], None]) -> None:
        self._follow = follow
        self._thread = ThreadPoolExecutor(1, thread_name_prefix='background')
        self._jobs: deque[Future[None]] = deque()
        self._later = later

    def __call__(self, job: Callable[[], None]) -> None:
        """Do a job."""
        self._jobs.append(self._thread.submit(job))
        self._jobs[-1].add_done_callback(lambda _: self.again())

    def again(self) -> None:
        """Call `follow` again, after the callbacks that wait."""
        self._later('filter ready', self._end)

    def close(self) -> None:
        """Let the jobs end."""
        self._thread.shutdown()

    def _end(self) -> None:
        while self._jobs and self._jobs[0].done():
            self._jobs.popleft().result()
        self._follow()
