"""Where a robot is between walls that are known, by a few pings and the way between them: a start for tracking.

Each ping alone tells at which places its echoes would be heard as they were: a map of the outline. The way by the
odometry, laid through the maps of some pings from every place and in every direction, is heard best from where the
robot was. The best are refined by power, then in phase; an outline that looks the same from elsewhere leaves several.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from shapely import Polygon, contains_xy

from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.outline import corners_of
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.poses import between, in_frame
from polymap_ros.solvers.evidence.dead_reckoning import dead_reckoned
from polymap_ros.solvers.evidence.localisation import placed_by_power
from polymap_ros.solvers.evidence.mirror import AS_LIKELY
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.proposals import first_strength
from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.evidence.tracking import Chain, Track, mended, refined
from polymap_ros.solvers.evidence.tuning import BY_POWER, SEARCH_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.windows import BLUR, SETTLED, STEPS
from polymap_ros.solvers.solver import Expected

FEWEST, LOOKED_AT = 6, 10
"""Pings from which a place is looked for, and how many are looked at."""

_SPACING = 0.75
"""Widths of the pulse from one place to the next: power that is blurred by as much is smooth between them."""

_DIRECTIONS_RAD = 0.01, 0.1
"""Steps of the direction, at least and at most: the last ping moves from one place to the next."""

_CANDIDATES = 10
"""Places and directions that are refined; several lead to the same path (seven of ten in a plate of seven edges)."""

_APART = 3.0
"""Widths of the pulse by which two candidates differ at one ping at least."""

_BESIDE_M = 0.04
"""How far a ping is looked for beyond what the odometry expects [m]."""

_WITHIN = 3.0
"""Deviations of what is expected within which places and directions are looked at."""

_GRID_PLACES = 20_000
"""Places of a map; in larger outlines they lie farther apart."""


class _Maps(NamedTuple):
    """What pings are worth at places (rows, columns) of a grid that begins at `corner`, `step_m` apart."""

    values: NDArray[np.float64]
    corner: NDArray[np.float64]
    step_m: float
    lowest: NDArray[np.float64]

    def place(self, row: int, column: int) -> NDArray[np.float64]:
        """Return a place of the grid."""
        return np.asarray(self.corner + self.step_m * np.array((column, row)))


def whereabouts(
    search: Search, chain: Chain, walls: Walls, pings: NDArray[np.int64], expected: Expected | None = None
) -> list[Track]:
    """Return the tracks of pings that explain their echoes between known walls, the best first.

    More than one only where they are as likely. Each moves the walls' coefficients, not their lines.
    """
    rough = search.over(search.data.blurred(BLUR * search.width_m))
    over = rough.over(rough.data.chosen(pings).at(chain.poses[pings]))
    like = over.nothing.with_strength(first_strength(over.data, over.nothing.expected)).with_walls(walls)
    tracks: list[Track] = []
    for poses in _candidates(rough, chain, like, pings, expected):
        search.checkpoint()
        track = _settled(search, rough, chain, like, pings, poses)
        if track is not None and not any(_same(track, other, search.width_m) for other in tracks):
            tracks.append(track)
    worths = [track.found.value + chain.between(track.pings).log_prior(track.poses) for track in tracks]
    order = sorted(range(len(tracks)), key=lambda number: -worths[number])
    return [tracks[number] for number in order if worths[number] > worths[order[0]] - AS_LIKELY]


def _same(track: Track, other: Track, least_m: float) -> bool:
    _, mine, its = np.intersect1d(track.pings, other.pings, return_indices=True)
    return bool(np.max(np.hypot(*(track.poses[mine] - other.poses[its])[:, :2].T), initial=0.0) < least_m)


def _candidates(
    rough: Search, chain: Chain, like: Power, pings: NDArray[np.int64], expected: Expected | None
) -> list[NDArray[np.float64]]:
    """Return paths (n, 3) of the base from which the pings are heard best by power, the best first."""
    arm = Pose(rough.data.arm_m[0], rough.data.arm_m[1])
    way = between(chain.poses[pings[:1]], chain.poses[pings])
    sensors = rough.data.sensors(way)
    maps = _maps(rough, chain, like, pings)
    reach_m = max(float(np.max(np.hypot(*(sensors - sensors[0]).T))), rough.width_m)
    turns = np.arange(0.0, 2.0 * np.pi, float(np.clip(maps.step_m / reach_m, *_DIRECTIONS_RAD)))
    middle: Pose | None = None
    if expected is not None:
        middle = expected.correction.compose(Pose(*chain.poses[pings[0]].tolist()))
        turns = turns[np.abs(wrapped(turns - middle.yaw)) <= _WITHIN * expected.heading_rad + _DIRECTIONS_RAD[1]]
    ranked = []
    for turn in turns:
        total = _along(maps, in_frame(np.column_stack((sensors - sensors[0], np.zeros(len(sensors)))),
                                      Pose(0.0, 0.0, float(turn)))[:, :2])
        if expected is not None and middle is not None:
            total = np.where(_within(maps, middle.compose(arm), _WITHIN * expected.place_m), total, -np.inf)
        row, column = np.unravel_index(int(np.argmax(total)), total.shape)
        ranked.append((float(total[row, column]), float(turn), maps.place(int(row), int(column))))
    paths: list[NDArray[np.float64]] = []
    for _, turn, place in sorted(ranked, key=lambda each: -each[0]):
        base = Pose(float(place[0]), float(place[1]), turn).compose(Pose(-arm.x, -arm.y))
        path = in_frame(way, base)
        if all(np.max(np.hypot(*(path - other)[:, :2].T)) > _APART * rough.width_m for other in paths):
            paths.append(path)
            if len(paths) == _CANDIDATES:
                break
    return paths


def _maps(rough: Search, chain: Chain, like: Power, pings: NDArray[np.int64]) -> _Maps:
    """Return what each ping is worth at places within the outline, as far about as the way to it is unknown."""
    _, corners = corners_of(like.walls.outline)
    low, extent = corners.min(axis=0), np.ptp(corners, axis=0)
    step_m = max(_SPACING * rough.width_m, float(np.sqrt(np.prod(extent) / _GRID_PLACES)))
    columns, rows = (int(np.ceil(size / step_m)) + 1 for size in extent)
    places = np.stack(np.meshgrid(low[0] + step_m * np.arange(columns), low[1] + step_m * np.arange(rows)), axis=-1)
    inside = contains_xy(Polygon(corners), places[..., 0], places[..., 1])
    on_axis = dataclasses.replace(rough.data.without_phase(), arm_m=(0.0, 0.0, *rough.data.arm_m[2:]))
    values, lowest = np.empty((len(pings), rows, columns)), np.empty(len(pings))
    poses = np.column_stack((places[inside], np.zeros(int(inside.sum()))))
    for number, ping in enumerate(pings):
        rough.checkpoint()
        shares = placed_by_power(on_axis, like, int(ping), poses)
        lowest[number] = shares.min()
        values[number] = lowest[number]
        values[number][inside] = shares
        off_m = float(np.sqrt(np.linalg.eigvalsh(dead_reckoned(chain.part(pings), number)[:2, :2])[-1]))
        values[number] = maximum_filter(values[number], size=2 * round(off_m / step_m) + 1)
    return _Maps(values, low, step_m, lowest)


def _along(maps: _Maps, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what all pings are worth where the first is at each place and the others (n, 2) so far from it."""
    _, rows, columns = maps.values.shape
    total = np.zeros((rows, columns))
    for values, lowest, (x, y) in zip(maps.values, maps.lowest, offsets, strict=True):
        right, up = round(x / maps.step_m), round(y / maps.step_m)
        here = np.full((rows, columns), lowest)
        to_rows, to_columns = slice(max(-up, 0), rows - max(up, 0)), slice(max(-right, 0), columns - max(right, 0))
        if to_rows.start < to_rows.stop and to_columns.start < to_columns.stop:
            here[to_rows, to_columns] = values[to_rows.start + up:to_rows.stop + up,
                                               to_columns.start + right:to_columns.stop + right]
        total += here
    return total


def _within(maps: _Maps, middle: Pose, reach_m: float) -> NDArray[np.bool_]:
    _, rows, columns = maps.values.shape
    x, y = (maps.corner[axis] + maps.step_m * np.arange(count) for axis, count in enumerate((columns, rows)))
    return np.asarray(np.hypot(x[None, :] - middle.x, y[:, None] - middle.y) <= reach_m + maps.step_m)


def _settled(
    search: Search, rough: Search, chain: Chain, like: Power, pings: NDArray[np.int64], poses: NDArray[np.float64]
) -> Track | None:
    """Return a path refined by power, blurred first, then in phase; None where it does not explain the echoes."""
    track, power = None, like
    for over in (rough, search):
        found = over.over(over.data.chosen(pings).at(poses)).judged(power, None)
        track = None if found is None else refined(over, chain, found, pings, poses, STEPS, SEARCH_ORDER)
        if track is None:
            return None
        power, poses = track.found.power, track.poses
    assert track is not None, 'there are two'
    if track.found.explained < BY_POWER - search.uncertainty:
        return None
    if not search.coherent:
        return track
    track = mended(search, chain, track, (), _BESIDE_M)
    found = track.search.judge(track.found.power)
    better = None if found is None or found.wave is None else refined(search, chain, found, pings, track.poses)
    if better is not None and better.found.explained < SETTLED:  # power may leave a pose a cycle off
        better = mended(search, chain, better, (), _BESIDE_M)
    return better if better and better.found.explained > SETTLED - search.uncertainty else None
