"""What a scene's edges do to the phase of what they reflect, path by path; off by default: coefficients are real."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.plate_edge import free_edge_delay
from polymap_ros.geometry.image_sources import Images
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.specification import Group, parameter

EDGES_STREAM = 9
"""Stream of a scene's random numbers that draws each edge's own delay."""


@dataclass(frozen=True)
class Edges(Group):
    """How edges turn the phase; what they leave of the amplitude is the scene's `reflection`."""

    PREFIX = 'edges.'
    kind: str = parameter('real', "real: not at all; free: by the angle of incidence, as a thin plate's free edge does",
                          choices=('real', 'free'))
    poisson: float = parameter(0.33, "Poisson's ratio of the plate (free)", minimum=0.0, maximum=0.5)
    delay_deg: float = parameter(0.0, 'by how much more every reflection delays the phase', unit='deg', minimum=-360.0,
                                 maximum=360.0)
    spread_deg: float = parameter(0.0, "half the range in which each edge's own delay beside that is drawn", unit='deg',
                                  minimum=0.0, maximum=180.0)


def delays(
    edges: Edges, generator: np.random.Generator, vertices: NDArray[np.float64], images: Images,
    receiver: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return by how much the paths (m,) of images to a receiver are delayed in all [rad].

    Parameters
    ----------
    edges : Edges
        What a reflection does.
    generator : numpy.random.Generator
        Draws each edge's own delay; the same for every ping of a scene.
    vertices : ndarray, shape (n, 2)
        The polygon, counter-clockwise [m].
    images : Images
        The paths.
    receiver : ndarray, shape (2,)
        Where they are heard [m].
    """
    theta = polygon_lines(vertices)[:, 1]
    normals = np.column_stack((np.cos(theta), np.sin(theta)))
    own = np.deg2rad(edges.delay_deg + edges.spread_deg * generator.uniform(-1.0, 1.0, len(vertices)))
    total = np.zeros(len(images.order))
    for m, (walls, order) in enumerate(zip(images.walls, images.order, strict=True)):
        way = images.position_m[m] - receiver  # from the receiver back along the last leg
        way = way / np.hypot(*way)
        for wall in walls[:order][::-1]:
            towards = float(way @ normals[wall])
            total[m] += own[wall]
            if edges.kind == 'free':
                total[m] += float(free_edge_delay(np.array(abs(towards)), edges.poisson))
            way = way - 2.0 * towards * normals[wall]
    return total
