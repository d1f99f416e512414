"""How long a ping takes from its arrival to its place in the map, all waiting included."""

import time
from collections import deque

import numpy as np

from polymap_ros.mapping.mapper import PolygonMapper

KEPT = 1000


class Latency:
    """Latencies of the newest pings.

    Parameters
    ----------
    mapper : PolygonMapper
        Takes the pings; it tells which it has placed.
    """

    def __init__(self, mapper: PolygonMapper) -> None:
        mapper.placed = self._placed
        self._arrivals: dict[int, int] = {}
        self._latencies_s: deque[float] = deque(maxlen=KEPT)

    def arrived(self, stamp_ns: int, received_ns: int) -> None:
        """A ping of this stamp has been received [ns, system clock] by the middleware."""
        if len(self._arrivals) >= KEPT:
            del self._arrivals[next(iter(self._arrivals))]
        self._arrivals[stamp_ns] = received_ns

    def _placed(self, stamp_ns: int) -> None:
        received_ns = self._arrivals.pop(stamp_ns, None)
        if received_ns is not None:
            self._latencies_s.append(1e-9 * (time.time_ns() - received_ns))

    def percentile_s(self, share: float) -> float:
        """Percentile [s] over the newest pings; nan where there was none."""
        return float(np.percentile(self._latencies_s, share)) if self._latencies_s else float('nan')
