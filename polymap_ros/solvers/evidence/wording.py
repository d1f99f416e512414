"""What the evidence solver says with its answer, in an operator's words: the likely cause, and the next thing to do."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import CAUTIONS, Caution, in_metres
from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.pulse_shape import PulseShape
from polymap_ros.hearing.sounding import Sounding

_HEARD = 0.5
"""Share of the pings with an echo that stands out below which distance or gain is the likelier cause."""

_SPAN = 4.0
"""Widths of the pulse that a path has to span: at less, two first echoes fit one line by chance in more than an eighth
of all cases (see `first_walls`)."""

_FEW_PINGS = 12
"""Fewer pings than this make hardly an edge certain in the plates of the tests."""

_TOLD_SLIPS = 3
"""Slips that are told one by one."""

_MUCH_BLANKED = 0.25
"""Share of the range that is listened to from which a blanking takes away walls, not only the ringing."""

_TOLD = 3.0
"""Deviations from which a number of the medium is told."""


def nothing_closes(
    walls: int, enclosing: bool, most: int, heard: Sequence[Sounding], pulse: PulseShape, straight: bool = False,
    untracked: bool = False,
) -> Caution:
    """Say why no polygon explains the echoes.

    Parameters
    ----------
    walls : int
        How many are certain.
    enclosing : bool
        Whether these bound an area.
    most : int
        `solver.max_edges`.
    heard : sequence of Sounding
        The pings whose echoes are kept.
    pulse : PulseShape
        That of the echoes.
    straight : bool
        Whether the path is too straight to tell walls from their mirror images.
    untracked : bool
        Whether poses beside the reported ones were tried, and none explain the echoes.
    """
    if not any(np.isfinite(sounding.rho) for sounding in heard):
        finding = f'none of {len(heard)} pings has an echo that stands out of its noise'
        cause, remedy = _cut_off(heard, pulse) or ('', '')
        return Caution('no_free_area', f'{finding}: {cause}' if cause else finding, remedy)
    count = {0: 'no wall is certain', 1: '1 wall is certain'}.get(walls, f'{walls} walls are certain')
    if walls > most:
        return Caution('not_closed', f'{count}, but solver.max_edges allows {most}', 'raise solver.max_edges')
    if enclosing:
        return Caution(
            'not_closed', f'{count} and enclose an area, but no outline explains the other echoes',
            'if no corner of the outline points inwards and nothing stands inside it, let polymap_replay --calibrate '
            'or --fit-odometry check medium and odometry')
    lack, remedy = _lack(walls, heard, pulse, straight, untracked)
    return Caution('not_closed', f'{count}{", too few to enclose an area" if walls else ""}: {lack}', remedy)


def _lack(
    walls: int, heard: Sequence[Sounding], pulse: PulseShape, straight: bool, untracked: bool
) -> tuple[str, str]:
    """What is most likely missing, and a remedy; without one that of the code."""
    with_echo = sum(1 for sounding in heard if np.isfinite(sounding.rho))
    extent_m = _extent_m(heard)
    if cut_off := _cut_off(heard, pulse):
        return cut_off
    if with_echo < _HEARD * len(heard):
        return (f'{with_echo} of {len(heard)} pings have an echo that stands out of their noise',
                'drive nearer to the walls, or ping louder; polymap_replay --plot-signals shows what was heard')
    if extent_m < _SPAN * pulse.width_m:
        return (f'the path spans {in_metres(extent_m)} only, where the pulse is {in_metres(pulse.width_m)} long',
                'drive further, along all walls')
    if len(heard) < _FEW_PINGS:
        return f'{len(heard)} pings tell little', 'go on pinging while the robot drives along all walls'
    if straight:
        return 'those beside a straight path look like their mirror images', CAUTIONS['straight_path'].remedy
    if untracked:
        return ('no outline explains the echoes, nor does a drift of the odometry as slam.noise_* assume it',
                'where the odometry slips or drifts by more, ping more often on the way, or raise slam.noise_*; where '
                'it is right, look for a corner that points inwards, and let --calibrate check the medium')
    if walls:
        return 'the others were not heard, or from too few places', ''
    return ('the echoes of different places do not fit together',
            'check odometry, medium and time zero: polymap_replay --fit-odometry, --calibrate and --fit-time-zero tell')


def _cut_off(heard: Sequence[Sounding], pulse: PulseShape) -> tuple[str, str] | None:
    """Say what keeps walls from being heard where that is the blanking, or the end of the range."""
    listened = np.flatnonzero(np.logical_or.reduce([sounding.echo != 0.0 for sounding in heard]))
    if not len(listened):
        return ('echo.blanking_m leaves nothing of the pings to listen to',
                'lower echo.blanking_m, or range_min of the pings, to where the ringing after the emission ends; or '
                'raise grid.range_max_m, where the pings are long enough')
    first_m, last_m = pulse.step_m * listened[0], pulse.step_m * listened[-1]
    if last_m < _extent_m(heard):
        return (f'nothing beyond {in_metres(last_m)} is listened to, and the path alone spans '
                f'{in_metres(_extent_m(heard))}',
                'raise grid.range_max_m, or range_max of the pings; where the pings are shorter, record longer ones')
    if first_m > _MUCH_BLANKED * last_m:
        return (f'only what is {in_metres(first_m)} to {in_metres(last_m)} away is listened to, beyond the blanking',
                'lower echo.blanking_m, or range_min of the pings, to where the ringing after the emission ends')
    return None


def far_apart(apart_m: float, reach_m: float) -> Caution:
    """Say that pings are too far apart for what they hear [m], as where the odometry is in centimetres."""
    return Caution('pings_far_apart', f'by the odometry it is {in_metres(apart_m)} (median) from a ping to the nearest '
                                      f'other one, and no further than {in_metres(reach_m)} is listened')


def _extent_m(heard: Sequence[Sounding]) -> float:
    """Extent of the path along x or y, whichever is larger [m]."""
    return float(max(np.ptp([(sounding.x, sounding.y) for sounding in heard], axis=0)))


def edges_unheard(unheard: int, edges: int) -> Caution:
    """Say that edges of the best polygon were not heard."""
    return Caution('not_closed', f'{unheard} of the {edges} edges that would close the polygon '
                                 f'{"was" if unheard == 1 else "were"} not heard')


def edges_unlikely(unlikely: int, edges: int) -> Caution:
    """Say that edges of a polygon that leaves much unexplained are hardly walls."""
    return Caution('not_closed', f'{unlikely} of the {edges} edges that would close the polygon '
                                 f'{"is hardly a wall" if unlikely == 1 else "are hardly walls"}')


def corner_cut_off() -> Caution:
    """Say that something is where a corner would be."""
    return Caution(
        'not_closed', 'echoes are missing that a corner of the polygon would give: an unheard wall cuts it off',
        'drive into the corners, and past the wall that is missing')


def corner_too_far(distance_m: float) -> Caution:
    """Say that the best polygon reaches further than can be heard."""
    return Caution(
        'not_closed', f'the walls would meet {in_metres(distance_m)} away from every ping, beyond what can be heard',
        'drive nearer to the far end; or raise grid.range_max_m, where the pings are long enough')


def weak_edges(weak: Sequence[str]) -> Caution:
    """Say which edges, by their names in pictures and reports, are not certain."""
    which = f'edge {weak[0]} is' if len(weak) == 1 else f'edges {", ".join(weak)} are'
    return Caution('weak_edge', f'{which} likely, but not certain')


def corners_unheard(depths_m: Mapping[int, float]) -> Caution:
    """Say at which corners, and how much of them, an edge may be missing."""
    where = ', '.join(f'{corner} (up to {in_metres(depth)} of it)' for corner, depth in sorted(depths_m.items()))
    return Caution('unheard_corner', f'no echo has been near corner {where}: a wall that cuts it off would not have '
                                     'been heard')


def not_convex(explained: float, edges: int, holes: int = 0) -> Caution:
    """Say that an outline that is not convex, or has holes, explains more than a convex one, and not enough to be sure.
    """
    what = f'with {holes} hole{"s" if holes > 1 else ""}' if holes else 'that is not convex'
    return Caution('not_convex', f'an outline of {edges} edges {what} explains {explained:.0%} of the echoes, clearly '
                                 'more than a convex one')


def unexplained(share: float, edges: int, most: int) -> Caution:
    """Say how much of the echoes' power the polygon explains."""
    finding = f"the polygon explains {max(share, 0.0):.0%} of the echoes' power"
    if edges < most:
        return Caution('unexplained', finding)
    return Caution('unexplained', f'{finding} with all the edges that solver.max_edges allows ({most})',
                   'raise solver.max_edges')


def odometry_drift(away_m: float, away_rad: float, way_m: float) -> Caution:
    """Say how far the odometry is off at the end of a way."""
    return Caution('odometry_drift', f'the odometry is off by {1e3 * away_m:.1f} mm and {np.rad2deg(away_rad):.1f} deg '
                                     f'at the end of {way_m:.1f} m, by the echoes of the walls')


def odometry_scale(scale: float, deviation: float) -> Caution:
    """Say how much longer the odometry's ways are than those by the echoes."""
    longer = 'longer' if scale > 1.0 else 'shorter'
    too = 'small' if scale > 1.0 else 'large'
    return Caution('odometry_scale', f'the ways of the odometry are {100.0 * abs(scale - 1.0):.1f} +- '
                                     f'{100.0 * deviation:.1f} % {longer} than by the echoes: if the odometry is '
                                     f'right, the polygon is that much too {too}')


def slips(slipped: Sequence[tuple[float, float, float]]) -> Caution:
    """Say when the robot slipped [s since the first ping], how far [m] and by what angle [rad]."""
    shown = ', '.join(f'by {1e3 * by_m:.0f} mm and {np.rad2deg(by_rad):+.1f} deg at {after_s:.1f} s'
                      for after_s, by_m, by_rad in slipped[:_TOLD_SLIPS])
    more = f' and {len(slipped) - _TOLD_SLIPS} times more' if len(slipped) > _TOLD_SLIPS else ''
    return Caution('slip', f'between two pings the robot moved other than its odometry says: {shown}{more}')


def lost(count: int, of: int, since_s: float) -> Caution:
    """Say how many pings are lost, the first of them so long after the first ping [s]."""
    return Caution('lost', f'{count} of {of} pings fit no place between the walls, the first at {since_s:.1f} s')


def not_localised(pings: int, fewest: int, places: Sequence[Pose]) -> Caution:
    """Say why the robot is nowhere in a map that is given; `places` in the map's frame are as likely."""
    if pings < fewest:
        return Caution('lost', f'{pings} pings do not tell yet where in the map the robot is',
                       f'drive on: it takes {fewest} pings along a way that is not straight')
    if places:
        told = '; '.join(f'({place.x:.3f}, {place.y:.3f}) m, {np.rad2deg(wrapped(place.yaw)):.0f} deg'
                         for place in places)
        return Caution('lost', f'the pings fit {len(places)} places in the map as well: {told}',
                       'say which by initialpose, or drive on to where the outline tells them apart')
    return Caution('lost', f'{pings} pings fit no place in the map',
                   'check that output.load_path is the map of this place, and the medium; then say by initialpose '
                   'where the robot is, or drive on')


def incoherent() -> Caution:
    """Say that only the echoes' power was of use."""
    return Caution('incoherent', 'the echoes do not agree in phase over the path, so that the polygon comes from their '
                                 'power alone')


def dispersion() -> Caution:
    """Say that magnitudes in a plate mislead."""
    return Caution('dispersion', 'magnitudes cannot be freed of the dispersion of a plate: walls may be off by some '
                                 'millimetres, more than their deviations say, or be wrong')


def as_likely_mirrored() -> Caution:
    """Say that the mirror image explains the echoes, too."""
    return Caution('mirror_image', 'two polygons, mirror images about the path, explain the echoes equally well')

def medium_uneven(faster: tuple[float, float], by_direction: tuple[float, float], from_edge_deg: float) -> Caution:
    """Return what to know of a map in a medium that is not even: two shares with their deviations, and where the second
    is greatest, from edge 0 on [deg].
    """
    told = []
    if abs(faster[0]) > _TOLD * faster[1]:
        told.append(f'from the first ping to the last waves got {"faster" if faster[0] > 0.0 else "slower"} by '
                    f'{abs(faster[0]):.3%} (+-{faster[1]:.3%})')
    if by_direction[0] > _TOLD * by_direction[1]:
        told.append(f'waves are faster by {by_direction[0]:.3%} (+-{by_direction[1]:.3%}) at {from_edge_deg:.0f} deg '
                    'from edge 0, counter-clockwise, and as much slower across')
    return Caution('medium_uneven', '; '.join(told) or 'the medium is all but even')


def curved_edges(
    curvature: NDArray[np.float64], deviation: NDArray[np.float64], corners: NDArray[np.float64]
) -> Caution:
    """Say which edges of a polygon (n, 2) are curved, by curvatures (n,) [1/m] with their deviations, and how far that
    is from straight.
    """
    told = []
    lengths = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    for edge in np.flatnonzero(curvature):
        radius, sag = 1.0 / abs(curvature[edge]), abs(curvature[edge]) * lengths[edge] ** 2 / 8.0
        side = 'outwards' if curvature[edge] > 0.0 else 'inwards'
        told.append(f'edge {edge} bulges {side}: a radius of {radius:.3g} m (+-{deviation[edge] * radius**2:.2g} m), '
                    f'{in_metres(sag)} from its middle to its ends')
    return Caution('curved_edge', '; '.join(told))


def as_a_curve(edges: Sequence[int]) -> Caution:
    """Say that edges in a row may be one wall."""
    told = ', '.join(str(edge) for edge in edges)
    return Caution('curved_edge', f'edges {told} turn hardly from one to the next, as chords of one curved wall do',
                   'look whether they are one; where there are corners, nothing')


def rounded_corners(radius_m: float, deviation_m: float) -> Caution:
    """Say by how much corners are rounded."""
    return Caution('rounded_corners', f'the corners are rounded by a radius of {1e3 * radius_m:.1f} mm '
                                      f'(+-{1e3 * deviation_m:.1f} mm)')


def pulse_adapted(explained: float) -> Caution:
    """Return what to know of a map by a pulse that was found with it."""
    share = f'{min(explained, 1.0):.1%}'
    return Caution('pulse_adapted', 'the map is made with a pulse that was fitted to the echoes, not with the one that '
                                    f"was given: with it {share} of the echoes' power is explained")
