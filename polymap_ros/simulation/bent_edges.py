"""Edges that are curved a little, and corners that are rounded: what becomes of the paths of image sources.

A curved edge is a parabola, an arc for all that is asked here, that touches the straight edge in its middle. A path
over it is where the length of the way over one point of each edge is stationary. It is found from the path over
straight edges by Newton's method; beside such a path there is no other where the edges are far from their foci.
What a curved edge focuses is that of a tube of rays: with h its width and a its opening, on the way over l,
h grows by l a, and at an edge of curvature c, hit at the angle i, a shrinks by 2 c h / cos i.

A rounded corner is a circle to which both edges are tangents. They end where it begins, and it returns an echo of its
own to places whose ray through the circle's centre meets it: sqrt(a / D) as strong as a wall's over the same way, a the
radius and D the distance of the centre, and ahead by a quarter of a cycle since it has passed a focus. What corners
return of higher orders is left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.image_sources import Images, trace_images
from polymap_ros.geometry.sides import outline_sides
from polymap_ros.simulation.propagation import Way, ways

_BEYOND = 0.1
"""Straight edges are taken to be longer by this share of the outline's size to each side: curved ones may give a path
whose straight one would miss."""

_CAPACITY, _NEWTON_STEPS, _STATIONARY, _OF_LEG = 256, 24, 1e-9, 0.5
"""Half the room for straight paths to begin with; steps to the stationary one, what is left of its slope, and the share
of its shortest leg by which points are moved in a step at most."""

_ASIDE, _DIRECTION_RAD, _TOUCH = 1e-7, 1.2345, 1e-10
"""Paths are traced to a place this share of the outline's size beside the receiver: of the two orders of the edges of
a right angle one is then left, as it has to be. A point that is as little past an edge is on it."""


@dataclass(frozen=True, eq=False)
class BentOutline:
    """A convex outline the edges of which are curved, and the corners rounded.

    Parameters
    ----------
    vertices : ndarray, shape (n, 2)
        Corners of the straight edges, counter-clockwise [m].
    curvature : ndarray, shape (n,)
        Of each edge [1/m]; above 0 where it falls back behind its ends, so that the room bulges.
    corner_radius_m : float
        Radius of the rounded corners [m]; 0 where they are sharp.
    """

    vertices: NDArray[np.float64]
    curvature: NDArray[np.float64]
    corner_radius_m: float = 0.0

    @property
    def _frames(self) -> tuple[NDArray[np.float64], ...]:
        """Middles (n, 2), directions (n, 2), outward normals (n, 2) and half lengths (n,) of the edges."""
        along = np.roll(self.vertices, -1, axis=0) - self.vertices
        length = np.hypot(*along.T)
        along = along / length[:, None]
        return self.vertices + 0.5 * length[:, None] * along, along, np.column_stack((along[:, 1], -along[:, 0])), (
            0.5 * length)

    def paths(
        self, emitter: NDArray[np.float64], receiver: NDArray[np.float64], order: int, reflection: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], list[Way]]:
        """Return the amplitudes (m,), before spreading, and the ways of the paths over up to `order` edges."""
        found: list[Way] = []
        amplitudes: list[complex] = []
        for walls, points in self._straight(emitter, receiver, order):
            for met, way in zip(*self._settled(walls, points), strict=True):
                found.append(Way(met, way))
                amplitudes.append(complex(reflection[met].prod() * self._focused(found[-1])))
        for amplitude, corner_way in self._from_corners(emitter, receiver, reflection):
            found.append(corner_way)
            amplitudes.append(amplitude)
        return np.array(amplitudes), found

    @property
    def leaves_edges(self) -> bool:
        """Whether something of every edge is left between rounded corners."""
        return bool(np.all(2.0 * self._frames[3] > np.sum(self._trimmed, axis=0)))

    @property
    def _size(self) -> float:
        return float(np.ptp(self.vertices, axis=0).max())

    def _straight(
        self, emitter: NDArray[np.float64], receiver: NDArray[np.float64], order: int
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Give, order by order, edges (m, k) and points (m, k + 2, 2) of ways over straight edges that may be longer
        than they are.
        """
        soft, aside = _BEYOND * self._size, _ASIDE * self._size
        receiver = receiver + aside * np.array((np.cos(_DIRECTION_RAD), np.sin(_DIRECTION_RAD)))
        sides = outline_sides(self.vertices, soft, True)
        count = capacity = _CAPACITY
        while count >= capacity:
            capacity *= 2
            images, walls = np.empty((capacity, 3)), np.full((capacity, order), -1, np.int64)
            count = trace_images(sides, emitter[0], emitter[1], receiver[0], receiver[1], order, np.inf, soft, False,
                                 images, walls)
        images, walls = images[:count], walls[:count]
        found = ways(Images(np.empty(count), np.empty(count), (walls >= 0).sum(axis=1), walls, images[:, :2]),
                     self.vertices, receiver)
        for hits in range(1, order + 1):
            if same := [way for way in found if len(way.walls) == hits]:
                yield np.array([way.walls for way in same]), np.array([way.points for way in same])

    def _settled(
        self, walls: NDArray[np.int64], points: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the edges and the stationary ways over them of those that leave none of their edges."""
        middles, along, normals, half = (column[walls] for column in self._frames)
        c, hits = self.curvature[walls], np.arange(walls.shape[1])
        t, points = np.einsum('mki,mki->mk', points[:, 1:-1] - middles, along), points.copy()
        for _ in range(_NEWTON_STEPS):
            points[:, 1:-1] = middles + t[..., None] * along - (0.5 * c * t**2)[..., None] * normals
            tangents = along - (c * t)[..., None] * normals
            legs = np.diff(points, axis=1)
            length = np.maximum(np.linalg.norm(legs, axis=2), _TOUCH * self._size)
            unit = legs / length[..., None]
            turn = unit[:, :-1] - unit[:, 1:]
            slope = np.einsum('mki,mki->mk', turn, tangents)
            across = np.einsum('mki,mki->mk', tangents, tangents)
            before, after = (np.einsum('mki,mki->mk', tangents, each) for each in (unit[:, :-1], unit[:, 1:]))
            bend = np.zeros((*walls.shape, walls.shape[1]))
            bend[:, hits, hits] = ((across - before**2) / length[:, :-1] + (across - after**2) / length[:, 1:]
                                   - c * np.einsum('mki,mki->mk', turn, normals))
            both = np.einsum('mki,mki->mk', tangents[:, :-1], tangents[:, 1:]) - after[:, :-1] * before[:, 1:]
            bend[:, hits[:-1], hits[1:]] = bend[:, hits[1:], hits[:-1]] = -both / length[:, 1:-1]
            step = (np.linalg.pinv(bend, hermitian=True) @ slope[..., None])[..., 0]
            # Beside a corner a leg is short, and a step that is longer leads past it.
            most = _OF_LEG * length.min(axis=1) / np.maximum(np.abs(step).max(axis=1), 1e-300)
            t = np.clip(t - np.minimum(most, 1.0)[:, None] * step, -2.0 * half, 2.0 * half)
        reflected = np.einsum('mki,mki->mk', turn, normals).min(axis=1) > _STATIONARY  # straight on is stationary, too
        whole = (np.abs(slope).max(axis=1) < _STATIONARY) & reflected & self._is_clear(walls, points)
        if self.corner_radius_m:
            first, last = self._trimmed
            whole &= ((t >= first[walls] - half) & (t <= half - last[walls])).all(axis=1)
        return walls[whole], points[whole]

    def _is_clear(self, walls: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which ways (m,) stay inside all edges; they may be on those that they meet.

        What is left to an edge, -y - c t^2 / 2 with t along it and y beyond its line, is a parabola over each leg,
        lowest at an end unless the edge bulges inwards.
        """
        middles, along, normals, _ = self._frames
        clear = np.ones(len(walls), np.bool_)
        for edge in range(len(self.vertices)):
            t, y = (points - middles[edge]) @ along[edge], (points - middles[edge]) @ normals[edge]
            left = -y - 0.5 * self.curvature[edge] * t**2
            on = np.pad(walls == edge, ((0, 0), (1, 1)))
            clear &= (on | (left > -_TOUCH * self._size)).all(axis=1)
            bend = -0.5 * self.curvature[edge] * np.diff(t, axis=1) ** 2
            if self.curvature[edge] < 0.0:
                fall = np.diff(left, axis=1) - bend
                share = np.clip(-0.5 * fall / np.maximum(bend, 1e-300), 0.0, 1.0)
                lowest = left[:, :-1] + fall * share + bend * share**2
                clear &= (on[:, :-1] | on[:, 1:] | (lowest > -_TOUCH * self._size)).all(axis=1)
        return clear

    @property
    def _trimmed(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """By how much each edge (n,) begins after its first corner and ends before its second [m]."""
        _, along, _, _ = self._frames
        turns = np.arccos(np.clip(np.einsum('ij,ij->i', np.roll(along, 1, axis=0), along), -1.0, 1.0))
        cut = self.corner_radius_m * np.tan(0.5 * turns)
        return cut, np.roll(cut, -1)

    def _focused(self, way: Way) -> float:
        """What the edges' curvature makes of the amplitude: the root of how much wider a straight tube of rays is."""
        legs = way.legs
        length = np.hypot(*legs.T)
        middles, along, normals, _ = self._frames
        wide, opening = length[0], 1.0
        for k, edge in enumerate(way.walls):
            lean = self.curvature[edge] * float((way.points[k + 1] - middles[edge]) @ along[edge])
            steep = np.hypot(1.0, lean)
            cosine = legs[k] @ (normals[edge] + lean * along[edge]) / (length[k] * steep)
            opening -= 2.0 * self.curvature[edge] / steep**3 * wide / cosine
            wide += length[k + 1] * opening
        return float(np.sqrt(length.sum() / abs(wide)))

    def _from_corners(
        self, emitter: NDArray[np.float64], receiver: NDArray[np.float64], reflection: NDArray[np.float64]
    ) -> list[tuple[complex, Way]]:
        """Amplitudes and ways of the echoes that rounded corners return; the emitter near the receiver."""
        if not self.corner_radius_m:
            return []
        found, place = [], 0.5 * (emitter + receiver)
        _, along, normals, _ = self._frames
        for k, corner in enumerate(self.vertices):
            inwards = -(normals[k - 1] + normals[k]) / (1.0 + normals[k - 1] @ normals[k])
            centre = corner + self.corner_radius_m * inwards
            ray = centre - place
            away = float(np.hypot(*ray))
            if ray @ along[k - 1] < 0.0 or ray @ along[k] > 0.0:
                continue
            point = centre + self.corner_radius_m * ray / away
            strength = np.sqrt(abs(reflection[k - 1] * reflection[k])) * np.sign(reflection[k])
            found.append((1j * strength * np.sqrt(self.corner_radius_m / away),
                          Way(np.array([k]), np.array((emitter, point, receiver)))))
        return found
