"""How long the node's callbacks take: so long messages wait."""

import functools
import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec('P')
T = TypeVar('T')


class Stopwatch:
    """Times callbacks.

    Attributes
    ----------
    longest_s : float
        Longest time that a callback took since the start [s].
    longest : str
        Its name.
    """

    def __init__(self) -> None:
        self.longest_s = 0.0
        self.longest = ''
        self._recent_s = 0.0

    def timed(self, name: str, callback: Callable[P, T]) -> Callable[P, T]:
        """The same callback, timed under a name."""
        @functools.wraps(callback)  # rclpy looks at the signature
        def run(*args: P.args, **kwargs: P.kwargs) -> T:
            started_s = time.monotonic()
            try:
                return callback(*args, **kwargs)
            finally:
                self._note(name, time.monotonic() - started_s)

        return run

    def recent_s(self) -> float:
        """Longest time [s] since this was last asked."""
        recent_s, self._recent_s = self._recent_s, 0.0
        return recent_s

    def _note(self, name: str, taken_s: float) -> None:
        self._recent_s = max(self._recent_s, taken_s)
        if taken_s > self.longest_s:
            self.longest_s, self.longest = taken_s, name
