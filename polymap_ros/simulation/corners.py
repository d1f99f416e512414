"""Corners of a scene's rings: those of a simple polygon, in the direction in which walls are kept."""

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from polymap_ros.errors import SceneError

_LEAST_TURN = 1e-9
"""By less than this [rad] a polygon turns at no corner."""


def counter_clockwise(
    vertices: ArrayLike, reflection: ArrayLike = 1.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Check a simple polygon (n, 2) and its reflection coefficients, one or (n,), and put both counter-clockwise.

    Raises
    ------
    SceneError
        If edges of the polygon cross or meet, a corner is none, or a coefficient is not between -1 and 1.
    """
    corners, coefficients = np.asarray(vertices, dtype=float), np.asarray(reflection, dtype=float)
    if corners.ndim != 2 or corners.shape[0] < 3 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise SceneError('vertices must be at least 3 finite pairs [x, y]')
    if coefficients.ndim == 0:
        coefficients = np.full(len(corners), float(coefficients))
    if coefficients.shape != (len(corners),) or not (np.abs(coefficients) <= 1.0).all():
        raise SceneError('reflection must be one value, or one per edge, between -1 and 1')
    x, y = corners.T
    if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0.0:
        corners, coefficients = corners[::-1], np.roll(coefficients[::-1], -1)  # edge i was edge n - 2 - i
    along = np.roll(corners, -1, axis=0) - corners
    following = np.roll(along, -1, axis=0)
    turns = np.arctan2(along[:, 0] * following[:, 1] - along[:, 1] * following[:, 0],
                       np.einsum('ij,ij->i', along, following))
    sharp = (np.abs(turns) > _LEAST_TURN) & (np.abs(turns) < np.pi - _LEAST_TURN)
    if not (sharp.all() and abs(turns.sum() - 2.0 * np.pi) < 1e-6 and shapely.Polygon(corners).is_valid):
        raise SceneError('edges of the polygon cross or meet, or it goes straight on or back at a corner')
    return corners, coefficients


def clockwise(vertices: ArrayLike, reflection: ArrayLike = 1.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """As `counter_clockwise`, the other way round: as a hole is kept, with the room on the left of every edge."""
    corners, coefficients = counter_clockwise(vertices, reflection)
    return corners[::-1], np.roll(coefficients[::-1], -1)
