"""Walls that first echoes alone prove, where no polygon closes.

In a convex room the first echo of a ping comes from the nearest wall, and straight from it: a disc of its range about
the ping lies inside the room and touches that wall. Later echoes may be of higher order, which from a short path look
like walls that are not there. So a wall is a line that touches discs and cuts none. Any two discs have lines that touch
both; each further one that is touched to within q, s away from the others, would be touched by chance with a
probability of q / s, since ranges at places s apart differ by s at most; q is half the pulse's width.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import wrapped
from polymap_ros.jit import kernel
from polymap_ros.solvers.estimate import Edge

_MISSED = 0.05
"""Share of the pings whose first echo may be missed, so that their disc is too large."""


def first_walls(places: NDArray[np.float64], ranges: NDArray[np.float64], width_m: float) -> tuple[Edge, ...]:
    """Walls that first echoes speak for, each disc for one of them.

    Parameters
    ----------
    places : ndarray, shape (N, 2)
        Sensor positions [m].
    ranges : ndarray, shape (N,)
        Closest range of each ping [m]; nan where none stands out.
    width_m : float
        Width of the pulse [m].
    """
    heard = np.isfinite(ranges)
    places, ranges = places[heard], ranges[heard]
    lines = _tangents(places, ranges)
    beyond = lines[:, :1] - _normals(lines) @ places.T - ranges  # from disc to line
    walls: list[Edge] = []
    left = np.ones(len(places), np.bool_)
    while len(lines):
        odds = _odds(places, beyond, left, 0.5 * width_m)
        best = int(np.argmax(odds))
        if odds[best] <= 0.0:
            break
        run = left & (np.abs(beyond[best]) < 0.5 * width_m)
        wall = _fitted(places[run], ranges[run], lines[best], width_m)
        along = places[run] @ (-np.sin(wall.theta), np.cos(wall.theta))
        turn = 4.0 * width_m / max(float(np.ptp(along)), width_m)  # by less it would be the same wall
        # Echoes that overlap are off by as much as the pulse's width.
        loose = _odds(places, beyond, left, width_m)
        shared = np.sum((np.abs(beyond) < width_m) & run, axis=1) > 0.5 * np.sum(run)
        rivals = _rivals(lines[shared, 1], loose[shared], wall.theta, turn) - loose[best]
        share = 1.0 / (1.0 + np.sum(np.exp(np.minimum(rivals, 500.0))) + np.exp(-odds[best]))
        walls.append(dataclasses.replace(wall, likelihood=float(share)))
        left &= ~run
    return tuple(walls)


def _odds(
    places: NDArray[np.float64], beyond: NDArray[np.float64], left: NDArray[np.bool_], off_m: float
) -> NDArray[np.float64]:
    """Log odds of each line, which may miss the discs by so much, by those that are `left`."""
    cut = np.sum(beyond < -off_m, axis=1)
    by_touch = _coincidences(places, (np.abs(beyond) < off_m) & left, off_m)
    return np.asarray(by_touch + np.log(_MISSED) * cut - np.log(len(beyond)))


def _normals(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack((np.cos(lines[:, 1]), np.sin(lines[:, 1])))


def _tangents(places: NDArray[np.float64], ranges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lines (n, 2) that touch two discs which lie on one side of them."""
    i, j = np.triu_indices(len(places), 1)
    between = places[j] - places[i]
    apart = np.hypot(between[:, 0], between[:, 1])
    outside = apart > np.abs(ranges[i] - ranges[j])
    i, j, between, apart = i[outside], j[outside], between[outside], apart[outside]
    turn, towards = np.arccos((ranges[i] - ranges[j]) / apart), np.arctan2(between[:, 1], between[:, 0])
    theta = np.concatenate((towards - turn, towards + turn))
    r = np.sum(_normals(np.column_stack((theta, theta))) * np.tile(places[i], (2, 1)), axis=1) + np.tile(ranges[i], 2)
    return np.column_stack((r, wrapped(theta)))


@kernel
def _coincidences(
    places: NDArray[np.float64], touched: NDArray[np.bool_], off_m: float
) -> NDArray[np.float64]:
    """Nats by which each line touches more discs than it would by chance, the two that give it not counted."""
    total = np.zeros(len(touched))
    for q in range(len(touched)):
        most = 0.0
        for i in range(len(places)):
            nearest = np.inf  # of those before it
            for j in range(i if touched[q, i] else 0):
                if touched[q, j]:
                    nearest = min(nearest, (places[i, 0] - places[j, 0]) ** 2 + (places[i, 1] - places[j, 1]) ** 2)
            if off_m**2 < nearest < np.inf:
                nats = 0.5 * np.log(nearest / off_m**2)
                total[q] += nats
                most = max(most, nats)
        total[q] -= most
    return total


def _fitted(
    places: NDArray[np.float64], ranges: NDArray[np.float64], line: NDArray[np.float64], width_m: float
) -> Edge:
    """The line that touches discs best, by least squares; each range is known to the pulse's width."""
    r, theta = line
    for _ in range(3):
        c, s = np.cos(theta), np.sin(theta)
        by = np.column_stack((np.ones(len(places)), places @ (s, -c)))
        missing = ranges - r + places @ (c, s)
        step, *_ = np.linalg.lstsq(by, missing, rcond=None)
        r, theta = r + step[0], theta + step[1]
    covariance = width_m**2 / 12.0 * np.linalg.pinv(by.T @ by)
    theta = float(wrapped(theta))
    r_std, theta_std = np.sqrt(np.diag(covariance))
    return Edge(float(r), theta, 1.0, float(r_std), float(theta_std), len(places), float(covariance[0, 1]))


def _rivals(
    theta: NDArray[np.float64], odds: NDArray[np.float64], than: float, least: float
) -> NDArray[np.float64]:
    """Log odds of lines at other angles `than` this, by so much at the least: the best of each direction."""
    found = []
    elsewhere = np.abs(wrapped(theta - than)) > least
    while np.any(elsewhere):
        best = int(np.argmax(np.where(elsewhere, odds, -np.inf)))
        found.append(odds[best])
        elsewhere &= np.abs(wrapped(theta - theta[best])) > least
    return np.array(found)
