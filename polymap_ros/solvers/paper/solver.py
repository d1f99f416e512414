"""The published optimiser: simulated annealing on the beamforming map, eqs. (5)-(10)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.checkpoint import Checkpoint, unwatched
from polymap_ros.solvers.estimate import Estimate
from polymap_ros.solvers.map_verdict import conclude
from polymap_ros.solvers.paper.annealing import Landscape, Steps, anneal, cost_of
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.solver import Evidence

REACH_R = 1.0 / 6.0
"""Delta_r of eq. (7) as a share of the range axis: 0.5 m of the default 3 m, and as far in a small object."""

REACH_THETA_DEG = 180.0
"""Delta_theta of eq. (7) [deg]."""

MIN_EDGES = 3
"""Eq. (10) is not applied to a polygon of so few edges."""

_AT_ONCE = 5
"""Iterations between two checkpoints."""


@dataclass(frozen=True, eq=False)
class Annealing:
    """Every state of one annealing.

    Parameters
    ----------
    snapshot : Snapshot
        The evidence that it was run on.
    epsilon : float
        Threshold of eq. (10).
    costs : ndarray, shape (iterations + 1,)
        Eq. (5) of the first state and after each iteration.
    cells : ndarray, shape (iterations + 1, K, 2), int64
        Cells of r and theta of the K lines, as often.
    """

    snapshot: Snapshot
    epsilon: float
    costs: NDArray[np.float64]
    cells: NDArray[np.int64]

    def lines_at(self, iteration: int = -1) -> NDArray[np.float64]:
        """Return r [m] and theta [rad] of all K lines after an iteration (0: the first state), shape (K, 2)."""
        r, theta = self.cells[iteration].T
        return np.column_stack((self.snapshot.r_m[r], self.snapshot.theta_rad[theta]))

    def kept_at(self, iteration: int = -1) -> NDArray[np.intp]:
        """Return the indices of the lines that eq. (10) leaves after an iteration."""
        return filtered(self.lines_at(iteration), self.snapshot, self.epsilon)

    def polygon_at(self, iteration: int = -1) -> NDArray[np.float64]:
        """Return the vertices (n, 2) [m] after an iteration and eq. (10), in the start frame; no rows if open."""
        return half_plane_polygon(self.lines_at(iteration)[self.kept_at(iteration)])[0]

    def estimate(self) -> Estimate:
        """Return the polygon that eq. (10) leaves of the last state."""
        kept = self.kept_at()
        r, theta = self.cells[-1, kept].T
        likelihood = self.snapshot.likelihood[theta, r].astype(float)
        return conclude('paper', self.snapshot, self.lines_at()[kept], likelihood, float(self.costs[-1]))


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
    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters, grid = parameters.solver, parameters.grid
        self._steps = Steps(
            reach_r=REACH_R * grid.range_max_m / grid.range_step_m,
            reach_theta=REACH_THETA_DEG / grid.angle_step_deg,
            half_r=0.5 * self._parameters.neighbourhood_m / grid.range_step_m,
            half_theta=0.5 * self._parameters.neighbourhood_deg / grid.angle_step_deg,
            full_circle=grid.angle_max_deg - grid.angle_min_deg >= 360.0)

    def solve(self, evidence: Evidence, checkpoint: Checkpoint = unwatched) -> Estimate:
        """Return the polygon that eq. (10) leaves of the last state."""
        return self.annealed(evidence, checkpoint).estimate()

    def annealed(self, evidence: Evidence, checkpoint: Checkpoint = unwatched) -> Annealing:
        """Run all iterations and return every state."""
        snapshot, parameters = Snapshot.of(evidence), self._parameters
        landscape = Landscape(
            snapshot.likelihood, snapshot.r_m, snapshot.theta_rad, snapshot.region.points, snapshot.region.ends,
            snapshot.region.area, parameters.iou_weight)
        random, axes = np.random.default_rng(parameters.seed), (len(snapshot.r_m), len(snapshot.theta_rad))
        first = (random.random((parameters.max_edges, 2)) * axes).astype(np.int64)
        cells = np.empty((parameters.iterations + 1, parameters.max_edges, 2), np.int64)
        costs = np.empty(parameters.iterations + 1)
        cells[0] = np.minimum(first, np.array(axes) - 1)
        costs[0] = cost_of(cells[0], landscape)
        for done in range(0, parameters.iterations, _AT_ONCE):
            checkpoint()
            end = min(done + _AT_ONCE, parameters.iterations)
            anneal(cells[done].copy(), costs[done], done, random.random((end - done, parameters.max_edges, 3)),
                   landscape, self._steps, costs[done + 1:end + 1], cells[done + 1:end + 1])
        return Annealing(snapshot, parameters.edge_filter_epsilon, costs, cells)


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
