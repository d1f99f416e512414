"""Where walls of an outline that is not convex may be: oriented lines that a run of pings heard.

As in `proposals`, but pings may be beyond a line: a wall may be heard from one part of the room only. Such pings say
nothing of it, and those that hear nothing where its foot should be say little, since another wall may be in the way.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from polymap_ros.geometry.lines import wrapped
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

_TELLING = 4
"""Lines of each quarter turn by which a direction is chosen."""


def oriented_lines(
    data: EchoData, expected: NDArray[np.float64], strength: float, most: int
) -> Candidates:
    """Return lines (m, 2) with the most evidence of a run of feet, at most so many by each of two rankings.

    The first of both come first, then the second, and so on. r may be negative: the origin is beyond the line then.
    """
    theta = _angles(data)
    evidence = _foot_evidence(data, expected, strength)
    capped = np.minimum(evidence, np.float32(_CAPPED)) - np.float32(_CHARGED)
    reach = _reach(data)
    ranks: dict[tuple[int, int], tuple[int, float]] = {}
    for each in (evidence, capped):
        scores = _scores(data, each, theta, reach)
        peaks = (scores == maximum_filter(scores, size=(7, 5), mode=('wrap', 'nearest'))) & (scores > _LEAST_RUN)
        best = np.argwhere(peaks)[np.argsort(-scores[peaks], kind='stable')[:most]]
        for rank, (row, column) in enumerate(best.tolist()):
            known = ranks.setdefault((row, column), (rank, float(scores[row, column])))
            ranks[row, column] = min(rank, known[0]), known[1]
    found = sorted(ranks, key=lambda place: (ranks[place][0], place))
    lines = np.array([((column - reach) * data.cell_m, theta[row]) for row, column in found]).reshape(-1, 2)
    return Candidates(lines, np.array([ranks[place][1] for place in found]))


def main_direction(data: EchoData, expected: NDArray[np.float64], strength: float) -> float:
    """Return the direction [rad], up to right angles, along which lines were heard best."""
    evidence, angles = _foot_evidence(data, expected, strength), _angles(data)
    scores, peaks = _peaks_by_direction(data, evidence, angles)
    best = np.sort(np.where(peaks, scores, 0.0), axis=1)[:, -_TELLING:].sum(axis=1)
    return float(angles[int(np.argmax(best.reshape(4, -1).sum(axis=0)))])


def aligned_lines(
    data: EchoData, expected: NDArray[np.float64], strength: float, direction: float, most: int
) -> Candidates:
    """Return lines (m, 2) parallel and perpendicular to a direction [rad], at most so many of each quarter turn.

    Where the direction is known, a wall that a few pings heard, or that is heard in two places, stands out from what
    is clutter in some other direction: plates and rooms have right angles more often than not.
    """
    theta = wrapped(direction + 0.5 * np.pi * np.arange(4))
    scores, peaks = _peaks_by_direction(data, _foot_evidence(data, expected, strength), theta)
    found = []
    for row in range(len(theta)):
        columns = np.flatnonzero(peaks[row])
        columns = columns[np.argsort(-scores[row, columns], kind='stable')][:most]
        found += [((column - _reach(data)) * data.cell_m, theta[row], scores[row, column]) for column in columns]
    table = np.array(found, float).reshape(-1, 3)
    return Candidates(table[:, :2], table[:, 2])


def _peaks_by_direction(
    data: EchoData, evidence: NDArray[np.float32], theta: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return `_scores`, and where each direction has a local maximum over r."""
    scores = _scores(data, evidence, theta, _reach(data))
    return scores, (scores == maximum_filter(scores, size=(1, 5), mode='nearest')) & (scores > _LEAST_RUN)


def _foot_evidence(data: EchoData, expected: NDArray[np.float64], strength: float) -> NDArray[np.float32]:
    return np.maximum(foot_evidence(data, expected, strength), _HIDDEN).astype(np.float32)


def _angles(data: EchoData) -> NDArray[np.float64]:
    """Return the directions that are tried (4 n,) [rad]: between two, the path's ends move a pulse's width at most."""
    angles = 4 * int(np.clip(0.5 * np.pi * data.extent_m / data.pulse.width_m, 30, 360))
    return np.asarray(2.0 * np.pi * np.arange(angles) / angles - np.pi)


def _reach(data: EchoData) -> int:
    """Return how many cells of r below 0 a line may have."""
    return int(np.ceil(np.abs(data.positions).sum(axis=1).max() / data.cell_m))


def _scores(
    data: EchoData, evidence: NDArray[np.float32], theta: NDArray[np.float64], reach: int
) -> NDArray[np.float32]:
    """Return the evidence (len(theta), cells) of the best run of feet at every r from -`reach` cells on."""
    along = np.outer(np.cos(theta), data.positions[:, 1]) - np.outer(np.sin(theta), data.positions[:, 0])
    order = np.argsort(along, axis=1, kind='stable')
    scores = np.zeros((len(theta), 2 * reach + data.power.shape[1]), np.float32)
    _run_scores(evidence, data.positions, data.cell_m, theta, order, reach, scores)
    return scores


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
