"""A bounded, spatially spread choice of the pings whose echoes are kept, so that work and memory do not grow."""

import copy
import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.sounding import Sounding

KEPT_PINGS = 96
"""Pings whose echoes are kept: half as many again as the paper's 60 bring the errors down by a fifth."""

_NO_ECHO, _NO_ENVELOPE = np.empty(0, np.complex64), np.empty(0, np.float32)
"""The same for all that gave way: a long drive has many of them."""


class Thinning:
    """Where there are more than `KEPT_PINGS` echoes, one of the two that are closest to each other gives way.

    If the newest is one of them, it is that one: were it the other, the newest ping of a slow drive would drive out the
    one before it again and again. Else it is the one that has a third closer by, so that no gap grows.
    """

    def __init__(self) -> None:
        self._kept: list[int] = []
        self._places = np.empty((0, 2))
        self._gaps: NDArray[np.float64] = np.empty((0, 0))
        self._least = 0.0  # no gap is smaller, once there are as many as are kept

    @classmethod
    def of(cls, soundings: Sequence[Sounding]) -> 'Thinning':
        """The state in which these soundings were left."""
        thinning = cls()
        for index, sounding in enumerate(soundings):
            if sounding.echo.size:
                thinning._keep(index, sounding)
        return thinning

    def copy(self) -> 'Thinning':
        """The same state, to go on from apart."""
        twin = copy.copy(self)
        twin._kept = list(self._kept)
        return twin

    def add(self, soundings: list[Sounding]) -> None:
        """Take the newest sounding in; another one may lose its echo."""
        newest = len(soundings) - 1
        if len(self._kept) == KEPT_PINGS and self._distances(soundings[newest]).min() < self._least:
            index = newest
        else:
            self._keep(newest, soundings[newest])
            if len(self._kept) <= KEPT_PINGS:
                return
            closest = self._closest()
            index = self._kept.pop(closest)
            self._places = np.delete(self._places, closest, 0)
            self._gaps = np.delete(np.delete(self._gaps, closest, 0), closest, 1)
            self._least = float(self._gaps.min())
        soundings[index] = dataclasses.replace(soundings[index], echo=_NO_ECHO, envelope=_NO_ENVELOPE)

    def _closest(self) -> int:
        first = int(np.argmin(self._gaps.min(axis=1)))
        second = int(np.argmin(self._gaps[first]))
        if second == len(self._gaps) - 1:
            return second
        third = np.partition(self._gaps[[first, second]], 1, axis=1)[:, 1]
        return first if third[0] < third[1] else second

    def _keep(self, index: int, sounding: Sounding) -> None:
        n = len(self._kept)
        gaps = np.full((n + 1, n + 1), np.inf)
        gaps[:n, :n] = self._gaps
        gaps[n, :n] = gaps[:n, n] = self._distances(sounding)
        self._kept.append(index)
        self._places, self._gaps = np.vstack((self._places, (sounding.x, sounding.y))), gaps

    def _distances(self, sounding: Sounding) -> NDArray[np.float64]:
        """Distances to all that are kept [m]."""
        distances: NDArray[np.float64] = np.hypot(self._places[:, 0] - sounding.x, self._places[:, 1] - sounding.y)
        return distances
