"""polygon.csv, polygon.geojson and polygon.dxf: the answer for spreadsheets, maps and drawings."""

import csv
import importlib
import io
from collections.abc import Iterator

import numpy as np

from polymap_ros.errors import UsageError, in_words
from polymap_ros.geometry.plane import XY, Plane
from polymap_ros.results.dimensions import dimensions
from polymap_ros.results.polygon_json import encode, plane_axes
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate

OUTLINE, LABELS = 'POLYMAP_OUTLINE', 'POLYMAP_LABELS'
"""Layers of the drawing."""

_COLUMNS = ('edge', 'x1_m', 'y1_m', 'x2_m', 'y2_m', 'length_m', 'length_std_m', 'angle_deg', 'angle_std_deg', 'r_m',
            'r_std_m', 'theta_deg', 'theta_std_deg', 'likelihood', 'pings')
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
        return _csv(polygon, estimate.walls)
    return _geojson(polygon, estimate, frame_id, plane) if kind == 'geojson' else _dxf(polygon)


def _csv(polygon: Candidate | None, walls: tuple[Edge, ...]) -> bytes:
    """A row per edge, or per wall, whose ends are not known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(_COLUMNS)
    edges = polygon.edges if polygon else walls
    unknown: list[float | None] = [None] * 8
    ends = list(_ends(polygon)) if polygon else [unknown] * len(walls)
    for i, (edge, cells) in enumerate(zip(edges, ends, strict=True)):
        line = [edge.r, edge.r_std, np.rad2deg(edge.theta),
                None if edge.theta_std is None else np.rad2deg(edge.theta_std), edge.likelihood]
        writer.writerow([i, *map(_cell, [*cells, *line]), edge.pings])
    return text.getvalue().encode()


def _ends(polygon: Candidate) -> Iterator[list[float | None]]:
    """Both corners, length and angle of every edge, the latter two with their deviations."""
    sizes = dimensions(polygon)
    for i, corner in enumerate(polygon.vertices):
        yield [*corner, *polygon.vertices[(i + 1) % len(polygon.vertices)], sizes.lengths_m[i], sizes.length_stds_m[i],
               np.rad2deg(sizes.angles_rad[i]), np.rad2deg(sizes.angle_stds_rad[i])]


def _cell(value: float | None) -> str:
    return '' if value is None or not np.isfinite(value) else f'{round(float(value), 9) + 0.0:.16g}'


def _geojson(polygon: Candidate, estimate: Estimate, frame_id: str, plane: Plane) -> bytes:
    """A Feature whose coordinates are metres in the odometry's frame, and say so: RFC 7946 expects WGS 84."""
    sizes = dimensions(polygon)
    ring = [[float(x), float(y)] for x, y in (*polygon.vertices, polygon.vertices[0])]
    feature = {
        'type': 'Feature',
        'geometry': {'type': 'Polygon', 'coordinates': [ring]},
        'properties': {
            'frame_id': frame_id, 'coordinates': f'metres in {plane.named(frame_id)}, not WGS 84',
            **({} if plane.is_xy else {'plane': plane_axes(plane)}),
            'method': estimate.method, 'stamp_ns': int(estimate.stamp_ns),
            'area_m2': sizes.area_m2, 'area_std_m2': _known(sizes.area_std_m2),
            'lengths_m': sizes.lengths_m.tolist(), 'length_stds_m': [*map(_known, sizes.length_stds_m)],
            'angles_deg': np.rad2deg(sizes.angles_rad).tolist(),
            'angle_stds_deg': [*map(_known, np.rad2deg(sizes.angle_stds_rad))],
            'likelihoods': [float(edge.likelihood) for edge in polygon.edges],
        },
    }
    return encode(feature)


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _dxf(polygon: Candidate) -> bytes:
    """A closed polyline in metres, and the length of every edge inside it, along the edge."""
    import ezdxf
    from ezdxf.enums import TextEntityAlignment

    # Without this every file has a date and an identity of its own, and the same answer not the same bytes.
    dated, ezdxf.options.write_fixed_meta_data_for_testing = ezdxf.options.write_fixed_meta_data_for_testing, True
    try:
        drawing = ezdxf.new('R2010', units=ezdxf.units.M)
        drawing.layers.add(OUTLINE)
        drawing.layers.add(LABELS, color=8)
        space = drawing.modelspace()
        corners = np.asarray(polygon.vertices, dtype=float)
        space.add_lwpolyline(corners.tolist(), close=True, dxfattribs={'layer': OUTLINE})
        height = _LABEL_HEIGHT * float(np.ptp(corners, axis=0).max())
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            along = (end - start) / np.linalg.norm(end - start)
            place = 0.5 * (start + end) + height * np.array([-along[1], along[0]])
            degrees = float(np.rad2deg(np.arctan2(along[1], along[0])))
            upright = degrees if -90.0 < degrees <= 90.0 else degrees + 180.0
            space.add_text(f'{np.linalg.norm(end - start):.4f} m', height=height, rotation=upright, dxfattribs={
                'layer': LABELS}).set_placement(place.tolist(), align=TextEntityAlignment.MIDDLE_CENTER)
        drawing.set_modelspace_vport(60.0 * height, center=corners.mean(axis=0).tolist())
        text = io.StringIO()
        drawing.write(text)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = dated
    return text.getvalue().encode()
