"""A simple polygon, with or without holes, as triangles, to be filled."""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from polymap_ros.geometry.outline import side


def triangles(vertices: ArrayLike, holes: Sequence[ArrayLike] = ()) -> NDArray[np.int64]:
    """Cut a simple polygon into triangles, ear by ear.

    An ear is a corner whose neighbours see each other inside; each simple polygon has two (Meisters 1975). A hole is
    made part of the ring by a bridge there and back.

    Parameters
    ----------
    vertices : array_like, shape (n, 2)
        Corners, counter-clockwise.
    holes : sequence of array_like, shape (m, 2)
        Corners of each hole, clockwise. One that no corner sees, such as one outside, is left filled.

    Returns
    -------
    ndarray, shape (n - 2, 3), or (n + m, 3) with a hole
        Numbers of the corners of each triangle, counter-clockwise; those of holes come after the polygon's.
    """
    rings = [np.asarray(ring, dtype=float).reshape(-1, 2) for ring in (vertices, *holes)]
    corners = np.concatenate(rings)
    rest, found = _bridged(rings), []
    while len(rest) > 3:
        ears = [k for k in range(len(rest)) if _is_ear(corners, rest, k)]
        # Rounding may leave none of a sliver; the flattest corner loses least.
        k = ears[0] if ears else int(np.argmin([abs(_turn(corners, rest, k)) for k in range(len(rest))]))
        found.append((rest[k - 1], rest[k], rest[(k + 1) % len(rest)]))
        del rest[k]
    return np.array([*found, tuple(rest)] if len(rest) == 3 else found, dtype=np.int64).reshape(-1, 3)


def _bridged(rings: Sequence[NDArray[np.float64]]) -> list[int]:
    """Numbers of the corners along one ring about the polygon and its holes, which bridges make a part of it."""
    ends, corners = np.cumsum([len(ring) for ring in rings]), np.concatenate(rings)
    ring, *apart = [list(range(end - len(each), end)) for end, each in zip(ends, rings, strict=True)]
    inside, bridges = shapely.Polygon(rings[0], rings[1:]) if apart else None, shapely.MultiLineString()
    while apart:
        others = [corner for hole in apart for corner in hole]
        for at, corner in _nearest_first(corners, ring, others):
            bridge = shapely.LineString(corners[[ring[at], corner]])
            if _opens_to(corners, ring, at, corner) and shapely.covers(inside, bridge) and not shapely.crosses(
                    bridge, bridges):
                break
        else:
            break
        hole = next(hole for hole in apart if corner in hole)
        k = hole.index(corner)
        ring[at:at] = [ring[at], *hole[k:], *hole[:k + 1]]
        bridges = shapely.union(bridges, bridge)
        apart.remove(hole)
    return ring


def _nearest_first(corners: NDArray[np.float64], ring: list[int], others: list[int]) -> Iterator[tuple[int, int]]:
    """Places in a ring, each with another corner; the nearest two have none between them, which would be nearer."""
    ways = corners[others][None] - corners[ring][:, None]
    order = np.argsort(np.hypot(ways[..., 0], ways[..., 1]), axis=None, kind='stable')
    for at, which in zip(*(each.tolist() for each in np.unravel_index(order, ways.shape[:2])), strict=True):
        yield at, others[which]


def _opens_to(corners: NDArray[np.float64], ring: list[int], at: int, other: int) -> bool:
    """Whether a corner lies within the angle at a place of a ring, of which a corner with a bridge has several."""
    before, here, after = corners[ring[at - 1]], corners[ring[at]], corners[ring[(at + 1) % len(ring)]]
    left = side(before, here, corners[other]) > 0.0, side(here, after, corners[other]) > 0.0
    return all(left) if side(before, here, after) > 0.0 else any(left)


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
