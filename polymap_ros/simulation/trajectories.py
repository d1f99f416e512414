"""Paths of the robot: straight legs and turns, drawn, given, or taken from a recorded odometry."""

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from polymap_ros.errors import SceneError
from polymap_ros.geometry.outline import is_convex
from polymap_ros.simulation.clearance import half_planes
from polymap_ros.simulation.scenes import MOST_PINGS

_LEG_DRAWS = 32
"""Draws of the next leg before a path is given up: in a corner most of them leave the room."""


def legs(
    start: tuple[float, float, float], turns_rad: Sequence[float], lengths_m: Sequence[float], step_m: float
) -> NDArray[np.float64]:
    """Poses (T, 3) every `step_m` of the way along legs, each begun by a turn on the spot.

    Parameters
    ----------
    start : (float, float, float)
        Pose before the first turn: x, y [m], yaw [rad]; also the place of the first ping.
    turns_rad, lengths_m : sequences of float
        Turn before each leg [rad], counter-clockwise, and its length [m].
    step_m : float
        Distance between two pings along the way [m].
    """
    if not (len(turns_rad) == len(lengths_m) > 0 and step_m > 0.0 and min(lengths_m) > 0.0):
        raise SceneError('a trajectory needs legs [turn, length] with lengths above 0, and a step above 0')
    check_count(1.0 + sum(lengths_m) / step_m)
    headings = start[2] + np.cumsum(turns_rad)
    moves = np.asarray(lengths_m)[:, None] * np.column_stack((np.cos(headings), np.sin(headings)))
    corners = np.vstack((start[:2], start[:2] + np.cumsum(moves, axis=0)))
    return _along(corners, headings, np.arange(0.0, np.sum(lengths_m) + 1e-9, step_m))


def check_count(pings: float) -> None:
    """Raise `SceneError` for no ping, or more than a scene may have."""
    if not 1 <= pings <= MOST_PINGS:
        raise SceneError(f'a trajectory of {pings:g} pings; allowed: 1 to {MOST_PINGS}')


def recorded(path: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Poses (count, 3) at equal distances along a recorded path of poses (N, 3), from its start to its end."""
    path = np.asarray(path, dtype=float)
    if path.ndim != 2 or path.shape[1] != 3 or not np.isfinite(path).all():
        raise SceneError('a recorded path must be finite triples [x, y, yaw]')
    travelled = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1))))
    moving = np.concatenate(([True], np.diff(travelled) > 0.0))
    if not travelled[-1] > 0.0:
        raise SceneError('the recorded path does not move')
    at = np.linspace(0.0, travelled[-1], count)
    yaw = np.unwrap(path[:, 2])
    return np.column_stack([np.interp(at, travelled[moving], column[moving])
                            for column in (path[:, 0], path[:, 1], yaw)])


def fitted(
    poses: NDArray[np.float64], vertices: NDArray[np.float64], clearance_m: float, turn_rad: float = 0.0
) -> NDArray[np.float64]:
    """Turn, scale and shift a path (T, 3) so that it fills a convex polygon, no nearer than `clearance_m` to an edge.

    The largest scale s and the shift t follow from the linear programme: maximise s with
    n_k . (s R x_i + t) <= r_k - clearance for all edges k and positions i.
    """
    from scipy.optimize import linprog

    if not is_convex(np.ascontiguousarray(vertices)):
        raise SceneError('a recorded drive is fitted into convex polygons only; give legs, or pings and step_m')
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turned = poses[:, :2] @ np.array([[c, s], [-s, c]])
    normals, offsets = half_planes(vertices)
    furthest = (turned @ normals.T).max(axis=0)
    solution = linprog([-1.0, 0.0, 0.0], A_ub=np.column_stack((furthest, normals)), b_ub=offsets - clearance_m,
                       bounds=[(0.0, None), (None, None), (None, None)])
    if not solution.success:
        raise SceneError(f'no path fits into the polygon with a clearance of {clearance_m:g} m')
    scale, x, y = solution.x
    return np.column_stack((scale * turned + (x, y), poses[:, 2] + turn_rad))


def random_legs(
    vertices: NDArray[np.float64], count: int, step_m: float, clearance_m: float, generator: np.random.Generator,
    holes: Sequence[NDArray[np.float64]] = (),
) -> NDArray[np.float64] | None:
    """Draw poses (count, 3) about `step_m` apart on legs between random places at least `clearance_m` inside.

    Each leg heads for a place drawn in the room and ends at the last whole step before it; the step varies by
    +-7 % from leg to leg. None where the room leaves no leg of one step, or the walk ran into a dead end. In a
    room that is not convex, or has holes, it is as in `legs_inside`.
    """
    if len(holes) or not is_convex(np.ascontiguousarray(vertices)):
        return legs_inside(vertices, count, step_m, clearance_m, generator, holes)
    normals, offsets = half_planes(vertices)
    limits = offsets - clearance_m
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    places = generator.uniform(low, high, size=(_LEG_DRAWS * count, 2))
    places = places[(places @ normals.T <= limits).all(axis=1)]
    steps = step_m * generator.uniform(0.93, 1.07, size=len(places))
    if len(places) == 0:
        return None
    corners, headings, marks = [places[0]], [], [0.0]
    for target, step in zip(places[1:], steps[1:], strict=True):
        x, y = target - corners[-1]
        hops = int(min(np.hypot(x, y) / step, count))
        if hops == 0:
            continue
        headings.append(float(np.arctan2(y, x)))
        corners.append(corners[-1] + hops * step * np.array([np.cos(headings[-1]), np.sin(headings[-1])]))
        marks.extend(marks[-1] + step * np.arange(1, hops + 1))
        if len(marks) >= count:
            return _along(np.array(corners), np.array(headings), np.array(marks[:count]))
    return None


def legs_inside(
    vertices: NDArray[np.float64], count: int, step_m: float, clearance_m: float, generator: np.random.Generator,
    holes: Sequence[NDArray[np.float64]] = (),
    next_place: Callable[[Sequence[tuple[float, float, float]]], NDArray[np.float64]] | None = None,
) -> NDArray[np.float64]:
    """Draw poses (count, 3) `step_m` apart on straight legs between random places in a simple polygon (n, 2).

    Each leg is clear of the edges, and of holes (k, 2), and ends at the last whole step before its place, which is
    drawn from everywhere, or by `next_place` after the poses so far.

    Raises
    ------
    SceneError
        Where the polygon is too narrow for such a walk.
    """
    free = shapely.Polygon(vertices, holes).buffer(-clearance_m)
    shapely.prepare(free)
    if free.is_empty:
        raise SceneError(f'no place in the polygon is {clearance_m:g} m away from its edges')
    poses: list[tuple[float, float, float]] = []
    place = None
    for _ in range(_LEG_DRAWS * (count + _LEG_DRAWS)):
        if len(poses) >= count:
            return np.array(poses[:count])
        target = next_place(poses) if next_place else generator.uniform(vertices.min(axis=0), vertices.max(axis=0))
        if not free.covers(shapely.Point(target) if place is None else shapely.LineString((place, target))):
            continue
        if place is not None:
            x, y = target - place
            hops = int(np.hypot(x, y) / step_m)
            heading = float(np.arctan2(y, x))
            steps = np.arange(1, hops + 1)[:, None] * step_m * np.array((np.cos(heading), np.sin(heading)))
            poses += [(float(at[0]), float(at[1]), heading) for at in place + steps]
            target = place + steps[-1] if hops else place
        place = target
    raise SceneError(f'no walk of {count} steps of {step_m:g} m found in the polygon, {clearance_m:g} m off its edges')


def _along(
    corners: NDArray[np.float64], headings: NDArray[np.float64], travelled_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Poses at the given distances along a polyline (legs + 1, 2) with one heading per leg."""
    ends = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))))
    leg = np.clip(np.searchsorted(ends, travelled_m - 1e-9) - 1, 0, len(headings) - 1)
    x, y = (np.interp(travelled_m, ends, column) for column in corners.T)
    return np.column_stack((x, y, np.asarray(headings)[leg]))
