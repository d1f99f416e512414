"""Pings that were not where the odometry says: kept from solve to solve, so that later ones join them."""

from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.evidence.positions import Placed, drift, join, place
from polymap_ros.mapping.evidence.search import Found, Search

_MOVABLE = 12
"""Pings from which they may be moved: fewer can be bent to a wrong polygon."""

_BY_CHANCE = 2.0
"""Nats per ping that moving it may bring although it is where it was reported: twice the mean of two coordinates'."""

Answer = Generator[None, None, tuple[Search, Found | None]]


class MovedPings:
    """The moves of pings, and the searches over the pings where they were found to be.

    Methods take the search over the pings as `reported`, and their `stamps`; they give a search and what it found.
    """

    def __init__(self) -> None:
        self._moves: dict[int, NDArray[np.float64]] = {}  # by stamp [m]

    def again(self, reported: Search, stamps: list[int], last: Found | None) -> Answer:
        """The last answer, with the pings of today where they were found to be."""
        if last is None:
            return reported, None
        if not last.misplaced_m or last.wave is None:
            return reported, (yield from reported.again(last))
        unknown = np.full(2, np.nan)
        placed = yield from join(reported, last, np.array([self._moves.get(stamp, unknown) for stamp in stamps]))
        return (reported, None) if placed is None else self._keep(placed, reported, stamps)

    def moved(self, reported: Search, stamps: list[int], search: Search, found: Found, enough: float) -> Answer:
        """An answer with the pings moved, where that lets the echoes agree and is needed; else as it is."""
        if not reported.coherent or len(stamps) < _MOVABLE:
            return search, found
        placed = yield from place(reported, found)
        if placed is None or (found.wave is not None and placed.found.explained <= enough):
            return search, found
        unmoved = yield from reported.again(placed.found)
        by_chance = _BY_CHANCE * len(stamps)
        if unmoved is not None and unmoved.wave is not None and unmoved.value > placed.found.value - by_chance:
            return reported, unmoved  # only the walls were off
        return self._keep(placed, reported, stamps)

    def _keep(self, placed: Placed, reported: Search, stamps: list[int]) -> tuple[Search, Found]:
        """Where the pings are, for the next solve."""
        self._moves = dict(zip(stamps, placed.search.data.positions - reported.data.positions, strict=True))
        return placed.search, placed.found._replace(misplaced_m=placed.deviation_m)

    def drift(self, search: Search) -> bool:
        """Whether the moves look like a drift's, not like noise, in a search that was given by this."""
        moves = np.array(list(self._moves.values()))
        return drift(np.array(list(self._moves), float), search.data.positions - moves, moves)
