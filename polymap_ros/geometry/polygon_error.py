"""How close a polygon is to the truth: by its walls, since the IoU is blind to small edges."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from polymap_ros.geometry.lines import iou, polygon_lines

OFFSET_TOLERANCE_M = 0.003
ANGLE_TOLERANCE_RAD = float(np.deg2rad(0.5))


@dataclass(frozen=True, eq=False)
class Comparison:
    """An estimated polygon against the true one.

    Parameters
    ----------
    right : bool
        The right number of edges, each true one matched one to one by an estimated one within both tolerances.
    iou : float
        Intersection over union.
    n_true, n_estimated : int
        Numbers of edges.
    offsets_m : ndarray, shape (n_true,)
        Distance of the matched estimated line beyond each true edge's midpoint, outward positive [m]; nan where no
        estimated edge is left to match.
    angles_rad : ndarray, shape (n_true,)
        Angle from each true edge to the matched estimated one, in (-pi, pi]; nan likewise.
    matches : ndarray, shape (n_true,), intp
        Index of the estimated edge matched to each true one; -1 where none is left to match.
    """

    right: bool
    iou: float
    n_true: int
    n_estimated: int
    offsets_m: NDArray[np.float64]
    angles_rad: NDArray[np.float64]
    matches: NDArray[np.intp]


def compare(
    estimated: ArrayLike,
    true: ArrayLike,
    offset_tolerance_m: float = OFFSET_TOLERANCE_M,
    angle_tolerance_rad: float = ANGLE_TOLERANCE_RAD,
) -> Comparison:
    """Compare two polygons given by counter-clockwise vertices (n, 2) in one frame; `estimated` may be empty.

    Edges are matched so that as many as possible are within both tolerances, and the others as closely as possible.
    """
    found, truth = (np.asarray(vertices, dtype=float).reshape(-1, 2) for vertices in (estimated, true))
    walls, lines = polygon_lines(truth), polygon_lines(found)
    middles = 0.5 * (truth + np.roll(truth, -1, axis=0))
    normals = np.array((np.cos(lines[:, 1]), np.sin(lines[:, 1])))
    offsets = lines[:, 0] - middles @ normals
    angles = np.pi - np.mod(np.pi - (lines[:, 1] - walls[:, 1, None]), 2.0 * np.pi)
    within = (abs(offsets) <= offset_tolerance_m) & (abs(angles) <= angle_tolerance_rad)
    distance = abs(offsets) / offset_tolerance_m + abs(angles) / angle_tolerance_rad
    # A pair within tolerance is worth more than all that the other pairs could gain, less than 1 each.
    misfit = distance / (1.0 + distance) + (len(truth) + len(found)) * ~within
    rows, columns = linear_sum_assignment(misfit)
    matched = np.full((2, len(truth)), np.nan)
    matched[:, rows] = offsets[rows, columns], angles[rows, columns]
    matches = np.full(len(truth), -1, np.intp)
    matches[rows] = columns
    right = len(found) == len(truth) and bool(within[rows, columns].all())
    return Comparison(right, iou(found, truth), len(truth), len(found), matched[0], matched[1], matches)
