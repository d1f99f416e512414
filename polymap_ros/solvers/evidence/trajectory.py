"""The poses as unknowns, beside the walls: one parameter vector, of which the frame is held.

A vector holds the walls' numbers, then x, y and yaw of pose after pose. Outside of this file only `path` knows that.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.likelihood import Likelihood, S, Slopes
from polymap_ros.solvers.evidence.odometry import Increments
from polymap_ros.solvers.evidence.walls import Walls

_TURN_RAD = 0.1
"""Largest step of a heading: beyond it increments are no longer linear in it to a tenth."""


@dataclass(frozen=True, eq=False)
class World:
    """Walls, and the poses (N, 3) from which they are heard, with the odometry between these.

    `fixed` is the pose that is the frame, where the walls are not.
    """

    walls: Walls
    poses: NDArray[np.float64]
    odometry: Increments
    fixed: int = 0

    @property
    def quiet(self) -> NDArray[np.bool_]:
        """Which numbers nothing is heard of; odometry tells of all poses."""
        return np.concatenate((self.walls.quiet, np.zeros(self.poses.size, np.bool_)))

    def moved(self, step: NDArray[np.float64]) -> 'World':
        """Return the same after a step."""
        walls, poses = self._split(step)
        return replace(self, walls=self.walls.moved(walls), poses=self.poses + poses.reshape(-1, 3))

    def limited(self, step: NDArray[np.float64], r_m: float, theta_rad: float) -> NDArray[np.float64]:
        """Return a step that moves no line and no pose by more than this."""
        walls, poses = self._split(step)
        most = np.tile((r_m, r_m, _TURN_RAD), len(self.poses))
        return np.concatenate((self.walls.limited(walls, r_m, theta_rad), np.clip(poses, -most, most)))

    def held(self, gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which numbers stay: the frame, and what the walls hold."""
        walls, poses = self._split(gradient)
        return np.asarray(self.frame | np.concatenate((self.walls.held(walls), np.zeros(len(poses), np.bool_))))

    @property
    def frame(self) -> NDArray[np.bool_]:
        """Which numbers are the frame, exact by definition: the lines that are known, or else one pose."""
        lines = self.walls.known
        return np.concatenate((lines, np.repeat(np.arange(len(self.poses)) == self.fixed, 3) & ~np.any(lines)))

    @property
    def by_shift(self) -> NDArray[np.float64]:
        """How the numbers (k,) change as all is moved along x and along y, shape (k, 2); not where lines are known."""
        walls = -self.walls.by_pose(np.zeros((1, 3)))[0, :, :2]
        shift = np.vstack((walls, np.tile(np.eye(3, 2), (len(self.poses), 1))))
        return np.zeros_like(shift) if np.any(self.walls.known) else shift

    def log_prior(self) -> float:
        """Return the log prior of the poses."""
        return self.odometry.log_prior(self.poses)

    def gradient(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the gradient of a log likelihood with the prior."""
        by_poses = np.einsum('ijk,ij->ik', self._by_pose, slopes.scores)
        return np.concatenate((self.walls.gradient(slopes), by_poses.ravel() + self._odometry[0]))

    def information(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the Fisher information with the prior: a ping's about the walls is about its pose, too."""
        n, pings = slopes.scores.shape[1], len(self.poses)
        across = slopes.information @ self._by_pose
        own = np.swapaxes(self._by_pose, 1, 2) @ across
        information = np.zeros((n + 3 * pings, n + 3 * pings))
        information[:n, :n] = self.walls.information(slopes)
        information[:n, n:] = across.transpose(1, 0, 2).reshape(n, 3 * pings)
        information[n:, :n] = information[:n, n:].T
        by_poses, i = self._odometry[1].copy(), np.arange(pings)
        by_poses.reshape(pings, 3, pings, 3)[i, :, i] += own
        information[n:, n:] = by_poses
        return information

    def by_phase(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the information between the numbers and the phases."""
        by_poses = np.einsum('ijk,ijq->ikq', self._by_pose, slopes.by_phase)
        return np.concatenate((self.walls.by_phase(slopes), by_poses.reshape(-1, slopes.by_phase.shape[2])))

    def _split(self, numbers: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return numbers[:3 * len(self.walls)], numbers[3 * len(self.walls):]

    @cached_property
    def _by_pose(self) -> NDArray[np.float64]:
        return self.walls.by_pose(self.poses)

    @cached_property
    def _odometry(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.odometry.derivatives(self.poses)


@dataclass(frozen=True, eq=False)
class Joint(Generic[S]):
    """A world, and what a likelihood says of its walls as `heard` from its poses."""

    unknowns: World
    heard: S
    value: float
    slopes: Slopes | None = None

    def with_slopes(self, slopes: Slopes | None) -> 'Joint[S]':
        """Return the same with these derivatives."""
        return replace(self, slopes=slopes)


class JointLikelihood(Generic[S]):
    """A likelihood of the walls, made for any pings by `of`, as one of walls and poses."""

    def __init__(self, of: Callable[[EchoData], Likelihood[S]], data: EchoData) -> None:
        self.data, self._of = data, of
        like = of(data)
        self.damping, self.derives_at_once = like.damping, like.derives_at_once

    def evaluate(self, unknowns: World, like: Joint[S], order: int, derive: bool = False) -> Joint[S] | None:
        """Return the value at a world; None where its walls are no outline."""
        heard = self._of(self.data.at(unknowns.poses)).evaluate(unknowns.walls, like.heard, order, derive)
        if heard is None:
            return None
        return Joint(unknowns, heard, heard.value + unknowns.log_prior(), heard.slopes)
