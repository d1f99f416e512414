"""Single changes by power: edges added, dropped and exchanged while the likelihood less their price grows."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.outline import bounding_lines
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.proposals import chord_evidence, feet_of, strongest_chords
from polymap_ros.solvers.evidence.tuning import (
    ANOTHER_POLYGON,
    CHORDS,
    DIFFERENT,
    LEAST_CHORD,
    PRICE,
    ROUNDS,
    SCORED,
)
from polymap_ros.solvers.evidence.walls import Walls

_TRIED = 4
"""Changes of a round, the best first, that are refined."""

_PER_WALL = 2
"""Lines tried in the place of each wall."""

_FACING_RAD, _FACING = 1.0, 12
"""Where nothing closes without a wall, the lines of the pool that face its way within this angle, and so many at most,
are tried in its place."""


def improved(ground: Ground, start: Power, order: int, pool: NDArray[np.float64], residual: bool) -> Power:
    """Change single edges of a convex outline, with lines of a pool (m, 2), while the likelihood of power less its
    price grows.

    With lines from the `residual`, too, and down to small gains; without, only what is better as it stands.
    """
    power = convex_refined(ground, start.walls, start, order, 6)
    if power is None:
        return start
    score = _less_price(power)
    for _ in range(ROUNDS):
        ground.checkpoint()
        best = None
        for trial, quick in _changes(ground, power, order, pool, residual)[:_TRIED]:
            if quick <= score and not residual:  # left for the next order
                break
            ground.checkpoint()
            refined = convex_refined(ground, trial, power, order, 4)
            if refined is None:
                continue
            value = _less_price(refined)
            if value > score + (DIFFERENT if residual else ANOTHER_POLYGON) and (
                    best is None or value > _less_price(best)):
                best = refined
                if value > score + PRICE:
                    break
        if best is None:
            break
        power, score = best, _less_price(best)
    return power


def with_line(ground: Ground, walls: Walls, line: NDArray[np.float64]) -> Walls | None:
    """Return walls with one more in their convex outline, those left out that make no edge then; None where they bound
    no polygon.
    """
    return _bounded(ground, walls, np.vstack((walls.outline, line)))


def convex_refined(ground: Ground, walls: Walls, like: Power, order: int, iterations: int) -> Power | None:
    """Return a convex outline refined; where two of its lines have changed places on the way, which leaves a corner
    that points inwards, what they bound is refined.
    """
    refined = ground.power.refine(walls, like, order, iterations)
    if refined is None or not refined.walls.has_reflex_corner:
        return refined
    bounded = _bounded(ground, refined.walls, refined.walls.outline)
    again = None if bounded is None else ground.power.refine(bounded, refined, order, iterations)
    return None if again is None or again.walls.has_reflex_corner else again


def _bounded(ground: Ground, walls: Walls, lines: NDArray[np.float64]) -> Walls | None:
    """Return walls whose outline is the convex one that lines (n, 2) bound; None where they bound no polygon."""
    lines = bounding_lines(lines, ground.data.shortest_m)
    if not len(lines):
        return None
    known = {tuple(each): reflection for each, reflection in zip(walls.lines.tolist(), walls.reflection, strict=True)}
    return walls.with_outline(lines, np.array([known.get(tuple(each), 1.0) for each in lines.tolist()]))


def _less_price(power: Power) -> float:
    return power.value - PRICE * len(power.walls)


def _changes(
    ground: Ground, power: Power, order: int, pool: NDArray[np.float64], residual: bool
) -> list[tuple[Walls, float]]:
    """Return single changes with their unrefined scores, best first."""
    fitted = ground.power.fitted(power.walls, power, order)
    assert fitted is not None, 'the walls bound a polygon'
    walls = power.walls
    if residual:
        pool = np.vstack((
            strongest_chords(ground.data, fitted.expected, fitted.strength, walls.outline, CHORDS), pool))
    trials = [with_line(ground, walls, line) for line in _promising(ground, fitted, pool, CHORDS, walls.lines)]
    for wall in range(walls.ring):
        fewer = ground.power.evaluate(walls.without(wall), fitted, order)
        if fewer is not None:
            trials.append(fewer.walls)
            trials += [with_line(ground, fewer.walls, line)
                       for line in _promising(ground, fewer, pool, _PER_WALL, walls.lines)]
        else:  # nothing closes without it: exchange it for lines that face the same way
            facing = pool[np.abs(wrapped(pool[:, 1] - walls.lines[wall, 1])) < _FACING_RAD][:_FACING]
            trials += [with_line(ground, walls.without(wall), line) for line in facing]
    allowed = [trial for trial in trials if trial is not None and trial.ring <= ground.max_edges]
    few = _best_first(allowed, lambda trial: ground.few_value(trial, fitted, order))
    return _best_first([trial for trial, _ in few[:SCORED]], lambda trial: ground.power.value(trial, fitted, order))


def _promising(
    ground: Ground, power: Power, pool: NDArray[np.float64], most: int, other_than: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return lines of the pool with the most unexplained first-order evidence where they cut the polygon.

    Those that are no other wall than a better one, or than `other_than`, are left out: refined, they would be it.
    """
    gains = chord_evidence(pool, power.walls.outline, feet_of(ground.data, power.expected, power.strength))
    chosen = list(other_than)
    for index in np.argsort(-gains, kind='stable'):
        if len(chosen) == most + len(other_than) or gains[index] <= LEAST_CHORD:
            break
        if not ground.one_of(pool[index], chosen):
            chosen.append(pool[index])
    return np.array(chosen[len(other_than):]).reshape(-1, 2)


def _best_first(trials: list[Walls], value: Callable[[Walls], float]) -> list[tuple[Walls, float]]:
    """Return the walls that bound a polygon, with their value less the price of their edges, best first."""
    scored = [(trial, value(trial) - PRICE * len(trial)) for trial in trials]
    return sorted((entry for entry in scored if np.isfinite(entry[1])), key=lambda entry: -entry[1])
