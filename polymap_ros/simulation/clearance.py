"""Where a device may stand in an outline, and which edges it hears in plain sight."""

import numpy as np
import shapely
from numpy.typing import NDArray

from polymap_ros.geometry.outline import is_convex

_ROUNDING_M = 1e-9
"""How far outside a foot may be by rounding [m]."""


def half_planes(vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Outward unit normals (n, 2) and offsets r (n,) of the edges of a counter-clockwise polygon, eq. (2)."""
    along = np.roll(vertices, -1, axis=0) - vertices
    normals = np.column_stack((along[:, 1], -along[:, 0])) / np.linalg.norm(along, axis=1)[:, None]
    return normals, np.einsum('ij,ij->i', normals, vertices)


def clearance(vertices: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of points (m, 2) from the nearest edge of a simple polygon [m]; not above 0 outside."""
    if is_convex(np.ascontiguousarray(vertices, dtype=float)):
        normals, offsets = half_planes(vertices)
        return np.asarray((offsets - points @ normals.T).min(axis=1))
    outline, places = shapely.Polygon(vertices), shapely.points(points)
    away = shapely.distance(outline.exterior, places)
    return np.asarray(np.where(shapely.contains(outline, places), away, -away))


def audible_feet(
    vertices: NDArray[np.float64], points: NDArray[np.float64], room: shapely.Polygon | None = None
) -> NDArray[np.bool_]:
    """Where the foot of point i is on edge j in plain sight, so that its first-order echo exists; (m, n).

    The room is on the left of the edges, and all that they bound unless it is given.
    """
    along = np.roll(vertices, -1, axis=0) - vertices
    share = (points @ along.T - np.einsum('ij,ij->i', vertices, along)) / np.einsum('ij,ij->i', along, along)
    audible = np.asarray((share >= 0.0) & (share <= 1.0))
    if room is not None or not is_convex(np.ascontiguousarray(vertices, dtype=float)):
        feet = vertices[None] + share[:, :, None] * along[None]
        ways = shapely.linestrings(np.stack((np.broadcast_to(points[:, None], feet.shape), feet), axis=2))
        audible &= shapely.covers((room or shapely.Polygon(vertices)).buffer(_ROUNDING_M), ways)
        outwards = np.einsum('mnk,nk->mn', feet - points[:, None], np.column_stack((along[:, 1], -along[:, 0])))
        audible &= outwards > 0.0
    return audible
