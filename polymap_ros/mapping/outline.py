"""An outline that is given: the map in which a robot is localised."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import Polygon

from polymap_ros.errors import UsageError
from polymap_ros.geometry.outline import is_convex

_NEEDED = 'outline: slam.mode: localization needs the vertices (n, 2) of a convex polygon in the map frame [m]'


def known_outline(vertices: ArrayLike | None) -> NDArray[np.float64]:
    """Return vertices (n, 2) in counter-clockwise order.

    Raises
    ------
    UsageError
        For what is no convex polygon.
    """
    try:
        found = np.asarray(vertices if vertices is not None else (), dtype=float)
    except (TypeError, ValueError) as error:
        raise UsageError(f'{_NEEDED}; found what is not numbers') from error
    if found.ndim != 2 or found.shape[1] != 2 or len(found) < 3 or not np.all(np.isfinite(found)):
        raise UsageError(f'{_NEEDED}; found {"none" if vertices is None else f"shape {found.shape}"}')
    polygon = Polygon(found)
    if not polygon.is_valid or not polygon.area:
        raise UsageError(f'{_NEEDED}; found one whose edges cross, or without an area')
    found = found if polygon.exterior.is_ccw else found[::-1]
    if not is_convex(found):
        raise UsageError(f'{_NEEDED}; found one that is not convex')
    return np.ascontiguousarray(found)
