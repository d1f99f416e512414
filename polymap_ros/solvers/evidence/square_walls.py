"""Walls with right angles: groups of lines, parallel and perpendicular to each other, that turn together.

At a corner of a little less than 90 degrees an echo over both walls comes twice, at a little more not at all, and at
90 degrees once. So what has right angles has its likelihood on a ridge that is a few hundredths of a milliradian
wide, and a climb line by line neither finds nor follows it. Tied together, the lines walk along it.
"""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.outline import corners_of
from polymap_ros.solvers.evidence.likelihood import Slopes
from polymap_ros.solvers.evidence.walls import Walls

_NEARLY_RAD = 5e-3
"""Lines this near to a right angle with each other are tied: power knows the direction of a wall with few feet to
some tenths of a degree, and at the ends of one of 0.1 m this is a quarter of a millimetre."""


@dataclass(frozen=True, eq=False)
class SquareWalls(Walls):
    """Walls of which groups turn together: `group` (n,) has the number of each wall's."""

    group: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    def without(self, wall: int) -> Self:
        """Return the walls without one of them."""
        _, group = np.unique(np.delete(self.group, wall), return_inverse=True)
        return replace(super().without(wall), group=group)

    def _longer(self, lines: NDArray[np.float64], reflection: float, at: int) -> Self:
        """Return the walls and others that turn together."""
        more = np.full(len(lines), int(self.group.max()) + 1)
        return replace(super()._longer(lines, reflection, at), group=np.insert(self.group, at, more))

    def with_outline(self, lines: NDArray[np.float64], reflection: NDArray[np.float64]) -> Walls:
        """Return what stands inside, tied as it is, in another outline, whose walls are each by themselves."""
        inner = self.group[self.ring:]
        if not len(inner):
            return super().with_outline(lines, reflection)
        _, group = np.unique(np.concatenate((-1 - np.arange(len(lines)), inner)), return_inverse=True)
        other = super().with_outline(lines, reflection)
        return SquareWalls(other.lines, other.reflection, other.delay, other.interior, group=group)

    def with_line(self, line: NDArray[np.float64], reflection: float = 1.0) -> Walls:  # type: ignore[override]
        """Return the walls and one more, each by itself: it belongs to no group."""
        return free(self).with_line(line, reflection)

    def inserted(self, at: int, line: NDArray[np.float64], reflection: float) -> Walls:  # type: ignore[override]
        """Return the walls and one more, before a wall, each by itself."""
        return free(self).inserted(at, line, reflection)

    @property
    def _ties(self) -> NDArray[np.float64]:
        """What r, theta and ln |rho| of the walls (3 n) move by with r, the groups' turns and ln |rho|."""
        n, turns = len(self), int(self.group.max()) + 1
        ties = np.zeros((3 * n, 2 * n + turns))
        walls = np.arange(n)
        ties[walls, walls] = 1.0
        ties[n + walls, n + self.group] = 1.0
        ties[2 * n + walls, n + turns + walls] = 1.0
        return ties

    def moved(self, step: NDArray[np.float64]) -> Self:
        """Return the walls after a step."""
        return super().moved(self._ties @ step)

    def limited(self, step: NDArray[np.float64], r_m: float, theta_rad: float) -> NDArray[np.float64]:
        """Return a step, shortened so that it moves no line by more than this."""
        whole = self._ties @ step
        most = super().limited(whole, r_m, theta_rad)
        longest = float(np.max(np.abs(whole) / np.maximum(np.abs(most), 1e-300), initial=1.0, where=whole != 0.0))
        return step / longest

    @property
    def quiet(self) -> NDArray[np.bool_]:
        """Which numbers nothing is heard of."""
        return np.asarray(self._ties.T @ ~super().quiet == 0.0)

    def gradient(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the gradient of a log likelihood with the prior."""
        return np.asarray(super().gradient(slopes) @ self._ties)

    def information(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the Fisher information with the prior."""
        return np.asarray(self._ties.T @ super().information(slopes) @ self._ties)

    def by_phase(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the information between the numbers and the phases."""
        return np.asarray(self._ties.T @ super().by_phase(slopes))

    def held(self, gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which numbers stay: those of silent walls, and coefficients that cannot grow beyond 1."""
        silent = self.quiet
        silent[-len(self):] |= (np.abs(self.reflection) >= 1.0) & (gradient[-len(self):] > 0.0)
        return silent


def free(walls: Walls) -> Walls:
    """Return the same walls, each by itself."""
    if not isinstance(walls, SquareWalls):
        return walls
    return Walls(walls.lines, walls.reflection, walls.delay, walls.interior)


def tied_hole(walls: Walls, lines: NDArray[np.float64]) -> SquareWalls:
    """Return the walls and those of a rectangular hole (4, 2), clockwise, which turn together.

    What few feet know of one of them, the others know better.
    """
    known = walls.group if isinstance(walls, SquareWalls) else np.arange(len(walls))
    tied = SquareWalls(walls.lines, walls.reflection, walls.delay, walls.interior, group=known)
    return tied.with_hole(lines)


def squared(walls: Walls) -> SquareWalls | None:
    """Return the walls with right angles where they nearly have them, each wall turned about its own middle.

    None where they have none, or are no outline.
    """
    lines = walls.lines.copy()
    outline, corners = corners_of(lines)
    if not outline:
        return None
    middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    group = np.arange(len(lines))
    for wall in np.argsort(-lengths, kind='stable'):  # the longest walls know best how they are turned
        off = wrapped(4.0 * (lines[:, 1] - lines[wall, 1])) / 4.0
        with_it = (np.abs(off) < _NEARLY_RAD) & (group == np.arange(len(lines)))
        if group[wall] == wall:
            group[with_it] = wall
    groups, numbers = np.unique(group, return_inverse=True)
    if len(groups) == len(lines):
        return None
    for first in groups:
        members = group == first
        off = wrapped(4.0 * (lines[members, 1] - lines[first, 1])) / 4.0
        mean = float(np.average(off, weights=lengths[members] ** 3))
        lines[members, 1] += mean - off
    turned = np.column_stack((np.cos(lines[:, 1]), np.sin(lines[:, 1])))
    moved = group != np.arange(len(lines))
    moved |= np.isin(np.arange(len(lines)), group[moved])
    lines[moved, 0] = np.einsum('ij,ij->i', middles, turned)[moved]
    return SquareWalls(np.ascontiguousarray(lines), walls.reflection, walls.delay, group=numbers)
