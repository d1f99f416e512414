"""What a solver answers: the polygon, or what is certain where none closes."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.lines import mirrored_lines
from polymap_ros.mapping.pose import Pose


@dataclass(frozen=True)
class Edge:
    """One wall, the line x cos(theta) + y sin(theta) = r of eq. (2).

    Parameters
    ----------
    r : float
        Signed distance of the line from the origin [m].
    theta : float
        Direction of the outward normal [rad].
    likelihood : float
        Probability that the edge is real (``evidence``), or L / max L.
    r_std, theta_std : float or None
        Standard deviations [m], [rad]; None where the method gives none.
    pings : int
        Pings whose perpendicular foot is on the edge.
    r_theta_covariance : float
        Covariance of r and theta [m rad].
    """

    r: float
    theta: float
    likelihood: float
    r_std: float | None = None
    theta_std: float | None = None
    pings: int = 0
    r_theta_covariance: float = 0.0

    def moved(self, frame: Pose) -> 'Edge':
        """The same wall, seen from the frame in which `frame` is this edge's own origin."""
        theta = self.theta + frame.yaw
        r = self.r + frame.x * np.cos(theta) + frame.y * np.sin(theta)
        wrapped = float(np.arctan2(np.sin(theta), np.cos(theta)))
        return dataclasses.replace(self, r=float(r), theta=wrapped)._spread(_lever(frame.x, frame.y, theta))

    def mirrored(self, middle: NDArray[np.float64], along: NDArray[np.float64]) -> 'Edge':
        """The mirror image in the line through `middle` along a unit vector."""
        ((r, theta),) = mirrored_lines((self.r, self.theta), middle, along)
        lever = _mirror_lever(self.theta, theta, middle)
        return dataclasses.replace(self, r=float(r), theta=float(theta), r_theta_covariance=-self.r_theta_covariance
                                   )._spread(-lever)

    def _spread(self, lever: float) -> 'Edge':
        """With the deviations where r has gained `lever` times theta's error."""
        if self.r_std is None or self.theta_std is None:
            return self
        variance = self.r_std**2 + 2.0 * lever * self.r_theta_covariance + (lever * self.theta_std) ** 2
        covariance = self.r_theta_covariance + lever * self.theta_std**2
        return dataclasses.replace(self, r_std=float(np.sqrt(max(variance, 0.0))), r_theta_covariance=covariance)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A closed polygon: counter-clockwise vertices (n, 2) [m]; edge i runs from vertex i to vertex i + 1.

    `covariance` (2 n, 2 n) is that of r and theta of edge 0, edge 1, ...; None where only each edge's own is known.
    """

    vertices: NDArray[np.float64]
    edges: tuple[Edge, ...]
    covariance: NDArray[np.float64] | None = None

    def moved(self, frame: Pose) -> 'Candidate':
        """The same polygon, seen from the frame in which `frame` is its own origin."""
        edges = tuple(edge.moved(frame) for edge in self.edges)
        if self.covariance is None:
            return Candidate(frame.apply(self.vertices), edges)
        change = np.eye(2 * len(edges))
        for k, edge in enumerate(edges):
            change[2 * k, 2 * k + 1] = _lever(frame.x, frame.y, edge.theta)
        return Candidate(frame.apply(self.vertices), edges, change @ self.covariance @ change.T)

    def mirrored(self, middle: NDArray[np.float64], along: NDArray[np.float64]) -> 'Candidate':
        """The mirror image in the line through `middle` along a unit vector, counter-clockwise again."""
        offsets = self.vertices - middle
        vertices = (middle + 2.0 * np.outer(offsets @ along, along) - offsets)[::-1]
        # Reversed, the edge from corner j runs between the images of corners n - 1 - j and n - 2 - j.
        n = len(self.edges)
        order = np.append(np.arange(n - 2, -1, -1), n - 1)
        edges = tuple(self.edges[k].mirrored(middle, along) for k in order)
        if self.covariance is None:
            return Candidate(vertices, edges)
        change = np.zeros((2 * n, 2 * n))
        for row, k in enumerate(order):
            change[2 * row:2 * row + 2, 2 * k:2 * k + 2] = [
                [1.0, _mirror_lever(self.edges[k].theta, edges[row].theta, middle)], [0.0, -1.0]]
        return Candidate(vertices, edges, change @ self.covariance @ change.T)


def _lever(x: float, y: float, theta: float) -> float:
    """How far a place lies along a wall: the further, the more the angle's error moves r as seen from there."""
    return float(y * np.cos(theta) - x * np.sin(theta))


def _mirror_lever(theta: float, image: float, middle: NDArray[np.float64]) -> float:
    """By how much an error of a wall's angle moves r of its mirror image, which keeps its distance from the middle."""
    x, y = middle
    return -_lever(x, y, theta) - _lever(x, y, image)


@dataclass(frozen=True)
class Caution:
    """Something the user must know about an answer: a stable code and a sentence."""

    code: str
    text: str


@dataclass(frozen=True, eq=False)
class Estimate:
    """A solver's answer.

    Parameters
    ----------
    status : str
        ``closed``: `polygon` holds the answer. ``ambiguous``: several fit, see `alternatives`.
        ``open``: no polygon closes, `walls` are those that are certain.
    method : str
        The solver that answered.
    stamp_ns : int
        Stamp of the newest ping used [ns].
    cost : float or None
        Eq. (5), or the method's own objective; None where there is none.
    iou_free_area : float or None
        IoU of the polygon with the free area A_T.
    """

    status: str
    method: str
    stamp_ns: int = 0
    polygon: Candidate | None = None
    walls: tuple[Edge, ...] = ()
    alternatives: tuple[Candidate, ...] = ()
    cost: float | None = None
    iou_free_area: float | None = None
    cautions: tuple[Caution, ...] = ()

    def moved(self, frame: Pose) -> 'Estimate':
        """The same answer, seen from the frame in which `frame` is its own origin."""
        return dataclasses.replace(
            self,
            polygon=self.polygon.moved(frame) if self.polygon else None,
            walls=tuple(edge.moved(frame) for edge in self.walls),
            alternatives=tuple(candidate.moved(frame) for candidate in self.alternatives),
        )
