"""What a scene's edges do to what they reflect beside taking some of it: they turn its phase, they delay it.

Both are off by default: coefficients are real.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.plate_edge import free_edge_delay
from polymap_ros.geometry.lines import polygon_lines
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
