"""A polygonal region with holes, laid out flat so that its overlap with a convex polygon is one compiled pass.

That with any other polygon is shapely's.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.polygon import orient

from polymap_ros.geometry.outline import is_convex
from polymap_ros.jit import kernel


class Region:
    """A fixed region, such as A_T at one moment.

    Parameters
    ----------
    shape : shapely geometry
        Polygon or multipolygon, holes allowed; may be empty.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        Corners of all rings [m], each ring closed; outer rings counter-clockwise, holes clockwise.
    ends : ndarray, shape (n_rings,)
        Where each ring ends in `points`.
    area : float
        Area [m2].
    """

    def __init__(self, shape: shapely.Geometry) -> None:
        polygons = [orient(part) for part in shapely.get_parts(shape) if not part.is_empty]
        rings = [shapely.get_coordinates(ring) for polygon in polygons for ring in shapely.get_rings(polygon)]
        self.points = np.ascontiguousarray(np.concatenate(rings)) if rings else np.empty((0, 2))
        self.ends = np.cumsum([len(ring) for ring in rings], dtype=np.int64)
        self.area = float(shape.area)
        self._shape = shape

    def iou(self, vertices: ArrayLike, holes: Sequence[ArrayLike] = ()) -> float:
        """Intersection over union with a counter-clockwise polygon (n, 2) with holes; 0 if it has no vertices."""
        starts = np.ascontiguousarray(vertices, dtype=float).reshape(-1, 2)
        if len(holes) or not is_convex(starts):
            polygon = shapely.Polygon(starts, holes)
            both = float(shapely.intersection(polygon, self._shape).area)
            return both / (self.area + float(polygon.area) - both)
        along = np.concatenate((starts[1:], starts[:1])) - starts
        return float(iou_with_edges(self.points, self.ends, self.area, starts, along))


@kernel
def iou_with_edges(
    points: NDArray[np.float64], ends: NDArray[np.int64], area: float,
    starts: NDArray[np.float64], along: NDArray[np.float64],
) -> float:
    """IoU of a region with a convex polygon given by its edges (n, 2), counter-clockwise, in any order."""
    if starts.shape[0] < 3 or area <= 0.0:
        return 0.0
    polygon = 0.0
    for k in range(starts.shape[0]):
        polygon += 0.5 * (starts[k, 0] * along[k, 1] - starts[k, 1] * along[k, 0])
    both = overlap(points, ends, starts, along)
    return both / (area + polygon - both)


@kernel
def overlap(
    points: NDArray[np.float64], ends: NDArray[np.int64],
    starts: NDArray[np.float64], along: NDArray[np.float64],
) -> float:
    r"""Area of the intersection by Green's theorem, 1/2 of the integral of x dy - y dx along its boundary.

    That boundary consists of the pieces of the rings inside the convex polygon, and of the pieces of the polygon's
    edges inside the region. The former follow from clipping each piece of a ring by all edges. For the latter only
    the length inside matters: where a ring leaves the polygon through the line of edge k at a share s of the edge,
    the region lies beyond s, and where it enters, before s; the share inside is therefore the signed sum of all s,
    held to [0, 1], over the crossings of that line.
    """
    n = starts.shape[0]
    inside, depth = np.zeros(n), np.empty(n)
    total, start = 0.0, 0
    for end in ends:
        ax, ay = points[start, 0], points[start, 1]
        for k in range(n):
            depth[k] = along[k, 0] * (ay - starts[k, 1]) - along[k, 1] * (ax - starts[k, 0])
        for i in range(start + 1, end):
            bx, by = points[i, 0], points[i, 1]
            first, last = 0.0, 1.0  # the part of the piece from a to b that is inside all edges so far
            for k in range(n):
                at_a, at_b = depth[k], along[k, 0] * (by - starts[k, 1]) - along[k, 1] * (bx - starts[k, 0])
                depth[k] = at_b
                if at_a > 0.0 and at_b > 0.0:
                    continue
                if at_a <= 0.0 and at_b <= 0.0:
                    last = -1.0
                    continue
                t = at_a / (at_a - at_b)
                x, y = ax + t * (bx - ax) - starts[k, 0], ay + t * (by - ay) - starts[k, 1]
                share = (x * along[k, 0] + y * along[k, 1]) / (along[k, 0] ** 2 + along[k, 1] ** 2)
                share = min(max(share, 0.0), 1.0)
                if at_b > 0.0:
                    first = max(first, t)
                    inside[k] += share
                else:
                    last = min(last, t)
                    inside[k] -= share
            if last > first:
                px, py = ax + first * (bx - ax), ay + first * (by - ay)
                qx, qy = ax + last * (bx - ax), ay + last * (by - ay)
                total += px * qy - py * qx
            ax, ay = bx, by
        start = end
    for k in range(n):
        total += inside[k] * (starts[k, 0] * along[k, 1] - starts[k, 1] * along[k, 0])
    return 0.5 * total
