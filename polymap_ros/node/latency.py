"""How long a ping takes from its arrival to its place in the map, all waiting included."""

import time
from collections import deque

import numpy as np

KEPT = 1000


class Latency:
    """Latencies of the newest pings."""

    def __init__(self) -> None:
        self._arrivals: dict[int, int] = {}
        self._latencies_s: deque[float] = deque(maxlen=KEPT)

    def arrived(self, stamp_ns: int, received_ns: int) -> None:
        """A ping of this stamp has been received [ns, system clock] by the middleware."""
        if len(self._arrivals) >= KEPT:
            del self._arrivals[next(iter(self._arrivals))]
        self._arrivals[stamp_ns] = received_ns

    def placed(self, stamp_ns: int) -> None:
        """Tell of a ping that has its place in the map."""
        received_ns = self._arrivals.pop(stamp_ns, None)
        if received_ns is not None:
            self._latencies_s.append(1e-9 * (time.time_ns() - received_ns))

    def percentile_s(self, share: float) -> float:
        """Percentile [s] over the newest pings; nan where there was none."""
        return float(np.percentile(self._latencies_s, share)) if self._latencies_s else float('nan')
