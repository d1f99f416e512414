"""How far what was found inside a polygon is from what is there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.polygon_error import ANGLE_TOLERANCE_RAD, OFFSET_TOLERANCE_M, compare

Points = NDArray[np.float64]

AREA_TOLERANCE = 0.05
"""Share of a round hole's area by which a polygon in its place may be larger or smaller."""


@dataclass(frozen=True)
class InsideComparison:
    """Holes and inner walls that were found against the true ones.

    Parameters
    ----------
    n_true_holes, n_holes : int
        Numbers of true holes, and of those found.
    right_holes : int
        True holes that were found with as many walls, all of them within both tolerances of `compare`; round ones as
        a polygon of their area within `AREA_TOLERANCE` whose centroid is the centre within the tolerance of walls.
    n_true_inner_walls, n_inner_walls : int
        Likewise of inner walls.
    right_inner_walls : int
        True ones whose line was found within both tolerances, the one at the middle of the true wall.
    ends_m : tuple of float
        How far the ends of these are from the true ones, two of each.
    """

    n_true_holes: int
    n_holes: int
    right_holes: int
    n_true_inner_walls: int
    n_inner_walls: int
    right_inner_walls: int
    ends_m: tuple[float, ...]

    @property
    def right(self) -> bool:
        """Whether everything was found, and nothing else."""
        return (self.n_true_holes == self.n_holes == self.right_holes
                and self.n_true_inner_walls == self.n_inner_walls == self.right_inner_walls)


def compare_inside(
    holes: Sequence[Points], inner_walls: Sequence[Points], true_holes: Sequence[Points],
    true_inner_walls: Sequence[Points], offset_tolerance_m: float = OFFSET_TOLERANCE_M,
    angle_tolerance_rad: float = ANGLE_TOLERANCE_RAD, true_circles: Sequence[Points] = (),
) -> InsideComparison:
    """Compare holes, each by its corners (n, 2), clockwise, and inner walls, each by its ends (2, 2), in one frame.

    True holes that are round are given by centre and radius (3,).
    """
    same = [[compare(hole[::-1], true[::-1], offset_tolerance_m, angle_tolerance_rad).right for hole in holes]
            for true in true_holes]
    same += [[_is_round(hole, true, offset_tolerance_m) for hole in holes] for true in true_circles]
    rest, right_holes = list(range(len(holes))), 0
    for is_it in same:
        found = next((k for k in rest if is_it[k]), None)
        if found is not None:
            rest.remove(found)
            right_holes += 1
    walls, right_walls, ends_m = list(inner_walls), 0, list[float]()
    for true in true_inner_walls:
        found = next((k for k, wall in enumerate(walls) if _one_line(
            wall, true, offset_tolerance_m, angle_tolerance_rad)), None)
        if found is not None:
            ends_m += _ends_apart(walls.pop(found), true)
            right_walls += 1
    return InsideComparison(len(same), len(holes), right_holes, len(true_inner_walls), len(inner_walls),
                            right_walls, tuple(ends_m))


def _is_round(hole: Points, circle: Points, tolerance_m: float) -> bool:
    """Whether a polygon is in the place of a round hole."""
    shape = shapely.Polygon(hole)
    off = np.hypot(shape.centroid.x - circle[0], shape.centroid.y - circle[1])
    return bool(off <= tolerance_m and abs(shape.area / (np.pi * circle[2] ** 2) - 1.0) <= AREA_TOLERANCE)


def _one_line(wall: Points, true: Points, offset_tolerance_m: float, angle_tolerance_rad: float) -> bool:
    """Whether a wall's line is the true one's, in whichever direction either runs."""
    (r, theta), (_, true_theta) = polygon_lines(wall)[0], polygon_lines(true)[0]
    offset = r - np.mean(true, axis=0) @ (np.cos(theta), np.sin(theta))
    angle = 0.5 * np.pi - np.mod(0.5 * np.pi - (theta - true_theta), np.pi)
    return bool(abs(offset) <= offset_tolerance_m and abs(angle) <= angle_tolerance_rad)


def _ends_apart(wall: Points, true: Points) -> list[float]:
    """How far the ends are apart, each from the nearer one as far as both can be [m]."""
    ways = (np.linalg.norm(wall - ends, axis=1) for ends in (true, true[::-1]))
    nearest: list[float] = min(ways, key=np.sum).tolist()
    return nearest
