"""The published optimiser: simulated annealing on the beamforming map, eqs. (5)-(10)."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.annealing import Landscape, Steps, anneal, cost_of
from polymap_ros.mapping.conclusion import conclude
from polymap_ros.mapping.estimate import Estimate
from polymap_ros.mapping.lines import half_plane_polygon
from polymap_ros.mapping.snapshot import Snapshot
from polymap_ros.mapping.solver import Evidence
from polymap_ros.parameters import Parameters

REACH_R = 1.0 / 6.0
"""Delta_r of eq. (7) as a share of the range axis: 0.5 m of the default 3 m, and as far in a small object."""

REACH_THETA_DEG = 180.0
"""Delta_theta of eq. (7) [deg]."""

MIN_EDGES = 3
"""Eq. (10) is not applied to a polygon of so few edges."""


class PaperSolver:
    """Simulated annealing as published; every solve starts anew from the same seed.

    What the paper leaves open: a line is always a cell of the map, at first one drawn uniformly from both axes; each
    of the K lines is disturbed, and accepted or not, in turn; iterations count from 1; the IoU of lines that bound
    no area is 0; lines that make no edge still count in the first term of eq. (5); the state after the last
    iteration is the answer.

    All random numbers come from ``numpy.random.default_rng(seed).random``, in this order: (K, 2) for the first r and
    theta of each line, then for every iteration (K, 3), by line: chi_r, chi_theta (as 2 u - 1) and chi.

    Parameters
    ----------
    parameters : Parameters
        The groups `solver` and `grid` are used.

    Attributes
    ----------
    costs : ndarray, shape (iterations + 1,)
        Eq. (5) of the first state and after each iteration so far.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters, grid = parameters.solver, parameters.grid
        self._steps = Steps(
            reach_r=REACH_R * grid.range_max_m / grid.range_step_m,
            reach_theta=REACH_THETA_DEG / grid.angle_step_deg,
            half_r=0.5 * self._parameters.neighbourhood_m / grid.range_step_m,
            half_theta=0.5 * self._parameters.neighbourhood_deg / grid.angle_step_deg,
            full_circle=grid.angle_max_deg - grid.angle_min_deg >= 360.0)
        self.reset()

    def reset(self) -> None:
        """Forget the last solve; nothing of it is used by the next one."""
        self._snapshot: Snapshot | None = None
        self.costs = np.empty(0)

    def begin(self, evidence: Evidence) -> None:
        """Draw the first state: r and theta of each line uniform over their axes."""
        self._snapshot = snapshot = Snapshot.of(evidence)
        self._landscape = Landscape(
            snapshot.likelihood, snapshot.r_m, snapshot.theta_rad, snapshot.region.points, snapshot.region.ends,
            snapshot.region.area, self._parameters.iou_weight)
        self._random = np.random.default_rng(self._parameters.seed)
        axes = len(snapshot.r_m), len(snapshot.theta_rad)
        first = (self._random.random((self._parameters.max_edges, 2)) * axes).astype(np.int64)
        self._cells = np.minimum(first, np.array(axes) - 1)[None]
        self.costs = np.array([cost_of(self._cells[0], self._landscape)])

    def advance(self, iterations: int) -> bool:
        """Run up to `iterations` more of all `solver.iterations`; True when they are done."""
        done = len(self.costs) - 1
        count = min(iterations, self._parameters.iterations - done)
        draws = self._random.random((count, self._parameters.max_edges, 3))
        costs, cells = np.empty(count), np.empty((count, *self._cells.shape[1:]), np.int64)
        anneal(self._cells[-1].copy(), self.costs[-1], done, draws, self._landscape, self._steps, costs, cells)
        self.costs = np.concatenate((self.costs, costs))
        self._cells = np.concatenate((self._cells, cells))
        return done + count >= self._parameters.iterations

    def lines_at(self, iteration: int = -1) -> NDArray[np.float64]:
        """r [m] and theta [rad] of all K lines after an iteration (0: the first state), shape (K, 2)."""
        snapshot = self._evidence
        r, theta = self._cells[iteration].T
        return np.column_stack((snapshot.r_m[r], snapshot.theta_rad[theta]))

    def kept_at(self, iteration: int = -1) -> NDArray[np.intp]:
        """Indices of the lines that eq. (10) leaves after an iteration."""
        return filtered(self.lines_at(iteration), self._evidence, self._parameters.edge_filter_epsilon)

    def polygon_at(self, iteration: int = -1) -> NDArray[np.float64]:
        """Vertices (n, 2) [m] after an iteration and eq. (10), in the start frame; no rows if none closes."""
        return half_plane_polygon(self.lines_at(iteration)[self.kept_at(iteration)])[0]

    def estimate(self) -> Estimate:
        """The polygon that eq. (10) leaves of the last state."""
        kept = self.kept_at()
        r, theta = self._cells[-1, kept].T
        likelihood = self._evidence.likelihood[theta, r].astype(float)
        return conclude('paper', self._evidence, self.lines_at()[kept], likelihood, float(self.costs[-1]))

    @property
    def _evidence(self) -> Snapshot:
        if self._snapshot is None:
            raise RuntimeError('begin() a solve first')
        return self._snapshot


def filtered(lines: NDArray[np.float64], snapshot: Snapshot, epsilon: float) -> NDArray[np.intp]:
    """Eq. (10): drop lines, in their order, that change the IoU by less than epsilon, until a full pass drops none.

    Nothing is dropped where the IoU is 0, nor of `MIN_EDGES` lines.
    """
    def iou(which: list[int]) -> float:
        return snapshot.region.iou(half_plane_polygon(lines[which])[0])

    kept = list(range(len(lines)))
    current, before = iou(kept), len(kept) + 1
    while current > 0.0 and len(kept) < before:
        before = len(kept)
        for k in tuple(kept):
            fewer = [other for other in kept if other != k]
            if len(fewer) < MIN_EDGES:
                break
            changed = iou(fewer)
            if abs(changed - current) < epsilon * current:
                kept, current = fewer, changed
    return np.array(kept, np.intp)
