"""Lines of eq. (2), x cos(theta) + y sin(theta) = r, and the polygons whose edges they are."""

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from polymap_ros.geometry.pose import Pose


def wrapped(angle: ArrayLike) -> NDArray[np.float64]:
    """Return angles [rad] within -pi ... pi."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def away_from(line: ArrayLike, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance (m,) of points (m, 2) from a line [m], positive on its inner side."""
    r, theta = np.asarray(line, dtype=float)
    return np.asarray(r - points @ np.array((np.cos(theta), np.sin(theta))))


def polygon_lines(vertices: ArrayLike) -> NDArray[np.float64]:
    """r [m] and theta [rad] of the edges of a counter-clockwise polygon (n, 2), shape (n, 2)."""
    corners = np.asarray(vertices, dtype=float)
    along = np.roll(corners, -1, axis=0) - corners
    theta = np.arctan2(-along[:, 0], along[:, 1])
    return np.column_stack((corners[:, 0] * np.cos(theta) + corners[:, 1] * np.sin(theta), theta))


def moved_lines(lines: NDArray[np.float64], frame: Pose) -> NDArray[np.float64]:
    """Return r [m] and theta [rad] of lines (n, 2), seen from the frame in which `frame` is their own origin."""
    theta = lines[:, 1] + frame.yaw
    return np.column_stack((lines[:, 0] + frame.x * np.cos(theta) + frame.y * np.sin(theta), theta))


def stretched_lines(lines: NDArray[np.float64], stretch: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return r [m] and theta [rad] of lines (n, 2) whose places a matrix (2, 2) moves: normals by its inverse."""
    normals = np.column_stack((np.cos(lines[:, 1]), np.sin(lines[:, 1]))) @ np.linalg.inv(stretch)
    return np.column_stack((lines[:, 0] / np.hypot(*normals.T), np.arctan2(normals[:, 1], normals[:, 0])))


def mirrored_lines(lines: ArrayLike, middle: ArrayLike, along: ArrayLike) -> NDArray[np.float64]:
    """r [m] and theta [rad] of lines (n, 2) mirrored in the line through `middle` along a unit vector, shape (n, 2)."""
    r, theta = np.asarray(lines, dtype=float).reshape(-1, 2).T
    (x, y), (c, s) = np.asarray(middle, dtype=float), np.asarray(along, dtype=float)
    turned = wrapped(2.0 * np.arctan2(s, c) - theta)
    # Each keeps its distance from the middle.
    return np.column_stack((r + x * (np.cos(turned) - np.cos(theta)) + y * (np.sin(turned) - np.sin(theta)), turned))


def feet_on_edges(
    vertices: ArrayLike, points: ArrayLike, weights: ArrayLike = 1, in_front: bool = False
) -> NDArray[np.intp]:
    """How many of the points (m, 2), each counted `weights` times, have their foot on each edge; shape (n,).

    Only of those that are `in_front` of it, on its left, if asked for.
    """
    corners, points = np.asarray(vertices, dtype=float), np.asarray(points, dtype=float)
    along = np.roll(corners, -1, axis=0) - corners
    share = np.einsum('mnk,nk->mn', points[:, None] - corners, along) / np.sum(along**2, axis=1)
    inside = (share >= 0.0) & (share <= 1.0)
    if in_front:
        to_left = np.column_stack((-along[:, 1], along[:, 0]))
        inside &= np.einsum('mnk,nk->mn', points[:, None] - corners, to_left) > 0.0
    count: NDArray[np.intp] = np.sum(inside * np.reshape(np.asarray(weights, np.intp), (-1, 1)), axis=0)
    return count


def iou(first: ArrayLike, second: ArrayLike) -> float:
    """Intersection over union of two polygons given by their vertices; 0 if either has none."""
    a, b = (np.asarray(vertices, dtype=float).reshape(-1, 2) for vertices in (first, second))
    if len(a) < 3 or len(b) < 3:
        return 0.0
    one, other = shapely.Polygon(a), shapely.Polygon(b)
    both = float(one.intersection(other).area)
    return both / float(one.area + other.area - both)
