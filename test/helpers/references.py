"""What the package is compared with: areas by shapely, half-planes clipped one by one, images unfolded one by one."""

import dataclasses
import itertools

import numpy as np
import shapely

from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.outline import half_plane_polygon

FAR = 1e4
"""Half the side of the square that stands for the whole plane, in units of the farthest line."""


def _clipped_plane(lines):
    """Vertices of an intersection of half-planes: a huge square clipped by one after the other."""
    polygon = FAR * np.abs(lines[:, 0]).max() * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    for r, theta in lines:
        depth = r - polygon @ (np.cos(theta), np.sin(theta))
        kept = []
        for i in range(len(polygon)):
            if depth[i - 1] * depth[i] < 0.0:
                share = depth[i - 1] / (depth[i - 1] - depth[i])
                kept.append(polygon[i - 1] + share * (polygon[i] - polygon[i - 1]))
            if depth[i] >= 0.0:
                kept.append(polygon[i])
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def bounded_area(lines):
    """The intersection of half-planes as a shapely polygon, empty where it is unbounded."""
    angles = np.sort(np.mod(lines[:, 1], 2 * np.pi))
    if np.diff(angles, append=angles[0] + 2 * np.pi).max() > np.pi - 1e-9:
        return shapely.Polygon()
    polygon = _clipped_plane(lines)
    return shapely.Polygon(polygon) if len(polygon) > 2 else shapely.Polygon()


def shapely_iou(first, second):
    union = first.union(second).area
    return first.intersection(second).area / union if union else 0.0


def inside(vertices, count, seed=0, clearance=0.06):
    """Points inside a convex polygon, at least so far from its walls."""
    generator = np.random.default_rng(seed)
    lines = polygon_lines(vertices)
    normals = np.array((np.cos(lines[:, 1]), np.sin(lines[:, 1])))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    points = generator.uniform(low, high, size=(100 * count, 2))
    return points[np.all(points @ normals < lines[:, 0] - clearance, axis=1)][:count]


@dataclasses.dataclass(frozen=True)
class Path:
    """One sequence of walls, for many pings: half the length [m] and what the walls' ends leave, both (N,)."""

    walls: tuple[int, ...]
    half: np.ndarray
    weight: np.ndarray


def unfold(lines, emitters, order, soft, receivers=None, height=0.0):
    """All sequences of walls that some ping hears, each unfolded in the complex plane; ends are hard where soft is 0.

    Inside its end by s, a hit counts 1/2 + (3 x - x^3) / 4 with x = s / soft within -1 ... 1; a path, its least hit.
    The receiver is that much higher than the emitter; walls are upright.
    """
    vertices, which = half_plane_polygon(lines)
    corners = {int(wall): vertices[i] @ (1, 1j) for i, wall in enumerate(which)}
    along = {int(wall): vertices[(i + 1) % len(which)] @ (1, 1j) - corners[int(wall)] for i, wall in enumerate(which)}
    source = np.asarray(emitters) @ (1, 1j)
    target = source if receivers is None else np.asarray(receivers) @ (1, 1j)
    paths = []
    for count in range(1, order + 1):
        for walls in itertools.product(corners, repeat=count):
            if any(a == b for a, b in itertools.pairwise(walls)):
                continue
            images = [source]
            for wall in walls:
                images.append(corners[wall] + along[wall] * np.conj((images[-1] - corners[wall]) / along[wall]))
            here, inside = target, np.full(len(source), np.inf)
            for wall, image in zip(walls[::-1], images[:0:-1], strict=True):
                p, q = ((place - corners[wall]) / along[wall] for place in (here, image))
                crosses = (q.imag < 0.0) & (q.imag < p.imag)
                share = p.real + (q - p).real * p.imag / np.where(crosses, p.imag - q.imag, np.nan)
                here = corners[wall] + share * along[wall]
                inside = np.minimum(inside, abs(along[wall]) * np.minimum(share, 1.0 - share))
            inside = np.nan_to_num(inside, nan=-np.inf)
            x = np.clip(inside / soft, -1.0, 1.0) if soft else np.sign(inside)
            weight = 0.5 + (3.0 * x - x**3) / 4.0
            if np.any(weight > 0.0):
                paths.append(Path(walls, np.hypot(abs(images[-1] - target), height) / 2.0, weight))
    return paths


def away_from_ends(lines, positions, order, soft):
    """Which pings hear no path near the end of a wall."""
    weights = np.array([path.weight for path in unfold(lines, positions, order, soft)])
    return np.all((weights == 0.0) | (weights == 1.0), axis=0)
