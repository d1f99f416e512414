"""The node's solver: begun when something new came, run in a thread beside the messages."""

import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from rclpy.clock import Clock
from rclpy.node import Node

from polymap_ros.mapping.mapper import PolygonMapper


class SolveLoop:
    """Begins a solve from a timer on the steady clock, so that it goes on when ``/clock`` stands still.

    A solver works on what it copied when it began, so poses and pings never wait for it; only what touches the
    solver itself waits for its current step, see `exclusively`.

    Parameters
    ----------
    node : Node
        Owner of the timer.
    mapper : PolygonMapper
        What is solved.
    steady : Clock
        The steady clock.
    finished : callable
        Called in the executor's thread after each finished solve.

    Attributes
    ----------
    behind : int
        Solves that were due while one was still running.
    solve_s : float
        Duration of the last solve [s].
    problem : str
        Why the last solve failed; empty when it did not.
    """

    def __init__(self, node: Node, mapper: PolygonMapper, steady: Clock, finished: Callable[[], None]) -> None:
        self.behind = 0
        self.solve_s = 0.0
        self.problem = ''
        self._node = node
        self._mapper = mapper
        self._finished = finished
        self._solving = False
        self._solved_pings = 0
        self._number = 0
        self._outcome = 0, 0.0, ''
        self._step = threading.Lock()
        self._running = threading.Event()
        self._running.set()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix='solve')
        self._ended = node.create_guard_condition(self._end)
        self._timer = node.create_timer(1.0, self._begin, clock=steady)

    @property
    def paused(self) -> bool:
        """No solve begins and none advances."""
        return not self._running.is_set()

    @paused.setter
    def paused(self, value: bool) -> None:
        if value:
            self._running.clear()
        else:
            self._running.set()

    def set_period(self, period_s: float) -> None:
        """Change the time between solves [s], from now on."""
        self._timer.timer_period_ns = round(period_s * 1e9)
        self._timer.reset()

    def exclusively(self, change: Callable[[], None]) -> None:
        """Change the mapper or its solver; a solve under way is dropped, and the next comes in any case."""
        with self._step:
            self._number += 1
            change()
        self._solving = False
        self._solved_pings = 0

    def close(self) -> None:
        """Drop the solve under way and end the thread."""
        self.exclusively(lambda: None)
        self._running.set()
        self._thread.shutdown()

    def _begin(self) -> None:
        used = self._mapper.counts.used
        if self.paused or used == self._solved_pings:
            return
        if self._solving:
            self.behind += 1
            return
        with self._step:
            self._number += 1
            self._mapper.begin_solve()
        self._solving, self._solved_pings = True, used
        self._thread.submit(self._solve, self._number)

    def _solve(self, number: int) -> None:
        """Advance to the end, in the thread. A solver that fails costs its answer, not the node and its map."""
        started_s, problem = time.monotonic(), ''
        try:
            while self._advance(number):
                self._running.wait()
        except Exception as error:
            problem = f'the solver failed: {type(error).__name__}: {error}'
            self._node.get_logger().error(f'{problem}\n{traceback.format_exc()}', throttle_duration_sec=10.0)
        self._outcome = number, time.monotonic() - started_s, problem
        self._ended.trigger()

    def _advance(self, number: int) -> bool:
        """One step; False at the end, or where the solve was dropped."""
        with self._step:
            return number == self._number and not self._mapper.advance(1)

    def _end(self) -> None:
        number, self.solve_s, self.problem = self._outcome
        if not self._solving or number != self._number:
            return
        self._solving = False
        if not self.problem:
            self._finished()
