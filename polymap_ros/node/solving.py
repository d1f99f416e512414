"""The node's solver: begun when something new came, run in a thread beside the messages."""

import threading
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

from rclpy.clock import Clock
from rclpy.node import Node

from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.node.later import Later
from polymap_ros.node.stopwatch import Stopwatch
from polymap_ros.solvers.checkpoint import Stopped


class _Outcome(NamedTuple):
    number: int
    taken_s: float
    problem: str
    twin: PolygonMapper | None = None
    messages: Sequence[Any] = ()


class SolveLoop:
    """Begins a solve from a timer on the steady clock, so that it goes on when ``/clock`` stands still.

    A solve works on a twin of the mapper, so poses, pings, a reset and a change of parameters never wait for it.

    Parameters
    ----------
    node : Node
        Owner of the timer.
    mapper : PolygonMapper
        What is solved.
    steady : Clock
        The steady clock.
    later : Later
        The executor's thread.
    stopwatch : Stopwatch
        Times the callbacks.
    drawn : callable
        Called in the thread with the solved twin; returns the messages to publish.
    finished : callable
        Called with them in the executor's thread, after the mapper has got its estimate.

    Attributes
    ----------
    behind : int
        Solves that were due while one was still running.
    solve_s : float
        Duration of the last solve [s].
    problem : str
        Why the last solve failed; empty when it did not.
    """

    def __init__(
        self, node: Node, mapper: PolygonMapper, steady: Clock, later: Later, stopwatch: Stopwatch,
        drawn: Callable[[PolygonMapper], Sequence[Any]], finished: Callable[[Sequence[Any]], None],
    ) -> None:
        self.behind = 0
        self.solve_s = 0.0
        self.problem = ''
        self._node = node
        self._mapper = mapper
        self._drawn = drawn
        self._finished = finished
        self._solving = False
        self._solved_pings = 0
        self._number = 0
        self._begun_s = self._late_s = 0.0
        self._outcome = _Outcome(0, 0.0, '')
        self._running = threading.Event()
        self._running.set()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix='solve')
        self._later = later
        self._timer = node.create_timer(1.0, stopwatch.timed('begin of a solve', self._begin), clock=steady)

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

    def pace(self) -> str:
        """How long a solve had taken when the last one came due that had to wait for it."""
        period_s = 1e-9 * self._timer.timer_period_ns
        return f'a solve was not done after {self._late_s:.2f} s; one is due every {period_s:g} s (solver.period_s)'

    def drop(self) -> None:
        """Drop a solve under way, which ends at its next checkpoint; the next solve comes in any case."""
        self._number += 1
        self._solving = False
        self._solved_pings = 0

    def close(self) -> None:
        """Drop the solve under way and end the thread."""
        self.drop()
        self._running.set()
        self._thread.shutdown()

    def _begin(self) -> None:
        used = self._mapper.counts.used
        if self.paused or self._mapper.intake.held or used == self._solved_pings:
            return
        if self._solving:
            self.behind += 1
            self._late_s = time.monotonic() - self._begun_s
            return
        self._number += 1
        self._solving, self._solved_pings, self._begun_s = True, used, time.monotonic()
        self._thread.submit(self._solve, self._number, self._mapper.twin())

    def _solve(self, number: int, twin: PolygonMapper) -> None:
        """Solve, in the thread. A solver that fails costs its answer, not the node and its map."""
        started_s, estimate = time.monotonic(), None
        try:
            estimate = twin.solve(lambda: self._wait_or_stop(number))
            taken_s = time.monotonic() - started_s
            self._outcome = _Outcome(number, taken_s, '', twin, self._drawn(twin))
        except Stopped:
            return
        except Exception as error:
            failed = 'the solver failed' if estimate is None else 'the answer cannot be shown'
            problem = f'{failed}: {type(error).__name__}: {error}'
            self._node.get_logger().error(f'{problem}\n{traceback.format_exc()}', throttle_duration_sec=10.0)
            self._outcome = _Outcome(number, time.monotonic() - started_s, problem, twin if estimate else None)
        self._later('end of a solve', self._end)

    def _wait_or_stop(self, number: int) -> None:
        """The checkpoint of a solve, in the thread."""
        self._running.wait()
        if number != self._number:
            raise Stopped

    def _end(self) -> None:
        outcome = self._outcome
        if not self._solving or outcome.number != self._number:
            return
        self._solving = False
        self.solve_s, self.problem = outcome.taken_s, outcome.problem
        if outcome.twin is not None:
            self._mapper.adopt(outcome.twin)
            self._finished(outcome.messages)
