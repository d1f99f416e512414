"""Where walls of an outline that is not convex may be: oriented lines that a run of pings heard.

As in `proposals`, but pings may be beyond a line: a wall may be heard from one part of the room only. Such pings say
nothing of it, and those that hear nothing where its foot should be say little, since another wall may be in the way.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.proposals import Candidates, foot_evidence

_HIDDEN = -2.0
"""Least evidence of a foot [nats]: a wall that is not heard there may be hidden."""

_CAPPED, _CHARGED = 6.0, 1.0
"""Most evidence of a foot [nats] in the second ranking, and what each is charged there: clutter is heard by many pings
a little or by a few loudly, and short walls rank below it otherwise."""

_LEAST_RUN = 5.0
"""Evidence of a run [nats] from which a line is proposed."""


def oriented_lines(
    data: EchoData, expected: NDArray[np.float64], strength: float, most: int
) -> Candidates:
    """Return lines (m, 2) with the most evidence of a run of feet, at most so many by each of two rankings.

    The first of both come first, then the second, and so on. r may be negative: the origin is beyond the line then.
    """
    angles = int(np.clip(2.0 * np.pi * data.extent_m / data.pulse.width_m, 120, 1440))
    theta = 2.0 * np.pi * np.arange(angles) / angles - np.pi
    along = np.outer(np.cos(theta), data.positions[:, 1]) - np.outer(np.sin(theta), data.positions[:, 0])
    order = np.argsort(along, axis=1, kind='stable')
    evidence = np.maximum(foot_evidence(data, expected, strength), _HIDDEN).astype(np.float32)
    capped = np.minimum(evidence, np.float32(_CAPPED)) - np.float32(_CHARGED)
    reach = int(np.ceil(np.abs(data.positions).sum(axis=1).max() / data.cell_m))
    cells = data.power.shape[1] + reach
    ranks: dict[tuple[int, int], tuple[int, float]] = {}
    for each in (evidence, capped):
        scores = np.zeros((angles, reach + cells), np.float32)
        _run_scores(each, data.positions, data.cell_m, theta, order, reach, scores)
        peaks = (scores == maximum_filter(scores, size=(7, 5), mode=('wrap', 'nearest'))) & (scores > _LEAST_RUN)
        best = np.argwhere(peaks)[np.argsort(-scores[peaks], kind='stable')[:most]]
        for rank, (row, column) in enumerate(best.tolist()):
            known = ranks.setdefault((row, column), (rank, float(scores[row, column])))
            ranks[row, column] = min(rank, known[0]), known[1]
    found = sorted(ranks, key=lambda place: (ranks[place][0], place))
    lines = np.array([((column - reach) * data.cell_m, theta[row]) for row, column in found]).reshape(-1, 2)
    return Candidates(lines, np.array([ranks[place][1] for place in found]))


@kernel
def _run_scores(
    evidence: NDArray[np.float32], positions: NDArray[np.float64], cell: float, theta: NDArray[np.float64],
    order: NDArray[np.int64], reach: int, scores: NDArray[np.float32],
) -> None:
    """Best run of feet for each theta and each r from -`reach` cells on, of the pings that are on the inner side."""
    n, cells = evidence.shape
    size = scores.shape[1]
    run = np.empty(size, np.float32)
    nothing = np.float32(0.0)
    for t in range(len(theta)):
        c, s = np.cos(theta[t]), np.sin(theta[t])
        run[:] = 0.0
        for q in range(n):
            i = order[t, q]
            first = reach + int(np.floor((positions[i, 0] * c + positions[i, 1] * s) / cell + 0.5))
            low, high = max(first + 1, 0), min(first + cells, size)
            for j in range(low, high):
                run[j] = max(run[j] + evidence[i, j - first], nothing)
                scores[t, j] = max(scores[t, j], run[j])
