"""The baseline, [1] of the paper: a rectangle straight from the beamforming map."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.parameters import Parameters
from polymap_ros.solvers.checkpoint import Checkpoint, unwatched
from polymap_ros.solvers.estimate import Estimate
from polymap_ros.solvers.map_verdict import conclude
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.solver import Evidence


class RectangleSolver:
    """Four perpendicular lines with the largest cumulative likelihood L_T.

    For one angle theta the four ranges do not depend on each other: r1 and r2 are the maxima of L_T at theta and
    theta + pi, r3 and r4 those at theta + pi / 2 and theta - pi / 2. The angle with the largest sum wins. Where the
    angle axis has no cell at such an angle, the nearest one within half a step stands for it; an angle for which one
    of the four is not on the axis is left out.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._step_rad = np.deg2rad(parameters.grid.angle_step_deg)

    def solve(self, evidence: Evidence, checkpoint: Checkpoint = unwatched) -> Estimate:
        """Return the rectangle; nothing iterates."""
        snapshot = Snapshot.of(evidence)
        lines, likelihood = best_rectangle(snapshot, self._step_rad)
        return conclude('rectangle', snapshot, lines, likelihood)


def best_rectangle(snapshot: Snapshot, step_rad: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lines r, theta, shape (4, 2), and L / max L, shape (4,), of the best rectangle; no rows if the axis has none."""
    best_r = snapshot.likelihood.argmax(axis=1)
    best = snapshot.likelihood.max(axis=1).astype(float)
    rows = np.empty((4, len(best)), np.intp)
    missing = np.zeros(len(best), np.bool_)
    for turn in range(4):
        steps = (np.pi / 2.0 * turn) / step_rad + np.arange(len(best))
        circle = 2.0 * np.pi / step_rad
        rows[turn] = np.rint(np.mod(steps + 0.5, circle) - 0.5).astype(np.intp)
        if snapshot.full_circle:
            rows[turn] %= len(best)
        missing |= rows[turn] >= len(best)
    total = np.where(missing, -np.inf, best[np.where(missing, 0, rows)].sum(axis=0))
    first = int(total.argmax())
    if missing[first]:
        return np.empty((0, 2)), np.empty(0)
    four = rows[:, first]
    theta = snapshot.theta_rad[first] + np.pi / 2.0 * np.arange(4)
    return np.column_stack((snapshot.r_m[best_r[four]], theta)), best[four]
