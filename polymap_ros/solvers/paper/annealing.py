"""The compiled inner loop of the published optimiser: eqs. (5), (7), (8) and (9) on the cells of the map."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import edges_of
from polymap_ros.geometry.overlap import iou_with_edges
from polymap_ros.jit import kernel


class Landscape(NamedTuple):
    """All that the cost of a set of lines depends on; see `Snapshot`."""

    likelihood: NDArray[np.float32]
    r_m: NDArray[np.float64]
    theta_rad: NDArray[np.float64]
    points: NDArray[np.float64]
    ends: NDArray[np.int64]
    area: float
    iou_weight: float


class Steps(NamedTuple):
    """Delta_r, Delta_theta of eq. (7) and half the size of V of eq. (8), in cells of the map."""

    reach_r: float
    reach_theta: float
    half_r: float
    half_theta: float
    full_circle: bool


@kernel
def cost_of(cells: NDArray[np.int64], landscape: Landscape) -> float:
    """Eq. (5) of the lines at `cells`, shape (K, 2), the indices of r and theta."""
    lines = np.empty((cells.shape[0], 2))
    total = 0.0
    for k in range(cells.shape[0]):
        lines[k, 0], lines[k, 1] = landscape.r_m[cells[k, 0]], landscape.theta_rad[cells[k, 1]]
        total += float(landscape.likelihood[cells[k, 1], cells[k, 0]])
    starts, along, _ = edges_of(lines)
    iou = iou_with_edges(landscape.points, landscape.ends, landscape.area, starts, along)
    return -(total + landscape.iou_weight * iou)


@kernel
def disturbed(
    r: int, theta: int, chi_r: float, chi_theta: float, likelihood: NDArray[np.float32], steps: Steps
) -> tuple[int, int]:
    """Eqs. (7) and (8): move a line, given as a cell, and snap it to the best cell of its neighbourhood.

    A range beyond the axis stays at its end, as does an angle unless the axis is a full circle. Of equal cells the
    one with the least angle, then with the least range, wins. Where V holds no cell, the nearest one is taken.
    """
    n_theta, n_r = likelihood.shape
    centre_r = min(max(r + steps.reach_r * chi_r**3, 0.0), n_r - 1.0)
    centre_theta = theta + steps.reach_theta * chi_theta**3
    first_r = max(int(np.ceil(centre_r - steps.half_r)), 0)
    last_r = min(int(np.floor(centre_r + steps.half_r)), n_r - 1)
    if first_r > last_r:
        first_r = last_r = int(np.floor(centre_r + 0.5))
    if not steps.full_circle:
        centre_theta = min(max(centre_theta, 0.0), n_theta - 1.0)
    first_theta = int(np.ceil(centre_theta - steps.half_theta))
    last_theta = int(np.floor(centre_theta + steps.half_theta))
    if first_theta > last_theta:
        first_theta = last_theta = int(np.floor(centre_theta + 0.5))
    if steps.full_circle:
        last_theta = min(last_theta, first_theta + n_theta - 1)
    else:
        first_theta, last_theta = max(first_theta, 0), min(last_theta, n_theta - 1)
    best, best_r, best_theta = -np.inf, first_r, first_theta % n_theta
    for i in range(first_theta, last_theta + 1):
        row = likelihood[i % n_theta]
        for j in range(first_r, last_r + 1):
            if row[j] > best:
                best, best_r, best_theta = row[j], j, i % n_theta
    return best_r, best_theta


@kernel
def anneal(
    cells: NDArray[np.int64], cost: float, done: int, draws: NDArray[np.float64], landscape: Landscape, steps: Steps,
    costs: NDArray[np.float64], history: NDArray[np.int64],
) -> None:
    """Run iterations done + 1, done + 2, ... on `cells`, shape (K, 2), in place.

    Parameters
    ----------
    cells, cost, done
        The state, its cost, and the number of iterations that led to it.
    draws : ndarray, shape (n, K, 3)
        Uniform numbers in [0, 1) of each iteration and line: for r, for theta, for the acceptance.
    landscape, steps
        What the cost and the moves depend on.
    costs, history : ndarray, shapes (n,) and (n, K, 2)
        Filled with the cost and the cells after each iteration.
    """
    for i in range(draws.shape[0]):
        temperature = 5.0 / (done + 1.0 + i) ** 0.8
        for k in range(cells.shape[0]):
            chi_r, chi_theta = 2.0 * draws[i, k, 0] - 1.0, 2.0 * draws[i, k, 1] - 1.0
            r, theta = cells[k, 0], cells[k, 1]
            cells[k, 0], cells[k, 1] = disturbed(r, theta, chi_r, chi_theta, landscape.likelihood, steps)
            changed = cost_of(cells, landscape)
            # Eq. (9), written so that a large decrease does not overflow.
            if draws[i, k, 2] < np.exp(min(cost - changed, 0.0) / temperature):
                cost = changed
            else:
                cells[k, 0], cells[k, 1] = r, theta
        costs[i] = cost
        history[i] = cells
