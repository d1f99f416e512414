"""What a solver answers: the polygon, or what is certain where none closes."""

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import Caution
from polymap_ros.geometry.lines import mirrored_lines, wrapped
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.poses import in_frame
from polymap_ros.geometry.storey import Storey


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
    curvature : float
        Of a wall that is not straight, which touches the line in the middle of the edge [1/m]; above 0 where the room
        bulges.
    curvature_std : float
        Its standard deviation [1/m]; 0 for a straight wall.
    """

    r: float
    theta: float
    likelihood: float
    r_std: float | None = None
    theta_std: float | None = None
    pings: int = 0
    r_theta_covariance: float = 0.0
    curvature: float = 0.0
    curvature_std: float = 0.0

    def __repr__(self) -> str:
        r_std, theta_std = (None if std is None else float(f'{std:.3g}') for std in (self.r_std, self.theta_std))
        return (f'Edge(r={self.r:.5f}, theta={self.theta:.6f}, likelihood={self.likelihood:.3g}, r_std={r_std}, '
                f'theta_std={theta_std}, pings={self.pings})')

    def moved(self, frame: Pose) -> 'Edge':
        """The same wall, seen from the frame in which `frame` is this edge's own origin."""
        theta = self.theta + frame.yaw
        r = self.r + frame.x * np.cos(theta) + frame.y * np.sin(theta)
        moved = dataclasses.replace(self, r=float(r), theta=float(wrapped(theta)))
        return moved._spread(_lever(frame.x, frame.y, theta))

    def mirrored(self, middle: NDArray[np.float64], along: NDArray[np.float64]) -> 'Edge':
        """The mirror image in the line through `middle` along a unit vector."""
        ((r, theta),) = mirrored_lines((self.r, self.theta), middle, along)
        lever = _mirror_lever(self.theta, theta, middle)
        return dataclasses.replace(self, r=float(r), theta=float(theta), r_theta_covariance=-self.r_theta_covariance
                                   )._spread(-lever)

    def turned(self) -> 'Edge':
        """The same line with its normal turned round, as a wall has it that is heard from both sides."""
        return dataclasses.replace(self, r=-self.r, theta=float(wrapped(self.theta + np.pi)),
                                   r_theta_covariance=-self.r_theta_covariance)

    def _spread(self, lever: float) -> 'Edge':
        """With the deviations where r has gained `lever` times theta's error."""
        if self.r_std is None or self.theta_std is None:
            return self
        variance = self.r_std**2 + 2.0 * lever * self.r_theta_covariance + (lever * self.theta_std) ** 2
        covariance = self.r_theta_covariance + lever * self.theta_std**2
        return dataclasses.replace(self, r_std=float(np.sqrt(max(variance, 0.0))), r_theta_covariance=covariance)


_SHOWN = 6
"""Corners that a repr shows."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A closed polygon.

    Parameters
    ----------
    vertices : ndarray, shape (n, 2)
        Corners [m], counter-clockwise.
    edges : tuple of Edge
        Edge i runs from vertex i to vertex i + 1.
    covariance : ndarray or None, shape (2 n, 2 n)
        That of r and theta of edge 0, edge 1, ...; None where only each edge's own is known.
    """

    vertices: NDArray[np.float64]
    edges: tuple[Edge, ...]
    covariance: NDArray[np.float64] | None = None

    def __repr__(self) -> str:
        extent_m = float(np.ptp(self.vertices, axis=0).max()) if len(self.vertices) else 0.0
        digits = int(np.clip(3 - np.floor(np.log10(extent_m)), 0, 9)) if 0.0 < extent_m < np.inf else 3
        corners = ', '.join(f'({x:.{digits}f}, {y:.{digits}f})' for x, y in self.vertices[:_SHOWN])
        return f'Candidate({len(self.edges)} edges: {corners}{", ..." if len(self.vertices) > _SHOWN else ""})'

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


@dataclass(frozen=True, eq=False)
class InnerWall:
    """A wall that stands inside and lets some of the wave through, such as a stiffener or a weld seam.

    Parameters
    ----------
    start, end : ndarray, shape (2,)
        Where it is heard to start and to end, or meets the outline [m]; known far less well than the line between.
    edge : Edge
        Its line, with deviations and likelihood; neither side is the outer one.
    reflection, transmission : float
        What it reflects of the amplitude, signed where there is phase, and what crosses it.
    """

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    edge: Edge
    reflection: float
    transmission: float

    @property
    def ends(self) -> NDArray[np.float64]:
        """Both ends (2, 2) [m]."""
        return np.array((self.start, self.end))

    def moved(self, frame: Pose) -> 'InnerWall':
        """The same wall, seen from the frame in which `frame` is its own origin."""
        start, end = frame.apply(self.ends)
        return dataclasses.replace(self, start=start, end=end, edge=self.edge.moved(frame))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where the robot's base was at the pings whose echoes are kept, estimated with the walls.

    Parameters
    ----------
    stamps_ns : tuple of int
        Of the pings, in the order of time.
    poses : ndarray, shape (n, 3)
        x, y [m] and yaw [rad].
    reported : ndarray, shape (n, 3)
        The same by the odometry.
    covariances : ndarray, shape (n, 3, 3)
        Of the poses, given the first one.
    consistency : ndarray, shape (n,)
        What a ping's echoes are worth at its pose over what they should be, about 1; 0 for one that is lost, whose pose
        is by dead reckoning from the last one that is not.
    """

    stamps_ns: tuple[int, ...]
    poses: NDArray[np.float64]
    reported: NDArray[np.float64]
    covariances: NDArray[np.float64]
    consistency: NDArray[np.float64]

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Which pings (n,) are lost."""
        return np.asarray(self.consistency == 0.0)

    def moved(self, frame: Pose) -> 'Trajectory':
        """The same, seen from the frame in which `frame` is its own origin."""
        c, s = np.cos(frame.yaw), np.sin(frame.yaw)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return dataclasses.replace(self, poses=in_frame(self.poses, frame), reported=in_frame(self.reported, frame),
                                   covariances=turn @ self.covariances @ turn.T)

    @property
    def map_to_odom(self) -> Pose:
        """The odometry's frame as of the last ping, seen from the map's: what corrects the odometry."""
        return Pose(*self.poses[-1].tolist()).compose(Pose(*self.reported[-1].tolist()).inverse())


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
    polygon : Candidate or None
        The answer where one closes.
    walls : tuple of Edge
        Where none closes, the walls that are certain.
    alternatives : tuple of Candidate
        The polygons that fit where several do.
    cost : float or None
        Eq. (5), or the method's own objective; None where there is none.
    iou_free_area : float or None
        IoU of the polygon with the free area A_T.
    cautions : tuple of Caution
        What the user must know about the answer.
    trajectory : Trajectory or None
        The poses where they were estimated; None where the reported ones explain the echoes.
    storey : Storey
        A room's floor and ceiling, where they were heard: the nearer one, which echoes do not tell from the other, is
        taken for the floor.
    holes : tuple of Candidate
        Holes in `polygon`, clockwise: the normals of their edges point into them.
    inner_walls : tuple of InnerWall
        Walls that stand inside `polygon`.
    corner_radius, corner_radius_std : float
        By which all corners are rounded, and its standard deviation [m]; 0 where they are sharp.
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
    trajectory: Trajectory | None = None
    storey: Storey = field(default_factory=Storey)
    holes: tuple[Candidate, ...] = ()
    inner_walls: tuple[InnerWall, ...] = ()
    corner_radius: float = 0.0
    corner_radius_std: float = 0.0

    def __repr__(self) -> str:
        parts = [f'polygon={self.polygon!r}', *(f'{len(found)} {name}' for name, found in (
            ('walls', self.walls), ('alternatives', self.alternatives), ('holes', self.holes),
            ('inner walls', self.inner_walls)) if found)]
        codes = ', '.join(dict.fromkeys(each.code for each in self.cautions))
        return f'Estimate({self.status} by {self.method}, {", ".join(parts)}, cautions: {codes or "none"})'

    @property
    def shape_in_words(self) -> str:
        """What the polygon is made of, such as ``4 edges, 1 hole, 2 inner walls``."""
        edges = len(self.polygon.edges) if self.polygon else 0
        inside = ((len(self.holes), 'hole'), (len(self.inner_walls), 'inner wall'))
        return ', '.join([f'{edges} edges', *(f'{n} {what}{"s" if n > 1 else ""}' for n, what in inside if n)])

    def moved(self, frame: Pose) -> 'Estimate':
        """The same answer, seen from the frame in which `frame` is its own origin."""
        return dataclasses.replace(
            self,
            polygon=self.polygon.moved(frame) if self.polygon else None,
            walls=tuple(edge.moved(frame) for edge in self.walls),
            alternatives=tuple(candidate.moved(frame) for candidate in self.alternatives),
            trajectory=self.trajectory.moved(frame) if self.trajectory else None,
            holes=tuple(hole.moved(frame) for hole in self.holes),
            inner_walls=tuple(wall.moved(frame) for wall in self.inner_walls),
        )
