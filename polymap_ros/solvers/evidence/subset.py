"""The subset of candidate lines with the most first-order evidence, by simulated annealing."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import normals_of, part_within
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.proposals import Candidates, Feet, edge_evidence


def annealed_subset(
    data: EchoData, candidates: Candidates, evidence: NDArray[np.float64], price: float, max_edges: int,
    iterations: int, generator: np.random.Generator,
) -> NDArray[np.int64]:
    """The subset of candidates with the most first-order evidence, each foot on its finite edge, less the price.

    Simulated annealing over add, drop and exchange, from a temperature of 30 nats (a wall's evidence) to 1.

    Returns
    -------
    ndarray, shape (n,)
        Indices of the candidates; their lines need not close.
    """
    if len(candidates.lines) == 0:
        return np.empty(0, np.int64)
    chances = np.cumsum(np.sqrt(candidates.evidence))
    draws = generator.random((iterations, 4))
    box = 2.0 * (data.range_max_m + data.extent_m)
    feet = Feet(data.positions, data.baselines, evidence, data.cell_m)
    chosen = _anneal(candidates.lines, chances / chances[-1], feet, price, box, max_edges, draws)
    return np.asarray(chosen)


@kernel
def _subset_score(rows: NDArray[np.float64], count: int, feet: Feet, price: float) -> float:
    """Return the evidence of the first `count` lines (r, cos, sin) on their edges in the box of the last four."""
    total, bounded = -price * count, False
    for i in range(count):
        low, high = part_within(rows[i, 0], rows[i, 1], rows[i, 2], rows, i)
        if low < high:
            bounded = True
            total += edge_evidence(rows[i, 0], rows[i, 1], rows[i, 2], low, high, feet)
    for i in range(0 if bounded else count, len(rows)):
        low, high = part_within(rows[i, 0], rows[i, 1], rows[i, 2], rows, i)
        bounded = bounded or low < high
    return total if bounded else -1e12


@kernel
def _anneal(
    lines: NDArray[np.float64], chances: NDArray[np.float64], feet: Feet, price: float, box: float, max_edges: int,
    draws: NDArray[np.float64],
) -> NDArray[np.int64]:
    table, rows = normals_of(lines), np.zeros((max_edges + 5, 3))
    sides = np.array([[box, 1.0, 0.0], [box, 0.0, 1.0], [box, -1.0, 0.0], [box, 0.0, -1.0]])
    chosen, trial = np.zeros(max_edges + 1, np.int64), np.zeros(max_edges + 1, np.int64)
    count, score = 0, 0.0
    best, best_count, best_score = chosen.copy(), 0, 0.0
    iterations = len(draws)
    for step in range(iterations):
        temperature = 30.0 * (1.0 / 30.0) ** (step / iterations)
        trial[:] = chosen
        m = count
        pick = min(np.searchsorted(chances, draws[step, 0]), len(lines) - 1)
        known = False
        for i in range(count):
            known = known or chosen[i] == pick
        slot = int(draws[step, 2] * count)
        if draws[step, 1] < 0.35:
            if known or m >= max_edges:
                continue
            trial[m] = pick
            m += 1
        elif m == 0:
            continue
        elif draws[step, 1] < 0.6:
            m -= 1
            trial[slot] = trial[m]
        else:
            if known:
                continue
            trial[slot] = pick
        for i in range(m):
            rows[i] = table[trial[i]]
        rows[m:m + 4] = sides
        value = _subset_score(rows[:m + 4], m, feet, price)
        if draws[step, 3] < np.exp(min(value - score, 0.0) / temperature):
            chosen[:] = trial
            count, score = m, value
            if score > best_score:
                best[:] = chosen
                best_count, best_score = count, score
    return best[:best_count].copy()
