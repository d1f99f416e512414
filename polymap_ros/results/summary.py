"""What a command says about its answer on stdout."""

from collections.abc import Mapping, Sequence

import numpy as np

from polymap_ros.cautions import Caution
from polymap_ros.geometry.alignment import PathError
from polymap_ros.geometry.inside_error import InsideComparison
from polymap_ros.geometry.polygon_error import Comparison
from polymap_ros.hearing.ping_queue import PingCounts
from polymap_ros.results.dimensions import dimensions, net_area, seen_from_afar
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall

_NARROWEST = 7
"""Characters of a column, so that small rooms have tables alike."""

_DEGREES = float(np.rad2deg(1.0))


def summary(
    estimate: Estimate, frame_id: str, counts: PingCounts, cautions: Sequence[Caution] = (),
    comparison: Comparison | None = None, path_error: PathError | None = None,
    inside: InsideComparison | None = None,
) -> str:
    """The answer in words and tables.

    Parameters
    ----------
    estimate : Estimate
        In the map frame.
    frame_id : str
        Name of that frame.
    counts : PingCounts
        What became of the pings.
    cautions : sequence of Caution
        Warnings to be told here.
    comparison : Comparison, optional
        With the ground truth, aligned where there is a true path.
    path_error : PathError, optional
        Of the path.
    inside : InsideComparison, optional
        With the true holes and inner walls.
    """
    lines = [_headline(estimate)]
    if estimate.polygon is not None:
        lines += _polygon_lines(estimate.polygon, frame_id, estimate.holes)
        lines += _interior_lines(estimate)
    for number, candidate in enumerate(estimate.alternatives, start=1):
        lines += [f'candidate {number}', *_polygon_lines(candidate, frame_id)]
    if estimate.walls:
        lines += ['certain walls', *_edge_table(estimate.walls)]
    lines += [f'{name} {height:.4f} m from the device, reflects {reflection:.2f}'
              for name, height, reflection in estimate.storey.planes]
    lines.append(f'pings: {counts.received} received, {counts.used} used{_dropped(counts.dropped)}')
    if estimate.iou_free_area is not None:
        lines.append(f'IoU with the free area: {estimate.iou_free_area:.4f}')
    if comparison is not None:
        lines += _comparison_lines(comparison)
    if inside is not None:
        lines += _inside_lines(inside)
    if path_error is not None:
        lines.append(f'  path, after the best rigid motion: ATE {1e3 * path_error.ate_m:.3f} mm, worst ping '
                     f'{1e3 * path_error.worst_m:.3f} mm, heading {np.rad2deg(path_error.heading_rad):.3f} deg rms')
    lines += [f'warning ({each.code}): {each.text}' for each in cautions]
    return '\n'.join(lines)


def _headline(estimate: Estimate) -> str:
    answer = {
        'closed': estimate.shape_in_words,
        'ambiguous': f'{len(estimate.alternatives)} polygons fit',
        'open': 'no polygon closes',
    }[estimate.status]
    cost = '' if estimate.cost is None else f', cost {estimate.cost:.4g}'
    return f'{estimate.status}: {answer} (method {estimate.method}{cost})'


def _polygon_lines(polygon: Candidate, frame_id: str, holes: Sequence[Candidate] = ()) -> list[str]:
    """A row per edge with the corner it starts from, the lines the edges lie on, and the area without the holes."""
    extent_m = max(np.ptp(polygon.vertices, axis=0))
    shown = frame_id if frame_id.isprintable() else repr(frame_id)
    without = {0: '', 1: ' without the hole'}.get(len(holes), f' without the {len(holes)} holes')
    return [
        *_ring_lines(polygon), *_far_away(polygon),
        f'area {_area(*net_area(polygon, holes))}{without}, extent {extent_m:.4g} m, corners counter-clockwise in '
        f'{shown or "the odometry frame"}',
    ]


def _interior_lines(estimate: Estimate) -> list[str]:
    """Each hole as an outline; of inner walls the ends, which are vague, and what they do to an echo."""
    lines = []
    for number, hole in enumerate(estimate.holes):
        lines += [f'hole {number}', *_ring_lines(hole),
                  f'area {_area(*net_area(hole, ()))}, corners clockwise, angles within the material']
    walls = estimate.inner_walls
    return [*lines, 'inner walls', *_inner_table(walls), *_edge_table([wall.edge for wall in walls], 'wall')
            ] if walls else lines


def _inner_table(walls: Sequence[InnerWall]) -> list[str]:
    rows = [(str(i), *map(_fixed, (*wall.start, *wall.end)), _fixed(wall.reflection, 3), _fixed(wall.transmission, 3))
            for i, wall in enumerate(walls)]
    return _table(('wall', 'x1 [m]', 'y1 [m]', 'x2 [m]', 'y2 [m]', 'reflects', 'lets through'), rows)


def _area(area_m2: float, area_std_m2: float) -> str:
    return f'{area_m2:.6g} m2' + (f' +- {1e4 * area_std_m2:.2g} cm2' if np.isfinite(area_std_m2) else '')


def _ring_lines(polygon: Candidate) -> list[str]:
    sizes = dimensions(polygon)
    columns = zip(polygon.vertices, sizes.lengths_m, sizes.length_stds_m, sizes.angles_rad, sizes.angle_stds_rad,
                  strict=True)
    rows = [
        (str(i), _fixed(x), _fixed(y), f'{length:.5f}', _deviation(length_std, 1e3), f'{np.rad2deg(angle):.3f}',
         _deviation(angle_std, _DEGREES))
        for i, ((x, y), length, length_std, angle, angle_std) in enumerate(columns)
    ]
    return [*_table(('edge', 'x [m]', 'y [m]', 'length [m]', '+- [mm]', 'corner [deg]', '+- [deg]'), rows),
            *_edge_table(polygon.edges)]


def _far_away(polygon: Candidate) -> list[str]:
    """Say what r and its deviation are about where the origin is so far that they tell little of the wall."""
    distance_m, spread_m = seen_from_afar(polygon)
    if not distance_m:
        return []
    good = f'; at their middles the edges are good to {1e3 * spread_m:.2g} mm' if np.isfinite(spread_m) else ''
    return [f"r and its deviation are about the frame's origin, {distance_m:.0f} m away{good}"]


def _edge_table(edges: Sequence[Edge], name: str = 'edge') -> list[str]:
    return _table((name, 'r [m]', '+- [mm]', 'theta [deg]', '+- [deg]', 'likelihood', 'pings'),
                  [(str(i), *_edge_cells(edge)) for i, edge in enumerate(edges)])


def _edge_cells(edge: Edge) -> tuple[str, ...]:
    return (_fixed(edge.r), _deviation(edge.r_std, 1e3), _fixed(np.rad2deg(edge.theta), 3),
            _deviation(edge.theta_std, _DEGREES), f'{edge.likelihood:.3f}', str(edge.pings))


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Columns to the right, two spaces apart, that numbers of any size do not run out of."""
    lines = [heads, *rows]
    widths = [max(_NARROWEST, *(len(line[k]) for line in lines)) for k in range(len(heads))]
    widths[0] = max(len(line[0]) for line in lines)
    return ['  ' + '  '.join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in lines]


def _fixed(value: float, digits: int = 5) -> str:
    """A number without the sign of a zero."""
    return f'{round(float(value), digits) + 0.0:.{digits}f}'


def _deviation(value: float | None, factor: float) -> str:
    return '-' if value is None or not np.isfinite(value) else f'{factor * value:.3f}'


def _dropped(dropped: Mapping[str, int]) -> str:
    parts = [f'{number} {reason}' for reason, number in sorted(dropped.items()) if number]
    return f', dropped: {", ".join(parts)}' if parts else ''


def _comparison_lines(found: Comparison) -> list[str]:
    verdict = 'right' if found.right else 'not right'
    lines = [f'against the truth: {found.n_estimated} edges of {found.n_true}, {verdict}; IoU {found.iou:.4f}']
    offsets_mm = 1e3 * np.abs([offset for offset in found.offsets_m if np.isfinite(offset)])
    angles_deg = np.rad2deg(np.abs([angle for angle in found.angles_rad if np.isfinite(angle)]))
    if offsets_mm.size:
        lines.append(f'  wall offset: median {np.median(offsets_mm):.3g} mm, largest {offsets_mm.max():.3g} mm')
        lines.append(f'  wall angle: median {np.median(angles_deg):.3g} deg, largest {angles_deg.max():.3g} deg')
    return lines


def _inside_lines(inside: InsideComparison) -> list[str]:
    """Holes and inner walls, where there are any or some were found."""
    counts = (('holes', inside.n_holes, inside.right_holes, inside.n_true_holes),
              ('inner walls', inside.n_inner_walls, inside.right_inner_walls, inside.n_true_inner_walls))
    return [f'  {name}: {found} found, {right} of {of} right' for name, found, right, of in counts if found or of]
