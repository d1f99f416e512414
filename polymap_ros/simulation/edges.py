"""What a scene's edges do to the phase of what they reflect, path by path."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.plate_edge import free_edge_delay
from polymap_ros.geometry.image_sources import Images
from polymap_ros.geometry.lines import polygon_lines

if TYPE_CHECKING:
    from polymap_ros.simulation.scenes import Scene


def delayed(scene: 'Scene', images: Images, receiver: NDArray[np.float64]) -> NDArray[np.complex128] | float:
    """Return the factors exp(-j delay) (m,) of a scene's paths to a receiver; 1 where its coefficients are real."""
    if scene.edge == 'real' and not np.any(scene.edge_delay_deg):
        return 1.0
    delay = np.zeros(len(images.order))
    theta = polygon_lines(scene.vertices)[:, 1]
    normals = np.column_stack((np.cos(theta), np.sin(theta)))
    constant = np.deg2rad(np.broadcast_to(np.asarray(scene.edge_delay_deg, float), len(normals)))
    for m, (walls, order) in enumerate(zip(images.walls, images.order, strict=True)):
        way = images.position_m[m] - receiver  # from the receiver back along the last leg
        way = way / np.hypot(*way)
        for wall in walls[:order][::-1]:
            cosine = abs(float(way @ normals[wall]))
            delay[m] += constant[wall]
            if scene.edge == 'free':
                delay[m] += free_edge_delay(np.array([cosine]), scene.edge_poisson)[0]
            way = way - 2.0 * (way @ normals[wall]) * normals[wall]
    return np.asarray(np.exp(-1j * delay))
