"""Rings of candidate lines with the most first-order evidence, by simulated annealing from closed walks."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import corners_of
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.rings import RingFeet, ring_evidence

_DRAWS = 13
"""Random numbers of an iteration."""

_HOT = 30.0
"""Temperature at the start [nats], a wall's evidence; at the end it is 1."""

_SPLIT, _BY_FIRST_ECHO = 0.25, 0.5
"""Shares of the changes that break an edge by a notch, and of the others that begin with a line that explains the first
echo of a ping."""

_PINGS_BESIDE = 4
"""Pings before and after that one whose first echoes the further lines of a change explain."""

_EXPLAINING = 12
"""Lines, at most, that explain the first echo of a ping."""


def annealed(
    pool: NDArray[np.float64], evidence: NDArray[np.float64], start: NDArray[np.int64], feet: RingFeet,
    max_edges: int, iterations: int, generator: np.random.Generator,
) -> tuple[NDArray[np.int64], float]:
    """Return the best ring met from a start, as numbers of lines of the pool, and its evidence.

    Parameters
    ----------
    pool : ndarray, shape (m, 2)
        Lines.
    evidence : ndarray, shape (m,)
        By which they are drawn.
    start : ndarray, shape (n,)
        A ring of them.
    """
    chances = np.cumsum(np.sqrt(np.maximum(evidence, 1.0)))
    draws = generator.random((iterations, _DRAWS))
    return _anneal(pool, chances / chances[-1], _explaining(pool, feet), start, feet, max_edges, draws)


def _explaining(lines: NDArray[np.float64], feet: RingFeet) -> NDArray[np.int64]:
    """Return the lines whose foot is at each ping's first range, shape (N, q); -1 where there are no more."""
    away = lines[:, 0] - feet.positions @ np.array((np.cos(lines[:, 1]), np.sin(lines[:, 1])))
    off = np.abs(away - feet.first[:, None])
    order = np.argsort(off, axis=1, kind='stable')[:, :_EXPLAINING]
    return np.asarray(np.where(np.take_along_axis(off, order, 1) <= feet.near, order, -1))


@kernel
def _anneal(
    pool: NDArray[np.float64], chances: NDArray[np.float64], explaining: NDArray[np.int64], start: NDArray[np.int64],
    feet: RingFeet, max_edges: int, draws: NDArray[np.float64],
) -> tuple[NDArray[np.int64], float]:
    ring, trial, come = np.zeros(max_edges + 6, np.int64), np.zeros(max_edges + 6, np.int64), np.zeros(3, np.int64)
    n = len(start)
    ring[:n] = start
    score = ring_evidence(pool[ring[:n]], feet)
    best, best_n, best_score = ring.copy(), n, score
    for step in range(len(draws)):
        draw, temperature = draws[step], _HOT * (1.0 / _HOT) ** (step / len(draws))
        split = draw[11] < _SPLIT
        by_first = split or draw[6] >= 1.0 - _BY_FIRST_ECHO
        gone, more = (0, 2 + int(draw[2] * 2.0)) if split else (int(draw[1] * 4.0), int(draw[2] * 3.0))
        size = n - gone + more + split
        if size < 3 or size > max_edges or gone > n - 1 or (gone == 0 and more == 0):
            continue
        ping = min(int(draw[3] * len(feet.first)), len(feet.first) - 1)
        if not _draw_lines(chances, explaining, ping, by_first, more, draw, come):
            continue
        at = min(int(draw[0] * n), n - 1)
        if more > 0 and by_first:
            at = (_nearest(pool, ring, n, feet, ping, come[0]) - int(draw[1] * 7.0 % 1.0 * (gone + 1))) % n
        for k in range(n - gone):  # an edge that is broken comes last
            trial[k] = ring[(at + gone + k + split) % n]
        for k in range(more):
            trial[n - gone + k] = come[k]
        if split:
            trial[size - 1] = trial[n - 1]
        repeated = False
        for k in range(size):
            repeated = repeated or trial[k] == trial[(k + 1) % size]
        if repeated:
            continue
        value = ring_evidence(pool[trial[:size]], feet)
        if draw[10] < np.exp(min(value - score, 0.0) / temperature):
            ring[:size] = trial[:size]
            n, score = size, value
            if score > best_score:
                best[:] = ring
                best_n, best_score = n, score
    return best[:best_n].copy(), best_score


@kernel
def _draw_lines(
    chances: NDArray[np.float64], explaining: NDArray[np.int64], ping: int, by_first: bool, more: int,
    draw: NDArray[np.float64], come: NDArray[np.int64],
) -> bool:
    """Draw the lines that come into the ring; returns whether there are any to draw."""
    for c in range(more):
        chance = draw[4 + c] if c < 2 else draw[12]
        if not by_first:
            come[c] = min(np.searchsorted(chances, chance), len(chances) - 1)
            continue
        beside = ping
        if c > 0:
            beside += int(draw[6 + c] * (2 * _PINGS_BESIDE + 1)) - _PINGS_BESIDE
        beside %= len(explaining)
        known = 0
        while known < explaining.shape[1] and explaining[beside, known] >= 0:
            known += 1
        if known == 0:
            return False
        come[c] = explaining[beside, min(int(chance * known), known - 1)]
    if more == 2 and draw[9] < 0.5:
        come[0], come[1] = come[1], come[0]
    return True


@kernel
def _nearest(
    pool: NDArray[np.float64], ring: NDArray[np.int64], n: int, feet: RingFeet, ping: int, line: int
) -> int:
    """Return the edge that is nearest to where a line would explain a ping's first echo."""
    theta, away = pool[line, 1], feet.first[ping]
    x, y = feet.positions[ping, 0] + away * np.cos(theta), feet.positions[ping, 1] + away * np.sin(theta)
    _, corners = corners_of(pool[ring[:n]], 0.0)
    best, least = 0, np.inf
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        ex, ey = corners[j, 0] - corners[k, 0], corners[j, 1] - corners[k, 1]
        share = ((x - corners[k, 0]) * ex + (y - corners[k, 1]) * ey) / max(ex * ex + ey * ey, 1e-12)
        share = min(max(share, 0.0), 1.0)
        away = (corners[k, 0] + share * ex - x) ** 2 + (corners[k, 1] + share * ey - y) ** 2
        if away < least:
            best, least = k, away
    return best
