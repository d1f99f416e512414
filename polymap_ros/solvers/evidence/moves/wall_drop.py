"""A wall too many: the others, refitted without it, are worth more."""

import numpy as np

from polymap_ros.geometry.lines import wrapped
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.square import on_ridge
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import FULL_ORDER, OBVIOUS, PRICE
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave

_SHARED = 5.0 * OBVIOUS
"""Nats that a wall wins back, at most, which shared its pings with the one that goes: 450 were seen."""


_STRAIGHT_RAD = 0.05
"""Turn from an edge to the next, 3 deg, below which they may be one wall: one that was broken by 0.06 deg was seen, and
walls that are one lose more at first than edges do that share their pings."""


def drop_wall(ground: Ground, standing: Standing) -> Wave | None:
    """Return the best waveform with one wall fewer, or one hole, if it is worth more."""
    wave, holes = standing.wave, len(standing.wave.walls.interior.holes)
    trials = [wave.walls.without(wall) for wall in range(len(wave.walls))]
    return _best(ground, wave, trials + [wave.walls.without_hole(hole) for hole in range(holes)])


def merge_walls(ground: Ground, standing: Standing) -> Wave | None:
    """Return the best waveform in which one edge takes the place of two or three next to each other, if worth more.

    In an outline that is not convex an edge may not go by itself, and two may share a wall's pings. Of two that are
    all but one, either is tried in any case: the other is bent by what it does not hear.
    """
    wave, count = standing.wave, len(standing.wave.walls)
    bend = np.abs(wrapped(np.roll(wave.walls.outline[:, 1], -1) - wave.walls.outline[:, 1]))
    broken = {end % len(bend) for wall in np.flatnonzero(bend < _STRAIGHT_RAD).tolist() for end in (wall, wall + 1)}
    if broken and (straight := _best(ground, wave, [wave.walls.without(wall) for wall in sorted(broken)], np.inf)):
        return straight
    pairs = [(wall, (wall + step) % count) for wall in range(count) for step in (1, 2)] if count > 4 else []
    trials = [wave.walls.without(wall) for wall in range(count)]
    trials += [wave.walls.without(max(pair)).without(min(pair)) for pair in pairs]
    return _best(ground, wave, trials, _SHARED)


def _best(ground: Ground, wave: Wave, trials: list[Walls], obvious: float = OBVIOUS) -> Wave | None:
    best, obvious = None, max(obvious, ground.least_gain(wave.value)) if ground.approximate else obvious
    for trial in trials:
        fewer = ground.wave.evaluate(trial, wave, FULL_ORDER)
        if fewer is None or fewer.value + PRICE * (len(wave.walls) - len(trial)) < wave.value - obvious:
            continue
        ground.checkpoint()
        fewer = ground.wave.refine(fewer, FULL_ORDER)
        if fewer is not None and not fewer.walls.convex_outline:
            fewer = on_ridge(ground, fewer) or fewer
        if fewer is not None and (best is None or fewer.value > best.value):
            best = fewer
    return best if best is not None and ground.worth(best) > ground.worth(wave) else None
