"""polygon.csv, polygon.geojson and polygon.dxf: the answer for spreadsheets, maps and drawings."""

import csv
import importlib
import io
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import UsageError, in_words
from polymap_ros.geometry.plane import XY, Plane
from polymap_ros.results.dimensions import dimensions, net_area
from polymap_ros.results.polygon_json import encode, plane_axes
from polymap_ros.solvers.estimate import Candidate, Estimate, InnerWall

OUTLINE, LABELS = 'POLYMAP_OUTLINE', 'POLYMAP_LABELS'
HOLES, INNER_WALLS = 'POLYMAP_HOLES', 'POLYMAP_INNER_WALLS'
"""Layers of the drawing."""

_COLUMNS = ('edge', 'x1_m', 'y1_m', 'x2_m', 'y2_m', 'length_m', 'length_std_m', 'angle_deg', 'angle_std_deg', 'r_m',
            'r_std_m', 'theta_deg', 'theta_std_deg', 'likelihood', 'pings', 'part', 'reflection', 'transmission')
_LABEL_HEIGHT = 0.025
"""Of the drawing's extent."""


def require_ezdxf() -> None:
    """Raise `UsageError` where drawings cannot be written."""
    try:
        importlib.import_module('ezdxf')
    except ModuleNotFoundError:
        raise UsageError("--export dxf needs ezdxf: pip install 'polymap_ros[export]'") from None
    except Exception as error:  # a configuration that it refuses
        raise UsageError(f'--export dxf needs ezdxf, which cannot be started: {in_words(error)}') from error


def is_exported(kind: str, estimate: Estimate) -> bool:
    """Return whether there is something to write in a format."""
    return estimate.status == 'closed' or (kind == 'csv' and bool(estimate.walls))


def exported(kind: str, estimate: Estimate, frame_id: str, plane: Plane = XY) -> bytes | None:
    """The content of ``polygon.<kind>``; None where there is nothing to export.

    Parameters
    ----------
    kind : str
        ``csv``, ``geojson`` or ``dxf``.
    estimate : Estimate
        In the odometry's frame. Only csv has something to say where no polygon closes: the walls that are certain.
    frame_id : str
        Name of that frame.
    plane : Plane
        Coordinates are those of this plane.
    """
    if not is_exported(kind, estimate):
        return None
    polygon = estimate.polygon if estimate.status == 'closed' else None
    if kind == 'csv' or polygon is None:
        return _csv(estimate, polygon)
    return _geojson(polygon, estimate, frame_id, plane) if kind == 'geojson' else _dxf(polygon, estimate)


def _csv(estimate: Estimate, polygon: Candidate | None) -> bytes:
    """A row per edge of each ring and per inner wall; or per wall, whose ends are not known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(_COLUMNS)
    for part, number, ends, edge, *coefficients in _parts(estimate, polygon):
        line = [edge.r, edge.r_std, np.rad2deg(edge.theta),
                None if edge.theta_std is None else np.rad2deg(edge.theta_std), edge.likelihood]
        writer.writerow([number, *map(_cell, [*ends, *line]), edge.pings, part, *map(_cell, coefficients)])
    return text.getvalue().encode()


def _parts(estimate: Estimate, polygon: Candidate | None) -> Iterator[tuple[Any, ...]]:
    """Part, number within it, ends and sizes, line, reflection and transmission of each row."""
    if polygon is None:
        yield from (('wall', i, [None] * 8, edge, None, None) for i, edge in enumerate(estimate.walls))
        return
    for part, ring in (('outline', polygon), *((f'hole {k}', hole) for k, hole in enumerate(estimate.holes))):
        for i, (edge, ends) in enumerate(zip(ring.edges, _ends(ring), strict=True)):
            yield part, i, ends, edge, None, None
    for i, wall in enumerate(estimate.inner_walls):
        ends = [*wall.start, *wall.end, float(np.linalg.norm(wall.end - wall.start)), *[None] * 3]
        yield 'inner wall', i, ends, wall.edge, wall.reflection, wall.transmission


def _ends(polygon: Candidate) -> Iterator[list[float | None]]:
    """Both corners, length and angle of every edge, the latter two with their deviations."""
    sizes = dimensions(polygon)
    for i, corner in enumerate(polygon.vertices):
        yield [*corner, *polygon.vertices[(i + 1) % len(polygon.vertices)], sizes.lengths_m[i], sizes.length_stds_m[i],
               np.rad2deg(sizes.angles_rad[i]), np.rad2deg(sizes.angle_stds_rad[i])]


def _cell(value: float | None) -> str:
    return '' if value is None or not np.isfinite(value) else f'{round(float(value), 9) + 0.0:.16g}'


def _geojson(polygon: Candidate, estimate: Estimate, frame_id: str, plane: Plane) -> bytes:
    """A Feature whose coordinates are metres in the odometry's frame, and say so: RFC 7946 expects WGS 84.

    With inner walls it is the first of a FeatureCollection, in which each of them is a line.
    """
    area_m2, area_std_m2 = net_area(polygon, estimate.holes)
    common = {
        'frame_id': frame_id, 'coordinates': f'metres in {plane.named(frame_id)}, not WGS 84',
        **({} if plane.is_xy else {'plane': plane_axes(plane)}),
        'method': estimate.method, 'stamp_ns': int(estimate.stamp_ns)}
    place = _feature('Polygon', [_places((*ring.vertices, ring.vertices[0])) for ring in (polygon, *estimate.holes)], {
        **common, 'area_m2': area_m2, 'area_std_m2': _known(area_std_m2), **_sizes(polygon),
        **({'holes': [_sizes(hole) for hole in estimate.holes]} if estimate.holes else {})})
    if not estimate.inner_walls:
        return encode(place)
    walls = [_feature('LineString', _places(wall.ends), {**common, 'inner_wall': k, **_coefficients(wall)})
             for k, wall in enumerate(estimate.inner_walls)]
    return encode({'type': 'FeatureCollection', 'features': [place, *walls]})


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {'type': 'Feature', 'geometry': {'type': kind, 'coordinates': coordinates}, 'properties': properties}


def _places(points: Iterable[NDArray[np.float64]]) -> list[list[float]]:
    return [[float(x), float(y)] for x, y in points]


def _sizes(ring: Candidate) -> dict[str, Any]:
    sizes = dimensions(ring)
    return {
        'lengths_m': sizes.lengths_m.tolist(), 'length_stds_m': [*map(_known, sizes.length_stds_m)],
        'angles_deg': np.rad2deg(sizes.angles_rad).tolist(),
        'angle_stds_deg': [*map(_known, np.rad2deg(sizes.angle_stds_rad))],
        'likelihoods': [float(edge.likelihood) for edge in ring.edges]}


def _coefficients(wall: InnerWall) -> dict[str, Any]:
    return {'reflection': float(wall.reflection), 'transmission': float(wall.transmission),
            'likelihood': float(wall.edge.likelihood)}


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _dxf(polygon: Candidate, estimate: Estimate) -> bytes:
    """A closed polyline in metres for each ring, the length of every edge beside it, and a line for each inner wall."""
    import ezdxf

    # Without this every file has a date and an identity of its own, and the same answer not the same bytes.
    dated, ezdxf.options.write_fixed_meta_data_for_testing = ezdxf.options.write_fixed_meta_data_for_testing, True
    try:
        drawing = ezdxf.new('R2010', units=ezdxf.units.M)
        drawing.layers.add(OUTLINE)
        drawing.layers.add(LABELS, color=8)
        space = drawing.modelspace()
        height = _LABEL_HEIGHT * float(np.ptp(polygon.vertices, axis=0).max())
        for layer, ring in ((OUTLINE, polygon), *((HOLES, hole) for hole in estimate.holes)):
            space.add_lwpolyline(_places(ring.vertices), close=True, dxfattribs={'layer': layer})
            _label_lengths(space, ring, height)
        for wall in estimate.inner_walls:
            space.add_line(*_places(wall.ends), dxfattribs={'layer': INNER_WALLS})
        for layer, used in ((HOLES, estimate.holes), (INNER_WALLS, estimate.inner_walls)):
            if used:
                drawing.layers.add(layer)
        drawing.set_modelspace_vport(60.0 * height, center=np.mean(polygon.vertices, axis=0).tolist())
        text = io.StringIO()
        drawing.write(text)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = dated
    return text.getvalue().encode()


def _label_lengths(space: Any, ring: Candidate, height: float) -> None:
    """The length of every edge within the material, along the edge."""
    from ezdxf.enums import TextEntityAlignment

    corners = np.asarray(ring.vertices, dtype=float)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        place = 0.5 * (start + end) + height * np.array([-along[1], along[0]])
        degrees = float(np.rad2deg(np.arctan2(along[1], along[0])))
        upright = degrees if -90.0 < degrees <= 90.0 else degrees + 180.0
        space.add_text(f'{np.linalg.norm(end - start):.4f} m', height=height, rotation=upright, dxfattribs={
            'layer': LABELS}).set_placement(place.tolist(), align=TextEntityAlignment.MIDDLE_CENTER)
