"""polygon.json: the answer, what it rests on, and the parameters that led to it."""

import json
import math
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

from polymap_ros import __version__
from polymap_ros.cautions import Caution
from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.plane import XY, Plane
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.storey import Storey
from polymap_ros.hearing.ping_queue import PingCounts
from polymap_ros.parameters import Parameters, specifications
from polymap_ros.results.dimensions import dimensions, net_area
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall, Trajectory
from polymap_ros.specification import Value

FORMAT = 'polymap/1'
_FILE_PARAMETERS = {spec.name for spec in specifications() if spec.is_path}


def polygon_document(
    estimate: Estimate, frame_id: str, counts: PingCounts, parameters: Parameters, cautions: Sequence[Caution] = (),
    plane: Plane = XY, recording: str | None = None, lost: int | None = None, map_to_odom: Pose | None = None,
) -> dict[str, Any]:
    """The content of polygon.json.

    Parameters
    ----------
    estimate : Estimate
        In the map frame.
    frame_id : str
        Name of that frame.
    counts : PingCounts
        What became of the pings.
    parameters : Parameters
        Those in force; of file names only the last part is kept, so that the place of work does not show.
    cautions : sequence of Caution
        Further warnings beside the estimate's own, such as a recording's.
    plane : Plane
        Coordinates of the estimate are those of this plane; what is not the frame's own xy plane is written down.
    recording : str, optional
        Name of the recording that was replayed; none in the node.
    lost : int, optional
        Pings that fit no place; by default of those whose echoes are kept.
    map_to_odom : Pose, optional
        Pose of the odometry's frame in the map frame; by default what corrects it at the last ping.
    """
    closed = estimate.polygon if estimate.status == 'closed' else None
    return {
        'format': FORMAT, 'recording': recording and recording.encode('utf-8', 'backslashreplace').decode(),
        'status': estimate.status, 'frame_id': frame_id,
        **({} if plane.is_xy else {'plane': plane_axes(plane)}), 'stamp_ns': int(estimate.stamp_ns),
        'method': estimate.method,
        **(_candidate(closed, estimate.holes) if closed else
           {'vertices': [], 'edges': [], 'area': None, 'area_std': None}),
        **(_interior(estimate) if closed else {}), **_corners(estimate),
        **_height(estimate.storey), 'walls': [_edge(edge) for edge in estimate.walls],
        'alternatives': [_candidate(candidate) for candidate in estimate.alternatives],
        'cost': _number(estimate.cost), 'iou_free_area': _number(estimate.iou_free_area),
        'pings': {
            'received': int(counts.received), 'used': int(counts.used),
            'dropped': {reason: int(number) for reason, number in sorted(counts.dropped.items())},
        },
        'trajectory': _trajectory(estimate.trajectory, int(counts.used), lost, map_to_odom),
        'warnings': [{'code': each.code, 'text': each.text} for each in (*estimate.cautions, *cautions)],
        'parameters': {name: _shown(name, value) for name, value in parameters.flat().items()},
        'software': {'polymap_ros': __version__},
    }


def _interior(estimate: Estimate) -> dict[str, Any]:
    """Holes and inner walls, where there are any."""
    found = {'holes': [_candidate(hole) for hole in estimate.holes],
             'inner_walls': [_inner_wall(wall) for wall in estimate.inner_walls]}
    return {name: each for name, each in found.items() if each}


def _corners(estimate: Estimate) -> dict[str, Any]:
    """By how much corners are rounded, where they are."""
    if not estimate.corner_radius:
        return {}
    return {'corner_radius': _number(estimate.corner_radius), 'corner_radius_std': _number(estimate.corner_radius_std)}


def _height(storey: Storey) -> dict[str, Any]:
    """Floor and ceiling, where there are any."""
    told = {f'{name}_{what}': _number(value) for name, height, reflection in storey.planes
            for what, value in (('m', height), ('reflection', reflection))}
    return {'height': told} if told else {}


def _trajectory(
    path: Trajectory | None, used: int, lost: int | None, map_to_odom: Pose | None
) -> dict[str, Any]:
    """How many pings have a place, how well the worst fits there, and what corrects the odometry at the last."""
    off = map_to_odom or (path.map_to_odom if path else Pose(0.0, 0.0))
    correction = [_number(off.x), _number(off.y), _number(float(wrapped(off.yaw)))]
    if path is None:
        return {'pings': used, 'localised': used, 'lost': 0, 'consistency_min': None, 'map_to_odom': correction,
                'corrected': False}
    lost, placed = int(path.lost.sum()) if lost is None else lost, path.consistency[~path.lost]
    return {'pings': used, 'localised': used - lost, 'lost': lost,
            'consistency_min': _number(float(placed.min())) if placed.size else None, 'map_to_odom': correction,
            'corrected': True}


def plane_axes(plane: Plane) -> dict[str, Any]:
    """Origin and axes of a plane in the odometry's frame."""
    x_axis, y_axis, _ = plane.axes
    rows = {'origin': plane.frame.position, 'x_axis': x_axis, 'y_axis': y_axis}
    return {name: [_number(value) for value in row] for name, row in rows.items()}


def encode(document: dict[str, Any]) -> bytes:
    """Standard JSON with a vertex, an edge or a parameter a line; the same document gives the same bytes."""
    return f'{_lines(document, depth=2)}\n'.encode()


def _lines(value: Any, depth: int, indent: str = '') -> str:
    if depth == 0 or not value or not isinstance(value, (dict, list)) or not _is_nested(value, depth):
        return json.dumps(value, allow_nan=False)
    inner = indent + ' '
    if isinstance(value, dict):
        items = [f'{json.dumps(key)}: {_lines(item, depth - 1, inner)}' for key, item in value.items()]
        opening, closing = '{', '}'
    else:
        items = [_lines(item, depth - 1, inner) for item in value]
        opening, closing = '[', ']'
    return f'{opening}\n{inner}' + f',\n{inner}'.join(items) + f'\n{indent}{closing}'


def _is_nested(value: dict[str, Any] | list[Any], depth: int) -> bool:
    """Whether a value is worth a line per item: the document, lists of things, long mappings."""
    if isinstance(value, list):
        return isinstance(value[0], (dict, list))
    return depth == 2 or len(value) > 6


def _candidate(candidate: Candidate, holes: Sequence[Candidate] = ()) -> dict[str, Any]:
    """A ring; its area is without the holes in it."""
    measured, (area_m2, area_std_m2) = zip(*dimensions(candidate)[:4], strict=True), net_area(candidate, holes)
    return {
        'vertices': [[_number(x), _number(y)] for x, y in candidate.vertices],
        'edges': [_edge(edge, each) for edge, each in zip(candidate.edges, measured, strict=True)],
        'area': _number(area_m2), 'area_std': _number(area_std_m2),
    }


def _edge(edge: Edge, measured: Sequence[float | None] = (None,) * 4) -> dict[str, Any]:
    """An edge, or a wall whose ends are not known."""
    return {
        **_line(edge), **dict(zip(('length', 'length_std', 'angle', 'angle_std'), map(_number, measured), strict=True))}


def _inner_wall(wall: InnerWall) -> dict[str, Any]:
    return {
        **{name: [_number(value) for value in place] for name, place in (('start', wall.start), ('end', wall.end))},
        'reflection': _number(wall.reflection), 'transmission': _number(wall.transmission), **_line(wall.edge)}


def _line(edge: Edge) -> dict[str, Any]:
    return {
        'r': _number(edge.r), 'theta': _number(edge.theta), 'likelihood': _number(edge.likelihood),
        'r_std': _number(edge.r_std), 'theta_std': _number(edge.theta_std), 'pings': int(edge.pings),
        **({'curvature': _number(edge.curvature), 'curvature_std': _number(edge.curvature_std)}
           if edge.curvature else {})}


def _number(value: float | None) -> float | None:
    return float(value) + 0.0 if value is not None and math.isfinite(value) else None  # + 0.0: no -0.0


def _shown(name: str, value: Value) -> Value:
    return PurePath(str(value)).name if name in _FILE_PARAMETERS else value
