"""The mapped room as visualization_msgs/msg/MarkerArray, for RViz and Foxglove."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.plane import XY, Plane
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.triangulation import triangles
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.outputs import Make, header, point_messages, pose_message
from polymap_ros.messages.shown import shown
from polymap_ros.solvers.estimate import Edge, Estimate

ADD, DELETE_ALL = 0, 3
LINE_STRIP, LINE_LIST, TEXT, TRIANGLE_LIST = 4, 5, 9, 11

MAX_PATH_POINTS = 1000
"""A longer path is thinned: a message is built point by point."""

Color = tuple[float, float, float, float]
OUTLINE: Color = (1.0, 1.0, 1.0, 1.0)
AREA: Color = (0.6, 0.8, 1.0, 0.15)
LINES: Color = (0.9, 0.3, 0.3, 0.6)
FREE_AREA: Color = (0.3, 0.7, 1.0, 0.8)
PATH: Color = (0.3, 0.9, 0.3, 1.0)
INNER_WALLS: Color = (1.0, 0.7, 0.2, 1.0)

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Drawing:
    """What the markers show, all in coordinates of the mapping plane.

    Parameters
    ----------
    frame_id : str
        The odometry's frame.
    estimate : Estimate or None
        Outline, holes and inner walls where it is closed; lines of the edges of outlines, or of certain walls.
    free_area : sequence of ndarray, shape (n, 2)
        Closed rings bounding the free area A_T [m].
    path : ndarray, shape (n, 2)
        Positions of the sensor [m].
    plane : Plane
        The mapping plane in `frame_id`.
    """

    frame_id: str
    estimate: Estimate | None
    free_area: Sequence[Points]
    path: Points
    plane: Plane = XY

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The lines to draw."""
        if self.estimate is None:
            return ()
        if self.estimate.polygon is not None:
            return self.estimate.polygon.edges
        return self.estimate.walls + tuple(edge for other in self.estimate.alternatives for edge in other.edges)

    @property
    def bounds(self) -> tuple[Points, Points]:
        """Lowest and highest corner of everything but the lines [m]; the unit square where there is nothing."""
        parts = [self.path, *self.free_area]
        if self.estimate is not None and self.estimate.polygon is not None:
            parts.append(self.estimate.polygon.vertices)
        points = np.concatenate([part for part in parts if len(part)] or [np.array([[0.0, 0.0], [1.0, 1.0]])])
        return points.min(axis=0), points.max(axis=0)


def drawing_of(mapper: PolygonMapper) -> Drawing:
    """What a mapper has to show now, moved from its start frame to the mapping plane's."""
    frame = shown(mapper)
    start = frame.of_map.compose(mapper.start_pose or Pose(0.0, 0.0))
    heard = mapper.surroundings
    path = heard.positions
    path = path[::max(1, -(-len(path) // MAX_PATH_POINTS))]
    boundary = heard.free_area.shape.boundary.simplify(0.5 * mapper.parameters.grid.range_step_m)
    rings = [np.asarray(ring.coords) for ring in getattr(boundary, 'geoms', [boundary]) if not ring.is_empty]
    estimate = mapper.estimate and mapper.estimate.moved(frame.of_map)
    return Drawing(frame.frame_id, estimate, [start.apply(ring) for ring in rings], start.apply(path),
                   mapper.plane or XY)


def delete_all_message(make: Make, frame_id: str) -> Any:
    """A MarkerArray that takes all markers away."""
    return make('visualization_msgs/msg/MarkerArray', markers=[_marker(make, frame_id, '', 0, action=DELETE_ALL)])


def marker_array_message(make: Make, drawing: Drawing) -> Any:
    """DELETEALL, then outline, holes, what is between them, inner walls, lines, free area, sensor path and a text.

    Their stamp is 0, for late joiners to place them.
    """
    low, high = drawing.bounds
    size = max(float(np.hypot(*(high - low))), 1e-6)
    shapes = [
        *_shapes_of(drawing.estimate),
        ('lines', LINE_LIST, _lines(drawing.edges, (low + high) / 2, size), LINES, 0.003),
        ('free_area', LINE_LIST, _together([_segments(ring) for ring in drawing.free_area]), FREE_AREA, 0.003),
        ('path', LINE_STRIP, drawing.path, PATH, 0.004),
    ]
    markers = [_marker(make, drawing.frame_id, '', 0, action=DELETE_ALL)]
    markers += [
        _marker(make, drawing.frame_id, name, kind, points=point_messages(make, points, drawing.plane), color=color,
                width=share * size)
        for name, kind, points, color, share in shapes if len(points) > 1
    ]
    markers.append(_marker(
        make, drawing.frame_id, 'text', TEXT, color=OUTLINE, width=0.03 * size, text=answer_line(drawing.estimate),
        pose=pose_message(make, Pose(float(low[0] + high[0]) / 2, float(high[1]) + 0.08 * size), drawing.plane),
    ))
    return make('visualization_msgs/msg/MarkerArray', markers=markers)


def _shapes_of(estimate: Estimate | None) -> list[tuple[str, int, Points, Color, float]]:
    """Namespace, kind, points, colour and share of the size of what a closed polygon is drawn by."""
    if estimate is None or estimate.polygon is None:
        return []
    outline, holes = estimate.polygon.vertices, [hole.vertices for hole in estimate.holes]
    return [
        ('outline', LINE_STRIP, _closed(outline), OUTLINE, 0.008),
        ('holes', LINE_LIST, _together([_segments(_closed(hole)) for hole in holes]), OUTLINE, 0.008),
        ('area', TRIANGLE_LIST, _together([outline, *holes])[triangles(outline, holes).ravel()], AREA, 0.0),
        ('inner_walls', LINE_LIST, _together([wall.ends for wall in estimate.inner_walls]),
         INNER_WALLS, 0.006),
    ]


def answer_line(estimate: Estimate | None) -> str:
    """One line about the answer, such as ``closed: 5 edges, cost 0.012, IoU with free area 0.953``."""
    if estimate is None:
        return 'waiting for echoes'
    parts = [estimate.shape_in_words] if estimate.polygon is not None else []
    parts += [f'certain walls: {len(estimate.walls)}'] if estimate.walls else []
    parts += [f'{len(estimate.alternatives)} polygons fit'] if estimate.alternatives else []
    parts += [f'cost {estimate.cost:.4g}'] if estimate.cost is not None else []
    parts += [f'IoU with free area {estimate.iou_free_area:.3f}'] if estimate.iou_free_area is not None else []
    return ': '.join(filter(None, [estimate.status, ', '.join(parts)]))


def _closed(ring: Points) -> Points:
    return np.concatenate((ring, ring[:1]))


def _together(parts: Sequence[Points]) -> Points:
    return np.concatenate([*parts, np.empty((0, 2))])


def _segments(ring: Points) -> Points:
    return np.stack([ring[:-1], ring[1:]], axis=1).reshape(-1, 2)


def _lines(edges: Sequence[Edge], centre: Points, length: float) -> Points:
    """Pairs of points on each line, to either side of the point nearest `centre`."""
    ends = []
    for edge in edges:
        normal = np.array([np.cos(edge.theta), np.sin(edge.theta)])
        middle = centre + (edge.r - normal @ centre) * normal
        along = 0.6 * length * np.array([-normal[1], normal[0]])
        ends += [middle - along, middle + along]
    return np.array(ends).reshape(-1, 2)


def _marker(
    make: Make, frame_id: str, namespace: str, kind: int, *, action: int = ADD, points: Sequence[Any] = (),
    color: Color = (0.0, 0.0, 0.0, 0.0), width: float = 0.0, text: str = '', pose: Any = None,
) -> Any:
    scale = {TEXT: {'x': 0.0, 'y': 0.0, 'z': width}, TRIANGLE_LIST: {'x': 1.0, 'y': 1.0, 'z': 1.0}}.get(
        kind, {'x': width, 'y': 0.0, 'z': 0.0})
    return make(
        'visualization_msgs/msg/Marker', header=header(make, 0, frame_id), ns=namespace, id=0, type=kind, action=action,
        pose=pose or pose_message(make, Pose(0.0, 0.0)), scale=make('geometry_msgs/msg/Vector3', **scale),
        color=make('std_msgs/msg/ColorRGBA', **dict(zip('rgba', color, strict=True))),
        lifetime=make('builtin_interfaces/msg/Duration', sec=0, nanosec=0), frame_locked=False,
        points=list(points), colors=[],
        texture_resource='', uv_coordinates=[], text=text, mesh_resource='', mesh_use_embedded_materials=False,
        texture=make('sensor_msgs/msg/CompressedImage', header=header(make, 0, ''), format='',
                     data=np.empty(0, np.uint8)),
        mesh_file=make('visualization_msgs/msg/MeshFile', filename='', data=np.empty(0, np.uint8)),
    )
