"""The walls as unknowns: three numbers each, r [m], theta [rad] and ln |rho|, as one block of a parameter vector.

A vector holds r of all walls, then theta, then ln |rho|. The likelihoods fill its columns in that order. The outline's
walls come first, then those of holes and those that stand inside (`geometry.sides`).
"""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.curved import curved_sides, rounded_sides
from polymap_ros.geometry.lines import moved_lines, polygon_lines
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.sides import NOTHING, Interior, Sides, sides_of
from polymap_ros.solvers.evidence.likelihood import Slopes

LOSS_DEVIATION = 0.35
"""Prior standard deviation of ln |rho| about 0: covers reflection coefficients from 0.5 to 1 within two."""

_LEAST_REFLECTION = 1e-6
"""Reflection coefficient of a wall that is heard, at least, where a logarithm is needed."""

_LOUDER = 0.25
"""Largest step of ln |rho|: with twice that, walls that are still in the wrong place are silenced, or their neighbours,
before they have moved (of 15 plates with an edge of 3 cm, 10 came out right instead of 13)."""


_REFLECTS_ALL = 0.8
"""Coefficient from which an inner wall would let less through than it reflects: where a wall of the outline was missing
or a hole, inner walls in its place had 0.9 and more (outlines that are not convex, even seeds)."""


@dataclass(frozen=True, eq=False)
class Walls:
    """A ring of lines with their reflection coefficients.

    A subclass may tie numbers or hold them: `climb` asks the walls how they move, what is held, what is known before.

    Parameters
    ----------
    lines : ndarray, shape (n, 2)
        r [m] and theta [rad]; sorted by theta for a convex outline.
    reflection : ndarray, shape (n,)
        Coefficients, signed where there is phase, of magnitude 1 at most; 0 for a wall that is silent: it bounds the
        outline and is not heard.
    delay : ndarray, shape (n,)
        How much more each of them delays the phase than all do [rad] (`edge_phase`); empty where none does.
    interior : Interior
        Which of the last lines are of holes, and of inner walls.
    bend : ndarray, shape (n, 2)
        How they are curved (`geometry.curved`), of a convex outline; empty where all are straight.
    round : ndarray, shape (2,)
        Radius by which the corners of a convex outline are rounded, and by how much nearer their echoes seem than they
        are [m]; empty where they are sharp.
    """

    lines: NDArray[np.float64]
    reflection: NDArray[np.float64]
    delay: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    interior: Interior = NOTHING
    bend: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    round: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @classmethod
    def convex(
        cls, lines: NDArray[np.float64], reflection: NDArray[np.float64] | float = 1.0,
        delay: NDArray[np.float64] | None = None, bend: NDArray[np.float64] | None = None,
    ) -> Self:
        """Return walls in the order of a convex outline, with one coefficient or one for each."""
        order = np.argsort(lines[:, 1], kind='stable')
        coefficients = np.broadcast_to(np.asarray(reflection, dtype=float), (len(lines),))
        own = delay[order] if delay is not None and len(delay) else np.empty(0)
        bent = bend[order] if bend is not None and len(bend) else np.empty((0, 2))
        return cls(np.ascontiguousarray(lines[order]), coefficients[order], own, bend=bent)

    @classmethod
    def of_polygon(cls, vertices: NDArray[np.float64]) -> Self:
        """Return fully reflecting walls on the edges of a convex polygon (n, 2), counter-clockwise [m]."""
        return cls.convex(polygon_lines(vertices))

    def __len__(self) -> int:
        """Return the number of walls."""
        return len(self.lines)

    @property
    def ring(self) -> int:
        """The number of walls of the outline."""
        return len(self.lines) - int(self.interior.holes.sum()) - len(self.interior.spans)

    @property
    def outline(self) -> NDArray[np.float64]:
        """The lines of the outline."""
        return self.lines[:self.ring]

    @property
    def turns(self) -> NDArray[np.float64]:
        """By how much the outline turns left at the corner before each wall (n,) [rad]; beyond pi it points inwards."""
        return np.asarray(np.mod(self.outline[:, 1] - np.roll(self.outline[:, 1], 1), 2.0 * np.pi))

    @property
    def has_reflex_corner(self) -> bool:
        """Whether a corner of the outline points inwards."""
        return bool(np.any(self.turns >= np.pi))

    def slight_run(self, below_rad: float) -> list[int]:
        """Return the edges of the longest run that turn left by less than this, two times or more one after the other.
        """
        slight, n = self.turns < below_rad, self.ring
        runs = [[(first + k) % n for k in range(corners + 1)] for first in range(n) for corners in range(2, n)
                if all(slight[(first + k) % n] for k in range(1, corners + 1))]
        return max(runs, key=len, default=[])

    @property
    def convex_outline(self) -> bool:
        """Whether the lines, in their order, bound a convex outline, with nothing inside."""
        return self.ring == len(self) and not self.has_reflex_corner

    @property
    def let_through(self) -> bool:
        """Whether all inner walls let enough through: what reflects nearly all is a wall of the outline, or of a hole,
        that is in the wrong place.
        """
        inner = self.reflection[len(self) - len(self.interior.spans):]
        return bool(np.all(np.abs(inner) < _REFLECTS_ALL))

    def sides(self, soft_m: float, shortest_m: float) -> tuple[bool, Sides]:
        """Return the sides that reflect, and whether the walls are an outline with what is in it (`sides_of`)."""
        bound, sides = sides_of(self.lines, self.interior, soft_m, shortest_m)
        if sides.convex and len(self.round):
            bound, sides = rounded_sides(sides, self.round, shortest_m)
        return bound, curved_sides(sides, self.bend) if bound and sides.convex and len(self.bend) else sides

    @property
    def loss(self) -> NDArray[np.float64]:
        """ln |rho| (n,); 0 for a silent wall, whose coefficient stays."""
        return np.where(self.silent, 0.0, np.log(np.maximum(np.abs(self.reflection), _LEAST_REFLECTION)))

    @property
    def curvature(self) -> NDArray[np.float64]:
        """Curvatures (n,) [1/m]; above 0 where the room bulges."""
        return self.bend[:, 0] if len(self.bend) else np.zeros(len(self))

    @property
    def silent(self) -> NDArray[np.bool_]:
        """Which walls (n,) are not heard."""
        return np.asarray(self.reflection == 0.0)

    def without_delays(self) -> Self:
        """Return the walls without delays of their own, with the signs that come nearest to these."""
        common = 0.5 * np.angle(np.sum(np.exp(2j * self.delay)))
        turned = np.cos(self.delay - common) < 0.0
        signs = np.where(turned, -1.0, 1.0) if len(self.delay) else 1.0
        return replace(self, reflection=signs * self.reflection, delay=np.empty(0))

    def without(self, wall: int) -> Self:
        """Return the walls without one of them."""
        lines = np.ascontiguousarray(np.delete(self.lines, wall, 0))
        fewer = replace(self, lines=lines, reflection=np.delete(self.reflection, wall),
                        delay=np.delete(self.delay, wall) if len(self.delay) else self.delay,
                        interior=self._interior_without(wall))
        return fewer.with_bend(np.delete(self.bend, wall, 0)) if len(self.bend) else fewer

    def with_bend(self, bend: NDArray[np.float64]) -> Self:
        """Return the walls curved so (n, 2); straight ones, without a bend, where none is."""
        return replace(self, bend=bend if np.any(bend[:, 0]) else np.empty((0, 2)))

    def without_hole(self, hole: int) -> Self:
        """Return the walls without those of a hole."""
        holes, spans = self.interior
        first = self.ring + int(holes[:hole].sum())
        fewer = self
        for _ in range(int(holes[hole])):
            fewer = fewer.without(first)
        return replace(fewer, interior=Interior(np.delete(holes, hole), spans))

    def _interior_without(self, wall: int) -> Interior:
        holes, spans = self.interior
        after = wall - self.ring
        if after < 0:
            return self.interior
        hole = int(np.searchsorted(np.cumsum(holes), after, side='right'))
        if hole < len(holes):
            return Interior(holes - (np.arange(len(holes)) == hole), spans)
        return Interior(holes, np.ascontiguousarray(np.delete(spans, after - int(holes.sum()), 0)))

    def with_inner(self, line: NDArray[np.float64], span: NDArray[np.float64], reflection: float) -> Self:
        """Return the walls and one that stands inside, from where to where along its line, and what it lets through."""
        spans = np.vstack((self.interior.spans, span))
        return replace(self._longer(line[None], reflection, len(self)), interior=Interior(self.interior.holes, spans))

    def with_spans(self, spans: NDArray[np.float64]) -> Self:
        """Return the walls with the inner ones from elsewhere to elsewhere, or letting other shares through."""
        return replace(self, interior=Interior(self.interior.holes, spans))

    def with_hole(self, lines: NDArray[np.float64]) -> Self:
        """Return the walls and those of one hole more, clockwise, that reflect all."""
        holes, spans = self.interior
        longer = self._longer(lines, 1.0, len(self) - len(spans))
        return replace(longer, interior=Interior(np.append(holes, len(lines)), spans))

    def _longer(self, lines: NDArray[np.float64], reflection: float, at: int) -> Self:
        """Return the walls and others before wall `at`, all of them straight, and the corners sharp."""
        return replace(self, lines=np.ascontiguousarray(np.insert(self.lines, at, lines, 0)),
                       reflection=np.insert(self.reflection, at, np.full(len(lines), reflection)),
                       delay=np.insert(self.delay, at, np.zeros(len(lines))) if len(self.delay) else self.delay,
                       bend=np.empty((0, 2)), round=np.empty(0))

    def silenced(self, wall: int) -> Self:
        """Return the walls with one of them silent."""
        reflection = self.reflection.copy()
        reflection[wall] = 0.0
        return replace(self, reflection=reflection)

    def with_line(self, line: NDArray[np.float64], reflection: float = 1.0) -> Self:
        """Return a convex outline's walls and one more."""
        delay = np.append(self.delay, 0.0) if len(self.delay) else None
        bend = np.vstack((self.bend, np.zeros(2))) if len(self.bend) else None
        longer = self.convex(np.vstack((self.lines, line)), np.append(self.reflection, reflection), delay, bend)
        return replace(longer, round=self.round)

    def with_outline(self, lines: NDArray[np.float64], reflection: NDArray[np.float64]) -> 'Walls':
        """Return what stands inside in another outline, the lines of which (m, 2) are in their order."""
        inner = slice(self.ring, None)
        return Walls(np.ascontiguousarray(np.vstack((lines, self.lines[inner]))),
                     np.concatenate((reflection, self.reflection[inner])), interior=self.interior)

    def inserted(self, at: int, line: NDArray[np.float64], reflection: float) -> Self:
        """Return the walls and one more, between wall `at` - 1 and wall `at`."""
        return self._longer(line[None], reflection, at)

    def shifted(self, wall: int, by_m: float, turned: bool = False) -> Self:
        """Return the walls with one of them farther out, the sign of its coefficient turned if asked for."""
        lines, reflection = self.lines.copy(), self.reflection.copy()
        lines[wall, 0] += by_m
        reflection[wall] *= -1.0 if turned else 1.0
        return replace(self, lines=lines, reflection=reflection)

    def seen_from(self, frame: Pose) -> Self:
        """Return the same walls, seen from the frame in which `frame` is their own origin."""
        lines, (holes, spans) = moved_lines(self.lines, frame), self.interior
        ahead = frame.y * np.cos(lines[:, 1]) - frame.x * np.sin(lines[:, 1])
        moved = Interior(holes, spans + ahead[len(lines) - len(spans):, None] * np.array((1.0, 1.0, 0.0)))
        bend = self.bend + ahead[:len(self.bend), None] * np.array((0.0, 1.0))
        return replace(self.on(lines), interior=moved, bend=bend)

    def on(self, lines: NDArray[np.float64]) -> Self:
        """Return the same walls on other lines."""
        return replace(self, lines=np.ascontiguousarray(lines))

    # The block of the parameter vector.

    def moved(self, step: NDArray[np.float64]) -> Self:
        """Return the walls after a step (3 n,); none reflects more than all."""
        r, theta, loss = step.reshape(3, -1)
        lines = self.lines + np.column_stack((r, theta))
        louder = np.abs(self.reflection) * np.exp(loss)
        return replace(self, lines=lines, reflection=np.sign(self.reflection) * np.minimum(louder, 1.0))

    def limited(self, step: NDArray[np.float64], r_m: float, theta_rad: float) -> NDArray[np.float64]:
        """Return a step (3 n,) that moves no line by more than this."""
        most = np.repeat((r_m, theta_rad, _LOUDER), len(self))
        return np.asarray(np.clip(step, -most, most))

    def log_prior(self) -> float:
        """Return the log prior of the losses."""
        return -0.5 * float(np.sum(self.loss**2)) / LOSS_DEVIATION**2

    @property
    def quiet(self) -> NDArray[np.bool_]:
        """Which numbers (3 n,) nothing is heard of."""
        return np.tile(self.silent, 3)

    def gradient(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the gradient (3 n,) of a log likelihood with the prior."""
        gradient = slopes.scores.sum(axis=0)
        gradient[2 * len(self):] -= self.loss / LOSS_DEVIATION**2
        return np.asarray(gradient)

    def information(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the Fisher information (3 n, 3 n) with the prior."""
        information = slopes.information.sum(axis=0)
        losses = np.arange(2 * len(self), 3 * len(self))
        information[losses, losses] += 1.0 / LOSS_DEVIATION**2
        return np.asarray(information)

    def by_phase(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the information (3 n, q) between the walls and the phases."""
        return np.asarray(slopes.by_phase.sum(axis=0))

    def by_pose(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how the walls move as seen from poses (N, 3) that do: a matrix (3 n, 3) by each, shape (N, 3 n, 3).

        What a ping hears depends on the walls as its pose sees them, at r - n . (x, y) and theta - yaw; so a
        likelihood's derivatives by the walls are those by the pose, too.
        """
        c, s = np.cos(self.lines[:, 1]), np.sin(self.lines[:, 1])
        n, matrix = len(self), np.zeros((len(poses), 3 * len(self), 3))
        matrix[:, :n, 0], matrix[:, :n, 1] = -c, -s
        matrix[:, :n, 2] = poses[:, :1] * s - poses[:, 1:2] * c
        matrix[:, n:2 * n, 2] = -1.0
        return matrix

    def held(self, gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which numbers (3 n,) stay: those of silent walls, and coefficients that cannot grow beyond 1."""
        silent = self.quiet
        silent[2 * len(self):] |= (np.abs(self.reflection) >= 1.0) & (gradient[2 * len(self):] > 0.0)
        return silent

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which numbers (3 n,) are known, and stay: none here; where they are, they are the frame of all poses."""
        return np.zeros(3 * len(self), np.bool_)

    @staticmethod
    def of_lines(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the part (2 n, 2 n) of a matrix (3 n, 3 n) that is about r and theta, wall by wall."""
        n = len(matrix) // 3
        by_wall = np.arange(2 * n).reshape(2, n).T.ravel()
        return matrix[np.ix_(by_wall, by_wall)]


class KnownWalls(Walls):
    """Walls of a map that is given: their lines stay, only what they reflect is found."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """The lines."""
        return np.arange(3 * len(self)) < 2 * len(self)

    def held(self, gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which numbers (3 n,) stay: those of the lines, too."""
        return np.asarray(super().held(gradient) | self.known)
