"""Where walls may be: lines that a run of pings heard, and chords of a polygon.

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

from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.outline import corners_of, normals_of, part_within
from polymap_ros.geometry.paths import first_order, first_orders
from polymap_ros.jit import kernel, within_kernels
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.power_sums import more_power

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


class Feet(NamedTuple):
    """Where pings are, and the evidence (N, n_cells) of one foot of each at every range; cells are `cell` apart."""

    positions: NDArray[np.float64]
    baselines: NDArray[np.float64]
    evidence: NDArray[np.float64]
    cell: float


def foot_evidence(data: EchoData, expected: NDArray[np.float64], strength: float) -> NDArray[np.float64]:
    """Evidence (N, n_cells) of one foot at every range, with `expected` power (broadcast) without it."""
    ranges = np.maximum(np.arange(data.power.shape[1]), 1) * data.cell_m
    echo = strength * data.gain[:, None] * ranges ** (-2.0 * data.spreading)
    linear, ratio = more_power(data.power, np.broadcast_to(expected, data.power.shape), echo)
    evidence = np.clip(linear - np.log(ratio), *data.foot_limits)
    evidence[:, : data.first_cell] = _BLANKED
    return evidence


def feet_of(data: EchoData, expected: NDArray[np.float64], strength: float) -> Feet:
    """Return where the pings are, with the evidence of their feet as `foot_evidence` gives it."""
    return Feet(data.positions, data.baselines, foot_evidence(data, expected, strength), data.cell_m)


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
    distance, _ = first_orders(line, data.positions[run], data.baselines[run])
    share = data.gain[run] * distance ** (-2.0 * data.spreading) / background
    return float(np.sum(data.power[run, cell] / background - 1.0) / max(np.sum(share), 1e-300))


def _best_run(
    data: EchoData, expected: NDArray[np.float64], strength: float, line: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pings of the contiguous stretch of feet with the most evidence, and their cells of range."""
    half, along = first_orders(line, data.positions, data.baselines)
    cell = np.rint(half / data.cell_m).astype(np.int64)
    pings = np.flatnonzero((cell >= data.first_cell) & (cell < data.power.shape[1]))
    pings = pings[np.argsort(along[pings], kind='stable')]
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
    evidence = _by_distance(data, foot_evidence(data, expected, strength)).astype(np.float32)
    scores = np.zeros((angles, data.power.shape[1]), dtype=np.float32)
    _run_scores(evidence, data.positions, data.cell_m, theta, order, scores)
    peaks = (scores == maximum_filter(scores, size=(9, 7), mode=('wrap', 'nearest'))) & (scores > 5.0)
    rows, columns = np.nonzero(peaks)
    best = np.argsort(-scores[rows, columns], kind='stable')[:most]
    lines = np.column_stack((columns[best] * data.cell_m, theta[rows[best]]))
    return Candidates(lines, scores[rows[best], columns[best]].astype(float))


def _by_distance(data: EchoData, evidence: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return evidence by range as evidence by the distance of the wall, the baseline taken as in a mean direction."""
    longer = 0.25 * (0.5 * np.sum(data.baselines[:, :2] ** 2, axis=1) + data.baselines[:, 2] ** 2)
    if not np.any(longer):
        return evidence
    cells = np.arange(evidence.shape[1])
    at = np.rint(np.hypot(cells, np.sqrt(longer)[:, None] / data.cell_m)).astype(np.int64)
    return np.take_along_axis(evidence, np.minimum(at, cells[-1]), axis=1)


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


@within_kernels
def edge_evidence(r: float, c: float, s: float, low: float, high: float, feet: Feet) -> float:
    """Return the evidence of the pings that a line x c + y s = r reflects between two places along it.

    It is -1e9 where the line is not in front of one of them.
    """
    positions, baselines, evidence, cell = feet
    total = 0.0
    for i in range(len(positions)):
        half, along = first_order(r, c, s, positions[i, 0], positions[i, 1], baselines[i, 0], baselines[i, 1],
                                  baselines[i, 2])
        if low <= along <= high:
            if half == 0.0:
                return -1e9
            x = half / cell
            k = int(x)
            if k < evidence.shape[1] - 1:
                total += evidence[i, k] + (x - k) * (evidence[i, k + 1] - evidence[i, k])
    return total


def strongest_chords(
    data: EchoData, expected: NDArray[np.float64], strength: float, walls: NDArray[np.float64], most: int
) -> NDArray[np.float64]:
    """Lines (n, 2) that cut a polygon between its path and its corners, with the most evidence on their chords."""
    _, corners = corners_of(walls)
    angles = int(np.clip(2.0 * np.pi * data.extent_m / data.pulse.width_m, 120, 360))
    theta = 2.0 * np.pi * np.arange(angles) / angles - np.pi
    normals = np.column_stack((np.cos(theta), np.sin(theta)))
    low = (data.positions @ normals.T).max(axis=0)
    high = np.minimum((corners @ normals.T).max(axis=0), low + data.range_max_m)  # corners may be very far
    count = int(np.ceil(max((high - low).max(), 0.0) / data.cell_m)) + 1  # pings may be outside of the polygon
    r = low[:, None] + (0.5 + np.arange(count)) * data.cell_m
    lines = np.column_stack((r.ravel(), np.repeat(theta, count)))
    feet = feet_of(data, expected, strength)
    scores = chord_evidence(lines, walls, feet).reshape(angles, count)
    peaks = (scores == maximum_filter(scores, size=(5, 3), mode=('wrap', 'nearest'))) & (scores > -1e8)
    picked = np.flatnonzero(peaks)
    picked = picked[np.argsort(-scores.ravel()[picked], kind='stable')[:most]]
    offsets = np.linspace(-0.5, 0.5, 5)
    near = np.array([(dr * data.cell_m, dtheta * 2.0 * np.pi / angles) for dr in offsets for dtheta in offsets])
    around = lines[picked][:, None, :] + near[None]
    finer = chord_evidence(np.ascontiguousarray(around.reshape(-1, 2)), walls, feet)
    best = np.argmax(finer.reshape(len(picked), len(near)), axis=1) if len(picked) else np.empty(0, int)
    chosen: NDArray[np.float64] = around[np.arange(len(picked)), best]
    return chosen


@kernel
def chord_evidence(pool: NDArray[np.float64], walls: NDArray[np.float64], feet: Feet) -> NDArray[np.float64]:
    """Return the evidence of each line on the chord that it cuts from a convex polygon; -1e9 where it cuts none, or
    where a ping is beyond it.
    """
    gains = np.full(len(pool), -1e9)
    table, lines, positions = normals_of(walls), normals_of(pool), feet.positions
    for q in range(len(pool)):
        low, high = part_within(lines[q, 0], lines[q, 1], lines[q, 2], table, -1)
        behind = low >= high
        for i in range(len(positions)):
            behind = behind or positions[i, 0] * lines[q, 1] + positions[i, 1] * lines[q, 2] >= lines[q, 0]
        if not behind:
            gains[q] = edge_evidence(lines[q, 0], lines[q, 1], lines[q, 2], low, high, feet)
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
    return np.column_stack((r, wrapped(angle)))
