"""map.pgm and map.yaml, as the map server of Nav2 reads them in its trinary mode."""

import numpy as np
import yaml

from polymap_ros.results.occupancy import FREE, OCCUPIED, Occupancy

_OCCUPIED_PIXEL, _UNKNOWN_PIXEL, _FREE_PIXEL = 0, 205, 254
_OCCUPIED_ABOVE, _FREE_BELOW = 0.65, 0.196
"""The map server takes p = 1 - pixel / 255: 1 and 0.004 for ours, and 0.19608, which is not below 0.196."""


def pgm(grid: Occupancy) -> bytes:
    """The image, binary PGM; its first row is the largest y."""
    pixels = np.full(grid.cells.shape, _UNKNOWN_PIXEL, dtype=np.uint8)
    pixels[grid.cells == FREE] = _FREE_PIXEL
    pixels[grid.cells == OCCUPIED] = _OCCUPIED_PIXEL
    height, width = grid.cells.shape
    return f'P5\n{width} {height}\n255\n'.encode() + pixels[::-1].tobytes()


def map_yaml(grid: Occupancy, image: str = 'map.pgm') -> bytes:
    """The description of the image."""
    description = {
        'image': image, 'mode': 'trinary', 'resolution': grid.resolution_m, 'origin': [*grid.origin, 0.0],
        'negate': 0, 'occupied_thresh': _OCCUPIED_ABOVE, 'free_thresh': _FREE_BELOW,
    }
    return yaml.safe_dump(description, sort_keys=False, default_flow_style=None).encode()
