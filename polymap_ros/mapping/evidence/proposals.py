"""Where walls may be: lines that a run of pings heard, and subsets of them that close (simulated annealing).

A wall is heard at first order by the pings whose perpendicular foot is on it: a contiguous stretch along the line. The
evidence of one foot at distance d is that of power alone, E (1/T - 1/(T + G)) - ln(1 + G/T), G = A g d^-2p expected on
top of T; the evidence of a line is its best contiguous run (Kadane's maximal sum), so that a short edge is not diluted
by the pings that cannot hear it. With the echoes of walls already found in T, only what they leave unexplained counts.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from polymap_ros.jit import kernel
from polymap_ros.mapping.evidence.data import EchoData

_BLANKED = -3.0
"""Evidence of a foot that would have been heard within the blanked range."""

_TURNS = (0.25, 0.5, 0.75)
"""Shares of a corner's turn at which it is cut off."""

_NEARLY_NOTHING = 0.02
"""Share of the strongest echo anywhere below which nothing was heard near by."""


class Candidates(NamedTuple):
    """Lines (n, 2) in falling order of their evidence (n,) [nats]."""

    lines: NDArray[np.float64]
    evidence: NDArray[np.float64]


def foot_evidence(data: EchoData, expected: NDArray[np.float64], strength: float) -> NDArray[np.float64]:
    """Evidence (N, n_cells) of one foot at every range, with `expected` power (broadcast) without it."""
    ranges = np.maximum(np.arange(data.power.shape[1]), 1) * data.cell_m
    share = strength * data.gain[:, None] * ranges ** (-2.0 * data.spreading) / expected
    total = 1.0 + share
    evidence: NDArray[np.float64] = data.power * share / (expected * total) - np.log(total)
    evidence[:, : data.first_cell] = _BLANKED
    return evidence


def first_strength(data: EchoData, expected: NDArray[np.float64]) -> float:
    """Strength A of a first-order echo: the mean over the feet of the four lines with the most evidence.

    The start, the median ping's strongest near echo, is too high where echoes pile up; what is too high hides
    walls, so each round takes the lower of the two.
    """
    ranges = np.arange(data.power.shape[1]) * data.cell_m
    at_one_metre = (data.power - 1.0) * ranges ** (2.0 * data.spreading)
    near = slice(data.first_cell, max(data.first_cell + 8, data.power.shape[1] // 5))
    strength, anywhere = (0.5 * float(np.median(np.max(at_one_metre[:, cells], axis=1)))
                          for cells in (near, slice(data.first_cell, None)))
    if strength < _NEARLY_NOTHING * anywhere:
        strength = anywhere
    strength = max(strength, 1e-6)
    for _ in range(2):
        lines = strongest_lines(data, expected, strength, 4, angles=180).lines
        if len(lines) == 0:
            break
        found = [_run_strength(data, expected, strength, line) for line in lines]
        strength = max(min(strength, float(np.median(found))), 1e-3 * strength)
    return strength


def _run_strength(
    data: EchoData, expected: NDArray[np.float64], strength: float, line: NDArray[np.float64]
) -> float:
    """Strength of a first-order echo over a line's best run."""
    run, cell = _best_run(data, expected, strength, line)
    background = np.broadcast_to(expected, data.power.shape)[run, cell]
    distance = line[0] - data.positions[run] @ np.array([np.cos(line[1]), np.sin(line[1])])
    share = data.gain[run] * distance ** (-2.0 * data.spreading) / background
    return float(np.sum(data.power[run, cell] / background - 1.0) / max(np.sum(share), 1e-300))


def _best_run(
    data: EchoData, expected: NDArray[np.float64], strength: float, line: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pings of the contiguous stretch of feet with the most evidence, and their cells of range."""
    normal, along = np.array([np.cos(line[1]), np.sin(line[1])]), np.array([-np.sin(line[1]), np.cos(line[1])])
    cell = np.rint((line[0] - data.positions @ normal) / data.cell_m).astype(np.int64)
    pings = np.flatnonzero((cell >= data.first_cell) & (cell < data.power.shape[1]))
    pings = pings[np.argsort(data.positions[pings] @ along, kind='stable')]
    total = np.concatenate(([0.0], np.cumsum(foot_evidence(data, expected, strength)[pings, cell[pings]])))
    end = int(np.argmax(total - np.minimum.accumulate(total)))
    run = pings[int(np.argmin(total[: end + 1])):end]
    return run, cell[run]


def strongest_lines(
    data: EchoData, expected: NDArray[np.float64], strength: float, most: int, angles: int = 0
) -> Candidates:
    """Local maxima of the run evidence over all (r, theta), at most `most` of them."""
    if angles == 0:  # so that half a step moves the ends of the path by a quarter of the pulse's width
        angles = int(np.clip(2.0 * np.pi * data.extent_m / data.pulse.width_m, 120, 7200))
    theta = 2.0 * np.pi * np.arange(angles) / angles - np.pi
    along = -np.outer(np.sin(theta), data.positions[:, 0]) + np.outer(np.cos(theta), data.positions[:, 1])
    order = np.argsort(along, axis=1, kind='stable')
    evidence = foot_evidence(data, expected, strength).astype(np.float32)
    scores = np.zeros((angles, data.power.shape[1]), dtype=np.float32)
    _run_scores(evidence, data.positions, data.cell_m, theta, order, scores)
    peaks = (scores == maximum_filter(scores, size=(9, 7), mode=('wrap', 'nearest'))) & (scores > 5.0)
    rows, columns = np.nonzero(peaks)
    best = np.argsort(-scores[rows, columns], kind='stable')[:most]
    lines = np.column_stack((columns[best] * data.cell_m, theta[rows[best]]))
    return Candidates(lines, scores[rows[best], columns[best]].astype(float))


@kernel
def _run_scores(
    evidence: NDArray[np.float32],
    positions: NDArray[np.float64],
    cell: float,
    theta: NDArray[np.float64],
    order: NDArray[np.int64],
    scores: NDArray[np.float32],
) -> None:
    """Best contiguous run of feet for each theta and each r that no position lies beyond."""
    n, cells = evidence.shape
    run = np.empty(cells, np.float32)
    offset = np.empty(n)
    nothing = np.float32(0.0)
    for t in range(len(theta)):
        c, s = np.cos(theta[t]), np.sin(theta[t])
        furthest = 0.0
        for i in range(n):
            offset[i] = positions[i, 0] * c + positions[i, 1] * s
            furthest = max(furthest, offset[i])
        run[:] = 0.0
        low = int(furthest / cell) + 1
        for q in range(n):
            i = order[t, q]
            shift = int(np.floor(-offset[i] / cell + 0.5))
            high = min(cells, cells - shift)
            if high <= low:
                continue
            so_far, best, heard = run[low:high], scores[t, low:high], evidence[i, low + shift:high + shift]
            for j in range(high - low):
                so_far[j] = max(so_far[j] + heard[j], nothing)
                best[j] = max(best[j], so_far[j])


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
    chosen = _anneal(candidates.lines, chances / chances[-1], data.positions, evidence, data.cell_m, price, box,
                     max_edges, draws)
    return np.asarray(chosen)


@kernel
def clipped(
    lines: NDArray[np.float64], chosen: NDArray[np.int64], count: int, box: float, corners: NDArray[np.float64],
    labels: NDArray[np.int64], spare: NDArray[np.float64], spare_labels: NDArray[np.int64],
) -> int:
    """Cut a square of half side `box` by chosen lines; edge i, labelled by its line or -1, starts at corner i."""
    n = 4
    for i in range(4):
        corners[i, 0] = box if 0 < i < 3 else -box
        corners[i, 1] = box if i > 1 else -box
        labels[i] = -1
    for q in range(count):
        r, theta = lines[chosen[q]]
        c, s = np.cos(theta), np.sin(theta)
        m = 0
        for i in range(n):
            j = (i + 1) % n
            here = corners[i, 0] * c + corners[i, 1] * s - r
            there = corners[j, 0] * c + corners[j, 1] * s - r
            if here <= 0.0:
                spare[m, 0], spare[m, 1], spare_labels[m] = corners[i, 0], corners[i, 1], labels[i]
                m += 1
            if (here <= 0.0 < there) or (there < 0.0 < here):
                t = here / (here - there)
                spare[m, 0] = corners[i, 0] + t * (corners[j, 0] - corners[i, 0])
                spare[m, 1] = corners[i, 1] + t * (corners[j, 1] - corners[i, 1])
                spare_labels[m] = q if here <= 0.0 else labels[i]
                m += 1
        n = m
        if n < 3:
            return 0
        for i in range(n):
            corners[i, 0], corners[i, 1], labels[i] = spare[i, 0], spare[i, 1], spare_labels[i]
    return n


@kernel
def _subset_score(
    lines: NDArray[np.float64], chosen: NDArray[np.int64], count: int, box: float, corners: NDArray[np.float64],
    labels: NDArray[np.int64], spare: NDArray[np.float64], spare_labels: NDArray[np.int64],
    positions: NDArray[np.float64], evidence: NDArray[np.float64], cell: float, price: float,
) -> float:
    n = clipped(lines, chosen, count, box, corners, labels, spare, spare_labels)
    if n < 3:
        return -1e12
    total = -price * count
    for i in range(n):
        if labels[i] >= 0:
            j = (i + 1) % n
            total += edge_evidence(lines[chosen[labels[i]]], corners[i], corners[j], positions, evidence, cell)
    return total


@kernel
def edge_evidence(
    line: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64], positions: NDArray[np.float64],
    evidence: NDArray[np.float64], cell: float,
) -> float:
    """First-order evidence of the pings whose foot is between two points of a line."""
    c, s = np.cos(line[1]), np.sin(line[1])
    low, high = start[1] * c - start[0] * s, end[1] * c - end[0] * s
    total = 0.0
    for i in range(len(positions)):
        foot = positions[i, 1] * c - positions[i, 0] * s
        if low <= foot <= high:
            x = (line[0] - (positions[i, 0] * c + positions[i, 1] * s)) / cell
            if x <= 0.0:
                return -1e9
            k = int(x)
            if k < evidence.shape[1] - 1:
                total += evidence[i, k] + (x - k) * (evidence[i, k + 1] - evidence[i, k])
    return total


@kernel
def _anneal(
    lines: NDArray[np.float64], chances: NDArray[np.float64], positions: NDArray[np.float64],
    evidence: NDArray[np.float64], cell: float, price: float, box: float, max_edges: int, draws: NDArray[np.float64],
) -> NDArray[np.int64]:
    size = len(lines) + max_edges + 8
    corners, spare = np.empty((size, 2)), np.empty((size, 2))
    labels, spare_labels = np.empty(size, np.int64), np.empty(size, np.int64)
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
        value = _subset_score(lines, trial, m, box, corners, labels, spare, spare_labels, positions, evidence, cell,
                              price)
        if draws[step, 3] < np.exp(min(value - score, 0.0) / temperature):
            chosen[:] = trial
            count, score = m, value
            if score > best_score:
                best[:] = chosen
                best_count, best_score = count, score
    return best[:best_count].copy()


def strongest_chords(
    data: EchoData, expected: NDArray[np.float64], strength: float, corners: NDArray[np.float64], most: int
) -> NDArray[np.float64]:
    """Lines (n, 2) that cut a polygon between its path and its corners, with the most evidence on their chords."""
    angles = int(np.clip(2.0 * np.pi * data.extent_m / data.pulse.width_m, 120, 360))
    theta = 2.0 * np.pi * np.arange(angles) / angles - np.pi
    normals = np.column_stack((np.cos(theta), np.sin(theta)))
    low = (data.positions @ normals.T).max(axis=0)
    high = np.minimum((corners @ normals.T).max(axis=0), low + data.range_max_m)  # corners may be very far
    count = int(np.ceil(max((high - low).max(), 0.0) / data.cell_m)) + 1  # pings may be outside of the polygon
    r = low[:, None] + (0.5 + np.arange(count)) * data.cell_m
    lines = np.column_stack((r.ravel(), np.repeat(theta, count)))
    evidence = foot_evidence(data, expected, strength)
    scores = chord_evidence(lines, corners, data.positions, evidence, data.cell_m).reshape(angles, count)
    peaks = (scores == maximum_filter(scores, size=(5, 3), mode=('wrap', 'nearest'))) & (scores > -1e8)
    picked = np.flatnonzero(peaks)
    picked = picked[np.argsort(-scores.ravel()[picked], kind='stable')[:most]]
    offsets = np.linspace(-0.5, 0.5, 5)
    near = np.array([(dr * data.cell_m, dtheta * 2.0 * np.pi / angles) for dr in offsets for dtheta in offsets])
    around = lines[picked][:, None, :] + near[None]
    finer = chord_evidence(np.ascontiguousarray(around.reshape(-1, 2)), corners, data.positions, evidence, data.cell_m)
    best = np.argmax(finer.reshape(len(picked), len(near)), axis=1) if len(picked) else np.empty(0, int)
    chosen: NDArray[np.float64] = around[np.arange(len(picked)), best]
    return chosen


@kernel
def chord_evidence(
    pool: NDArray[np.float64], corners: NDArray[np.float64], positions: NDArray[np.float64],
    evidence: NDArray[np.float64], cell: float,
) -> NDArray[np.float64]:
    """First-order evidence of each line on the chord that it cuts from a polygon; -1e9 where it cuts none."""
    gains = np.full(len(pool), -1e9)
    ends = np.empty((2, 2))
    for q in range(len(pool)):
        c, s = np.cos(pool[q, 1]), np.sin(pool[q, 1])
        crossings = 0
        for i in range(len(corners)):
            j = (i + 1) % len(corners)
            here = corners[i, 0] * c + corners[i, 1] * s - pool[q, 0]
            there = corners[j, 0] * c + corners[j, 1] * s - pool[q, 0]
            if (here <= 0.0) != (there <= 0.0):
                # Inside to outside is where the chord starts, counter-clockwise.
                t = here / (here - there)
                end = 0 if here <= 0.0 else 1
                ends[end, 0] = corners[i, 0] + t * (corners[j, 0] - corners[i, 0])
                ends[end, 1] = corners[i, 1] + t * (corners[j, 1] - corners[i, 1])
                crossings += 1
        if crossings != 2:
            continue
        behind = False
        for i in range(len(positions)):
            behind = behind or positions[i, 0] * c + positions[i, 1] * s >= pool[q, 0]
        if not behind:
            gains[q] = edge_evidence(pool[q], ends[0], ends[1], positions, evidence, cell)
    return gains


def corner_cuts(
    theta: NDArray[np.float64], corners: NDArray[np.float64], lengths_m: Sequence[float]
) -> NDArray[np.float64]:
    """Lines (m, 2) that cut each corner off with an edge of each length [m], turned by quarters from wall to wall.

    Parameters
    ----------
    theta : ndarray, shape (n,)
        Normals of the walls [rad].
    corners : ndarray, shape (n, 2)
        Corner i is between walls i - 1 and i.
    lengths_m : sequence of float
        Lengths of the edges.
    """
    turn = np.mod(theta - np.roll(theta, 1), 2.0 * np.pi)
    lines = []
    for share in _TURNS:
        # Height of the triangle that is cut off on an edge of length 1, from the angles there.
        height = 1.0 / (1.0 / np.tan(share * turn) + 1.0 / np.tan((1.0 - share) * turn))
        lines += [across_corners(theta, corners, share, length * height) for length in lengths_m]
    return np.vstack(lines)


def across_corners(
    theta: NDArray[np.float64], corners: NDArray[np.float64], share: float, depth_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """A line (n, 2) across each corner, so far from it (n,) [m], at a share of the turn from wall to wall."""
    before = np.roll(theta, 1)
    angle = before + share * np.mod(theta - before, 2.0 * np.pi)
    r = corners[:, 0] * np.cos(angle) + corners[:, 1] * np.sin(angle) - depth_m
    return np.column_stack((r, np.angle(np.exp(1j * angle))))
