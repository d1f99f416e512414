"""What a command says about its answer on stdout."""

from collections.abc import Mapping, Sequence

import numpy as np

from polymap_ros.mapping.comparison import Comparison
from polymap_ros.mapping.estimate import Candidate, Caution, Edge, Estimate
from polymap_ros.mapping.ping_queue import PingCounts
from polymap_ros.results.dimensions import dimensions

_DEGREES = float(np.rad2deg(1.0))


def summary(
    estimate: Estimate, frame_id: str, counts: PingCounts, cautions: Sequence[Caution] = (),
    comparison: Comparison | None = None,
) -> str:
    """The answer in words and tables.

    Parameters
    ----------
    estimate : Estimate
        In the odometry's frame.
    frame_id : str
        Name of that frame.
    counts : PingCounts
        What became of the pings.
    cautions : sequence of Caution
        Warnings beside the estimate's own.
    comparison : Comparison, optional
        With the ground truth.
    """
    lines = [_headline(estimate)]
    if estimate.polygon is not None:
        lines += _polygon_lines(estimate.polygon, frame_id)
    for number, candidate in enumerate(estimate.alternatives, start=1):
        lines += [f'candidate {number}', *_polygon_lines(candidate, frame_id)]
    if estimate.walls:
        lines += ['certain walls', *_edge_table(estimate.walls)]
    lines.append(f'pings: {counts.received} received, {counts.used} used{_dropped(counts.dropped)}')
    if estimate.iou_free_area is not None:
        lines.append(f'IoU with the free area: {estimate.iou_free_area:.4f}')
    if comparison is not None:
        lines += _comparison_lines(comparison)
    lines += [f'warning ({each.code}): {each.text}' for each in (*estimate.cautions, *cautions)]
    return '\n'.join(lines)


def _headline(estimate: Estimate) -> str:
    answer = {
        'closed': f'{len(estimate.polygon.edges) if estimate.polygon else 0} edges',
        'ambiguous': f'{len(estimate.alternatives)} polygons fit',
        'open': 'no polygon closes',
    }[estimate.status]
    cost = '' if estimate.cost is None else f', cost {estimate.cost:.4g}'
    return f'{estimate.status}: {answer} (method {estimate.method}{cost})'


def _polygon_lines(polygon: Candidate, frame_id: str) -> list[str]:
    """A row per edge with the corner it starts from, the lines the edges lie on, and the area."""
    sizes = dimensions(polygon)
    columns = zip(polygon.vertices, sizes.lengths_m, sizes.length_stds_m, sizes.angles_rad, sizes.angle_stds_rad,
                  strict=True)
    rows = [
        f'{i:6d}{_fixed(x):>10}{_fixed(y):>10}{length:12.5f}{_deviation(length_std, 1e3):>9}'
        f'{np.rad2deg(angle):14.3f}{_deviation(angle_std, _DEGREES):>10}'
        for i, ((x, y), length, length_std, angle, angle_std) in enumerate(columns)
    ]
    extent_m = max(np.ptp(polygon.vertices, axis=0))
    shown = frame_id if frame_id.isprintable() else repr(frame_id)
    spread = f' +- {1e4 * sizes.area_std_m2:.2g} cm2' if np.isfinite(sizes.area_std_m2) else ''
    return [
        '  edge     x [m]     y [m]  length [m]  +- [mm]  corner [deg]  +- [deg]',
        *rows,
        *_edge_table(polygon.edges),
        f'area {sizes.area_m2:.6g} m2{spread}, extent {extent_m:.4g} m, corners counter-clockwise in '
        f'{shown or "the odometry frame"}',
    ]


def _edge_table(edges: Sequence[Edge]) -> list[str]:
    return [
        '  edge     r [m]  +- [mm]  theta [deg]  +- [deg]  likelihood  pings',
        *(f'{i:6d}{_edge_cells(edge)}' for i, edge in enumerate(edges)),
    ]


def _edge_cells(edge: Edge) -> str:
    r_std, theta_std = _deviation(edge.r_std, 1e3), _deviation(edge.theta_std, _DEGREES)
    theta_deg = _fixed(np.rad2deg(edge.theta), 3)
    return f'{_fixed(edge.r):>10}{r_std:>9}{theta_deg:>13}{theta_std:>10}{edge.likelihood:12.3f}{edge.pings:7d}'


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
