"""A simple polygon as triangles, to be filled."""

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray


def triangles(vertices: ArrayLike) -> NDArray[np.int64]:
    """Cut a simple polygon into triangles, ear by ear.

    An ear is a corner whose neighbours see each other inside; each simple polygon has two (Meisters 1975).

    Parameters
    ----------
    vertices : array_like, shape (n, 2)
        Corners, counter-clockwise.

    Returns
    -------
    ndarray, shape (n - 2, 3)
        Numbers of the corners of each triangle, counter-clockwise.
    """
    corners = np.asarray(vertices, dtype=float)
    rest, found = list(range(len(corners))), []
    while len(rest) > 3:
        ears = [k for k in range(len(rest)) if _is_ear(corners, rest, k)]
        # Rounding may leave none of a sliver; the flattest corner loses least.
        k = ears[0] if ears else int(np.argmin([abs(_turn(corners, rest, k)) for k in range(len(rest))]))
        found.append((rest[k - 1], rest[k], rest[(k + 1) % len(rest)]))
        del rest[k]
    return np.array([*found, tuple(rest)] if len(rest) == 3 else found, dtype=np.int64).reshape(-1, 3)


def _turn(corners: NDArray[np.float64], rest: list[int], k: int) -> float:
    """Twice the area of the triangle of a corner and its neighbours, below 0 where it points inwards."""
    a, b, c = corners[rest[k - 1]], corners[rest[k]], corners[rest[(k + 1) % len(rest)]]
    return float((b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]))


def _is_ear(corners: NDArray[np.float64], rest: list[int], k: int) -> bool:
    if _turn(corners, rest, k) <= 0.0:
        return False
    own = (rest[k - 1], rest[k], rest[(k + 1) % len(rest)])
    others = [each for each in rest if each not in own]
    return not bool(np.any(shapely.covers(shapely.Polygon(corners[list(own)]), shapely.points(corners[others]))))
