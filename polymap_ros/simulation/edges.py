"""What a scene's edges do to what they reflect beside taking some of it: they turn its phase, they delay it, and they
may not be straight.

All of it is off by default: edges are straight, corners sharp, and coefficients real.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.plate_edge import free_edge_delay
from polymap_ros.errors import SceneError
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.outline import is_convex
from polymap_ros.simulation.bent_edges import BentOutline
from polymap_ros.simulation.propagation import Way
from polymap_ros.specification import Group, parameter

EDGES_STREAM = 9
"""Stream of a scene's random numbers that draws each edge's own delay."""


@dataclass(frozen=True)
class Edges(Group):
    """How edges turn the phase and delay; what they leave of the amplitude is the scene's `reflection`."""

    PREFIX = 'edges.'
    kind: str = parameter('real', "real: not at all; free: by the angle of incidence, as a thin plate's free edge does",
                          choices=('real', 'free'))
    poisson: float = parameter(0.33, "Poisson's ratio of the plate (free)", minimum=0.0, maximum=0.5)
    delay_deg: float = parameter(0.0, 'by how much more every reflection delays the phase', unit='deg', minimum=-360.0,
                                 maximum=360.0)
    spread_deg: float = parameter(0.0, "half the range in which each edge's own delay beside that is drawn", unit='deg',
                                  minimum=0.0, maximum=180.0)
    delay_s: float = parameter(0.0, 'by how much every reflection delays the wave, whatever its frequency: a coating',
                               unit='s', minimum=-1.0, maximum=1.0)
    curvature_1_m: float = parameter(
        0.0, 'curvature of one edge, which touches the straight one in its middle; above 0 the plate bulges there',
        unit='1/m', minimum=-1.0, maximum=1.0)
    curved_edge: int = parameter(0, 'the edge that is curved, counted from 0, counter-clockwise', minimum=0,
                                 maximum=1000)
    corner_radius_m: float = parameter(0.0, 'radius by which all corners are rounded', unit='m', minimum=0.0,
                                       maximum=10.0)

    @property
    def are_bent(self) -> bool:
        """Whether an edge is curved or corners are rounded."""
        return self.curvature_1_m != 0.0 or self.corner_radius_m != 0.0

    def check_outline(self, vertices: NDArray[np.float64], anisotropic: bool) -> None:
        """Raise `SceneError` where a polygon (n, 2) cannot be bent so, or not in such a medium."""
        if not self.are_bent:
            return
        if anisotropic or not is_convex(vertices):
            raise SceneError('edges.curvature_1_m and edges.corner_radius_m act in convex outlines, without '
                             'propagation.anisotropy, only; leave them out')
        if self.curvature_1_m and self.curved_edge >= len(vertices):
            raise SceneError(f'edges.curved_edge must be below {len(vertices)}, the number of edges, found '
                             f'{self.curved_edge}')
        if not self.outline(vertices).leaves_edges:
            raise SceneError(f'edges.corner_radius_m {self.corner_radius_m:g} leaves nothing of an edge; take less')

    def outline(self, vertices: NDArray[np.float64]) -> BentOutline:
        """Return the outline of a polygon (n, 2) [m] with the curved edge and the rounded corners."""
        curvature = np.where(np.arange(len(vertices)) == self.curved_edge, self.curvature_1_m, 0.0)
        return BentOutline(vertices, curvature, self.corner_radius_m)


def delays(
    edges: Edges, generator: np.random.Generator, vertices: NDArray[np.float64], found: list[Way],
) -> NDArray[np.float64]:
    """Return by how much the phases of paths (m,) are delayed in all [rad].

    Parameters
    ----------
    edges : Edges
        What a reflection does.
    generator : numpy.random.Generator
        Draws each edge's own delay; the same for every ping of a scene.
    vertices : ndarray, shape (n, 2)
        The polygon, counter-clockwise [m].
    found : list of Way
        The paths.
    """
    theta = polygon_lines(vertices)[:, 1]
    normals = np.column_stack((np.cos(theta), np.sin(theta)))
    own = np.deg2rad(edges.delay_deg + edges.spread_deg * generator.uniform(-1.0, 1.0, len(vertices)))
    total = np.zeros(len(found))
    for m, way in enumerate(found):
        total[m] = own[way.walls].sum()
        if edges.kind == 'free':
            before, after = way.legs[:-1], way.legs[1:]  # in a corner one of them is nothing
            legs = np.where(np.hypot(*before.T)[:, None] > np.hypot(*after.T)[:, None], before, after)
            cosines = np.abs(np.einsum('ij,ij->i', legs, normals[way.walls])) / np.hypot(*legs.T)
            total[m] += free_edge_delay(cosines, edges.poisson).sum()
    return total
