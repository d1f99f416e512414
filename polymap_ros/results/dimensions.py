"""What an inspector measures: edge lengths, corner angles and area, each with its standard deviation."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import Pose
from polymap_ros.solvers.estimate import Candidate, Edge


class Dimensions(NamedTuple):
    """The sizes of a polygon, or of a hole; edge i runs from corner i to corner i + 1. nan is not known.

    The deviations are propagated to first order from the covariance of r and theta of all edges; where only each edge's
    own is known, the errors of two edges are taken as independent.

    Parameters
    ----------
    lengths_m, length_stds_m : ndarray, shape (n,)
        Edge lengths [m].
    angles_rad, angle_stds_rad : ndarray, shape (n,)
        Inner angles at the corners [rad], within the material: beyond pi where a corner points inwards, as a hole's do.
    area_m2, area_std_m2 : float
        Area within the ring [m2].
    """

    lengths_m: NDArray[np.float64]
    length_stds_m: NDArray[np.float64]
    angles_rad: NDArray[np.float64]
    angle_stds_rad: NDArray[np.float64]
    area_m2: float
    area_std_m2: float


_FAR = 10.0
"""Extents from the origin, from which the deviation of r is mostly that of theta over the way there."""


def seen_from_afar(polygon: Candidate) -> tuple[float, float]:
    """Return how far the origin is [m], and the largest deviation of an edge across itself at its middle [m].

    The former is 0 where the origin is near enough for r to speak of the wall; the latter is nan where it is not known.
    """
    corners = np.asarray(polygon.vertices, dtype=float)
    distance_m = float(np.hypot(*corners.mean(axis=0)))
    if distance_m <= _FAR * float(np.ptp(corners, axis=0).max()):
        return 0.0, np.nan
    middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
    near = [edge.moved(Pose(-x, -y)).r_std for edge, (x, y) in zip(polygon.edges, middles.tolist(), strict=True)]
    return distance_m, max((np.nan if std is None else std for std in near), default=np.nan)


def dimensions(polygon: Candidate) -> Dimensions:
    """Measure a polygon, counter-clockwise, or a hole, clockwise: the material is to the left of both."""
    corners = np.asarray(polygon.vertices, dtype=float)
    along = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*along.T)
    tangents = along / lengths[:, None]
    turns = np.arctan2(_cross(np.roll(tangents, 1, axis=0), tangents),
                       np.sum(np.roll(tangents, 1, axis=0) * tangents, axis=1))
    moved = _corner_jacobian(corners, tangents)
    by_length = np.einsum('ik,ikp->ip', tangents, np.roll(moved, -1, axis=0) - moved)
    n = len(corners)
    by_angle = np.zeros((n, n, 2))
    by_angle[range(n), range(n), 1] = -1.0
    by_angle[range(n), np.arange(n) - 1, 1] = 1.0
    # Moving corner k changes the area by half the cross product with the way from its left to its right neighbour.
    across = np.roll(corners, -1, axis=0) - np.roll(corners, 1, axis=0)
    by_area = 0.5 * np.einsum('k,kp->p', across[:, 1], moved[:, 0]) - 0.5 * np.einsum(
        'k,kp->p', across[:, 0], moved[:, 1])
    near = corners - np.round(corners.mean(axis=0), -1)  # of UTM coordinates the products lose whole square decimetres
    covariance = _covariance(polygon.edges) if polygon.covariance is None else polygon.covariance
    return Dimensions(
        lengths, _deviations(by_length, covariance),
        np.pi - turns, _deviations(by_angle.reshape(n, 2 * n), covariance),
        abs(0.5 * float(np.sum(_cross(near, np.roll(near, -1, axis=0))))),
        float(_deviations(by_area[None], covariance)[0]))


def net_area(polygon: Candidate, holes: Sequence[Candidate]) -> tuple[float, float]:
    """Return the area of a polygon without its holes, and its deviation [m2], the rings' errors being independent."""
    rings = [dimensions(ring) for ring in (polygon, *holes)]
    area_m2 = rings[0].area_m2 - sum(hole.area_m2 for hole in rings[1:])
    return area_m2, math.hypot(*(ring.area_std_m2 for ring in rings))


def _corner_jacobian(corners: NDArray[np.float64], tangents: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change (n, 2, 2 n) of every corner by r and theta of every edge.

    With the edge's outward normal u and direction t a point p of it has u p = r, and so u dp = dr - t p dtheta: two
    equations for the corner of two edges.
    """
    n = len(corners)
    change = np.zeros((n, 2, 2 * n))
    for i in range(n):
        edges = [i - 1, i]
        normals = np.column_stack((tangents[edges, 1], -tangents[edges, 0]))
        sides = np.zeros((2, 2 * n))
        for row, edge in enumerate(edges):
            sides[row, 2 * (edge % n):2 * (edge % n) + 2] = 1.0, -tangents[edge] @ corners[i]
        change[i] = np.linalg.solve(normals, sides)
    return change


def _covariance(edges: tuple[Edge, ...]) -> NDArray[np.float64]:
    """Covariance (2 n, 2 n) of r and theta of all edges; nan where an edge's is not known."""
    full = np.zeros((2 * len(edges), 2 * len(edges)))
    for k, edge in enumerate(edges):
        if edge.r_std is None or edge.theta_std is None:
            full[:] = np.nan
            break
        both = edge.r_theta_covariance
        full[2 * k:2 * k + 2, 2 * k:2 * k + 2] = [[edge.r_std**2, both], [both, edge.theta_std**2]]
    return full


def _deviations(jacobian: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    variances = np.einsum('ip,pq,iq->i', jacobian, covariance, jacobian)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)), dtype=float)


def _cross(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0], dtype=float)
