"""Changes of a ring, all of a kind tried: some neighbouring edges exchanged, and an edge broken by a notch."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import crossings
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.rings import PRICE_OF_EDGE, UNEXPLAINED, RingFeet, ring_evidence

_GONE, _COME, _EACH = 4, 3, 2
"""Edges that go are fewer than the first, lines that come fewer than the second; of each kind, and at each place, so
many rings are kept."""

_STEP_M = 0.01
"""Length along a line for which it is known what its feet bring."""

_LEAST_SINE = 0.3
"""Sine of the angle at which a notch leaves an edge, at least."""


def changes(
    pool: NDArray[np.float64], count: int, feet: RingFeet, max_edges: int
) -> list[NDArray[np.int64]]:
    """Return the best rings in which up to three neighbouring edges became up to two lines of the pool (m, 2).

    The ring is the first `count` of the pool; of each kind of change at each place the best two are given.
    """
    scores = np.full((count, _GONE, _COME, _EACH), -np.inf)
    rings = np.full((count, _GONE, _COME, _EACH, count + _COME - 1), -1, np.int64)
    _exchange(pool, count, feet, max_edges, scores, rings)
    known: dict[tuple[int, ...], NDArray[np.int64]] = {}
    for ring in rings[np.isfinite(scores)]:
        numbers = ring[ring >= 0]
        known.setdefault(tuple(np.roll(numbers, -int(np.argmin(numbers))).tolist()), numbers)
    known.pop(tuple(range(count)), None)
    return list(known.values())


@kernel
def _exchange(
    pool: NDArray[np.float64], n: int, feet: RingFeet, max_edges: int, scores: NDArray[np.float64],
    rings: NDArray[np.int64],
) -> None:
    """Fill the best scores and rings of each place, number of edges that go, and of lines that come."""
    trial = np.empty(n + _COME - 1, np.int64)
    for at in range(n):
        for gone in range(_GONE):
            rest = n - gone
            for k in range(rest):
                trial[k] = (at + gone + k) % n
            for come in range(_COME):
                size = rest + come
                if rest < 1 or size < 3 or size > max_edges or (gone == 0 and come == 0):
                    continue
                for a in range(len(pool) if come > 0 else 1):
                    if come > 0:
                        if a == trial[rest - 1] or (come == 1 and a == trial[0]):
                            continue
                        trial[rest] = a
                    for b in range(len(pool) if come > 1 else 1):
                        if come > 1:
                            if b in (a, trial[0]):
                                continue
                            trial[rest + 1] = b
                        value = ring_evidence(pool[trial[:size]], feet)
                        if value > -1e11:
                            _keep(scores[at, gone, come], rings[at, gone, come], value, trial, size)


@kernel
def _keep(
    scores: NDArray[np.float64], rings: NDArray[np.int64], value: float, ring: NDArray[np.int64], size: int
) -> None:
    """Put a ring among the best ones, if it is one."""
    place = len(scores) - 1
    if value <= scores[place]:
        return
    while place > 0 and scores[place - 1] < value:
        scores[place], rings[place] = scores[place - 1], rings[place - 1]
        place -= 1
    scores[place] = value
    rings[place, :size] = ring[:size]
    rings[place, size:] = -1


def notched(
    pool: NDArray[np.float64], ring: NDArray[np.int64], score: float, feet: RingFeet, max_edges: int
) -> tuple[NDArray[np.int64], float]:
    """Break edges by notches of two or three lines of the pool (m, 2) while that brings more than a score."""
    along, gain = crossings(pool, _LEAST_SINE), _gains(pool, feet)
    while True:
        better, value = _notch(pool, along, gain, ring, score, feet, max_edges)
        if value <= score:
            return ring, score
        ring, score = better, value


def _gains(pool: NDArray[np.float64], feet: RingFeet) -> NDArray[np.float64]:
    """Return what the feet of all pings up to a place along each line bring, of those that bring something.

    Shape (m, k); places are `_STEP_M` apart, the middle one is the foot of the origin.
    """
    half = int(np.ceil((np.abs(feet.positions).sum(axis=1).max()) / _STEP_M)) + 1
    gain = np.zeros((len(pool), 2 * half + 1))
    lines, (x, y) = np.arange(len(pool)), feet.positions.T
    for ping in range(len(x)):
        c, s = np.cos(pool[:, 1]), np.sin(pool[:, 1])
        away, place = pool[:, 0] - x[ping] * c - y[ping] * s, y[ping] * c - x[ping] * s
        cell = np.rint(away / feet.cell).astype(int)
        heard = (away > 0.0) & (cell < feet.evidence.shape[1])
        evidence = np.where(heard, feet.evidence[ping, np.where(heard, cell, 0)], 0.0)
        gain[lines, half + np.rint(place / _STEP_M).astype(int)] += np.maximum(evidence, 0.0)
    return np.asarray(np.cumsum(gain, axis=1))


@kernel
def _between(gain: NDArray[np.float64], line: int, start: float, end: float) -> float:
    """Return what feet bring between two places along a line, and a step beyond."""
    half, last = len(gain[0]) // 2, len(gain[0]) - 1
    first = min(max(half + int(np.floor(start / _STEP_M)) - 1, 0), last)
    return float(gain[line, min(max(half + int(np.ceil(end / _STEP_M)) + 1, 0), last)] - gain[line, first])


@kernel
def _notch(
    pool: NDArray[np.float64], along: NDArray[np.float64], gain: NDArray[np.float64], ring: NDArray[np.int64],
    score: float, feet: RingFeet, max_edges: int,
) -> tuple[NDArray[np.int64], float]:
    """Return the best ring in which one edge is broken by a notch, if it is worth more than a score, and its evidence.

    A notch brings no more than its feet, and first echoes that become explained.
    """
    n, m = len(ring), len(pool)
    best, best_score, size = np.zeros(n + 4, np.int64), score, 0
    explained = UNEXPLAINED * len(feet.positions)
    trial, inwards, outwards = np.empty(n + 4, np.int64), np.empty(m, np.int64), np.empty(m, np.int64)
    for at in range(n):
        edge, before, after = ring[at], ring[at - 1], ring[(at + 1) % n]
        ins, outs = 0, 0
        for a in range(m):
            if along[edge, before] < along[edge, a] < along[edge, after]:
                if np.sin(pool[a, 1] - pool[edge, 1]) > 0.0:
                    inwards[ins] = a
                    ins += 1
                else:
                    outwards[outs] = a
                    outs += 1
        for k in range(n):  # the edge itself comes last, and once more behind the notch
            trial[k] = ring[(at + 1 + k) % n]
        for a in inwards[:ins]:
            for c in outwards[:outs]:
                if not along[edge, a] < along[edge, c]:
                    continue
                for b in range(-1, m):
                    count = n + 3 + (b >= 0)
                    if count > max_edges or not _leads(along, edge, a, b, c):
                        continue
                    if b < 0:
                        most = _between(gain, a, along[a, edge], along[a, c]) + _between(
                            gain, c, along[c, a], along[c, edge])
                    else:
                        most = _between(gain, a, along[a, edge], along[a, b]) + _between(
                            gain, b, along[b, a], along[b, c]) + _between(gain, c, along[c, b], along[c, edge])
                    if score + explained + most - PRICE_OF_EDGE * (count - n) < best_score:
                        continue
                    trial[n] = a
                    if b >= 0:
                        trial[n + 1] = b
                    trial[count - 2], trial[count - 1] = c, edge
                    value = ring_evidence(pool[trial[:count]], feet)
                    if value > best_score:
                        best[:count] = trial[:count]
                        best_score, size = value, count
    return best[:size].copy(), best_score


@kernel
def _leads(along: NDArray[np.float64], edge: int, a: int, b: int, c: int) -> bool:
    """Return whether one comes from an edge forwards along a, b, which may be none, and c back to it."""
    if b < 0:
        return bool(along[a, edge] < along[a, c] and along[c, a] < along[c, edge])
    return bool(along[a, edge] < along[a, b] and along[b, a] < along[b, c] and along[c, b] < along[c, edge])
