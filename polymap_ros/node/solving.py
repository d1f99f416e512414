"""The node's solver: begun when something new came, advanced in slices between the messages."""

import time
from collections.abc import Callable

from rclpy.clock import Clock
from rclpy.node import Node

from polymap_ros.mapping.mapper import PolygonMapper

SLICE_S = 0.002
"""Solver time per slice; a step of the solver that takes longer ends it."""

SLICE_PERIOD_S = 0.005
"""Time between slices: what is left of it belongs to the messages."""


class SolveLoop:
    """Two timers on the steady clock, so that they go on when ``/clock`` stands still.

    Parameters
    ----------
    node : Node
        Owner of the timers.
    mapper : PolygonMapper
        What is solved.
    steady : Clock
        The steady clock.
    finished : callable
        Called after each finished solve.

    Attributes
    ----------
    paused : bool
        No solve begins and none advances.
    behind : int
        Solves that were due while one was still running.
    solve_s, slowest_slice_s : float
        Duration of the last solve and of the longest slice [s].
    """

    def __init__(self, node: Node, mapper: PolygonMapper, steady: Clock, finished: Callable[[], None]) -> None:
        self.paused = False
        self.behind = 0
        self.solve_s = self.slowest_slice_s = 0.0
        self._mapper = mapper
        self._finished = finished
        self._solving = False
        self._begun_s = 0.0
        self._solved_pings = 0
        self._begin_timer = node.create_timer(1.0, self._begin, clock=steady)
        self._slice_timer = node.create_timer(SLICE_PERIOD_S, self._slice, clock=steady)
        self._slice_timer.cancel()

    def set_period(self, period_s: float) -> None:
        """Change the time between solves [s], from now on."""
        self._begin_timer.timer_period_ns = round(period_s * 1e9)
        self._begin_timer.reset()

    def solve_again(self) -> None:
        """Solve at the next occasion, new pings or not; what is under way is dropped."""
        self._solving = False
        self._solved_pings = 0
        self._slice_timer.cancel()

    def _begin(self) -> None:
        used = self._mapper.counts.used
        if self.paused or used == self._solved_pings:
            return
        if self._solving:
            self.behind += 1
            return
        self._solved_pings = used
        self._begun_s = time.monotonic()
        self._mapper.begin_solve()
        self._solving = True
        self._slice_timer.reset()

    def _slice(self) -> None:
        if self.paused:
            return
        started_s = time.monotonic()
        done = False
        while not done and time.monotonic() - started_s < SLICE_S:
            done = self._mapper.advance(1)
        now_s = time.monotonic()
        self.slowest_slice_s = max(self.slowest_slice_s, now_s - started_s)
        if done:
            self._solving = False
            self._slice_timer.cancel()
            self.solve_s = now_s - self._begun_s
            self._finished()
