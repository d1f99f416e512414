"""A bounded, spatially spread choice of the pings whose echoes are kept, so that work and memory do not grow."""

import copy
import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from polymap_ros.hearing.sounding import Sounding

KEPT_PINGS = 96
"""Pings whose echoes are kept: half as many again as the paper's 60 bring the errors down by a fifth."""


class Thinning:
    """Where there are more than `KEPT_PINGS` echoes, one of the two that are closest to each other gives way.

    If the newest is one of them, it is that one: were it the other, the newest ping of a slow drive would drive out the
    one before it again and again. Else it is the one that has a third closer by, so that no gap grows. The first stays:
    all poses are as seen from there.
    """

    def __init__(self, kept: Iterable[Sounding] = ()) -> None:
        self._places = np.empty((0, 2))
        self._gaps: NDArray[np.float64] = np.empty((0, 0))
        self._least = 0.0  # no gap is smaller, once there are as many as are kept
        for sounding in kept:
            self._keep(sounding.x, sounding.y)
        if len(self._places) == KEPT_PINGS:
            self._least = float(self._gaps.min())

    def copy(self) -> 'Thinning':
        """The same state, to go on from apart."""
        return copy.copy(self)

    def wants(self, x: float, y: float) -> bool:
        """Whether a ping from there would be kept; else its echo need not be worked out."""
        return len(self._places) < KEPT_PINGS or bool(self._distances(x, y).min() >= self._least)

    def add(self, soundings: list[Sounding], newest: Sounding, at: tuple[float, float] | None = None) -> None:
        """Take the newest sounding in among those that are kept, as heard `at` a place; one of all may go."""
        x, y = at or (newest.x, newest.y)
        if not self.wants(x, y):
            return
        soundings.append(newest)
        self._keep(x, y)
        if len(soundings) > KEPT_PINGS:
            closest = self._closest()
            del soundings[closest]
            self._places = np.delete(self._places, closest, 0)
            self._gaps = np.delete(np.delete(self._gaps, closest, 0), closest, 1)
            self._least = float(self._gaps.min())

    def moved(self, soundings: Sequence[Sounding], places: Mapping[int, tuple[float, float]]) -> 'Thinning':
        """Return a choice of the same soundings, at the places that are known by stamp."""
        there = [places.get(each.stamp_ns, (each.x, each.y)) for each in soundings]
        return Thinning(dataclasses.replace(each, x=x, y=y) for each, (x, y) in zip(soundings, there, strict=True))

    def _closest(self) -> int:
        first = int(np.argmin(self._gaps.min(axis=1)))
        second = int(np.argmin(self._gaps[first]))
        if second == len(self._gaps) - 1:
            return second
        third = np.partition(self._gaps[[first, second]], 1, axis=1)[:, 1]
        goes, stays = (first, second) if third[0] < third[1] else (second, first)
        return goes or stays

    def _keep(self, x: float, y: float) -> None:
        n = len(self._places)
        gaps = np.full((n + 1, n + 1), np.inf)
        gaps[:n, :n] = self._gaps
        gaps[n, :n] = gaps[:n, n] = self._distances(x, y)
        self._places, self._gaps = np.vstack((self._places, (x, y))), gaps

    def _distances(self, x: float, y: float) -> NDArray[np.float64]:
        """Distances to all that are kept [m]."""
        distances: NDArray[np.float64] = np.hypot(self._places[:, 0] - x, self._places[:, 1] - y)
        return distances
