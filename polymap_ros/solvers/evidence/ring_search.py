"""The search for outlines that are not convex, by power: from closed walks to a ring that no change improves.

First echoes alone sort out rings by the hundred thousand (`rings`); the likelihood of power, by few pings, then by all,
says which of the best are worth refining. New candidate lines come from what a ring leaves unexplained.
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.jit import IS_COMPILED
from polymap_ros.solvers.evidence.closed_walks import COSTS, closed_walks
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.oriented_lines import aligned_lines, main_direction, oriented_lines
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.proposals import first_strength
from polymap_ros.solvers.evidence.ring_annealing import annealed
from polymap_ros.solvers.evidence.ring_changes import changes, notched
from polymap_ros.solvers.evidence.rings import ring_evidence, ring_feet
from polymap_ros.solvers.evidence.square_walls import squared
from polymap_ros.solvers.evidence.tuning import ANOTHER_POLYGON, DIFFERENT, PRICE, SEARCH_ORDER, WEAK_ECHOES
from polymap_ros.solvers.evidence.walls import Walls

_RINGS_FROM = 20
"""Pings from which outlines that are not convex are looked for: an L of six walls, each heard by three or more."""

_RESIDUAL = 20
"""Candidate lines of each ranking of what a ring leaves."""

_ALIGNED, _ALIGNED_RESIDUAL = 16, 8
"""Lines of each quarter turn that are parallel or perpendicular to most, of all that was heard and of what a ring
leaves: among the first as many were 33 of the 34 such walls of five outlines that were not found without."""

_LINES = 150
"""Lines of each of two rankings: of 27 outlines (even seeds) 15 have a wall below the 60th place of the second ranking,
nine below the 150th."""

_WALKED = 120
"""Lines that walks are made of: their time grows with the square."""

_TRIED_LINES = 110
"""Lines that are tried in the place of edges, those of the residual first."""

_ANNEALED, _KEPT = 6, 6
"""Closed walks that are annealed, and rings that are refined by power: the best, if they differ."""

_SET_OUT = 3
"""Of those, rings from which changes set out: of six T without right angles (even seeds) three are reached from the
first, five from one of three, and the sixth but for a wall."""

_RING_ANNEALING = 40_000
"""Iterations of an annealing: a tenth of a second or two. With ten times as many no more outlines of 27 were found."""

_SCORED_RINGS, _REFINED_RINGS = 16, 5
"""Changes of a round that are scored by all pings, and refined."""

_RING_CHANGES, _FIRST_CHANGES = 12, 2
"""Changes in a row, at most, and those of the best ring to start from where echoes are weak: first echoes tell few of
the walls then. At -10 dB it is worth 0.66 to 2.3 times what a convex outline is without (seven L and T, even seeds),
and 1.4 times or more with them; under drift (six plates) 1.1 times at most, or it explains a third at most."""


def may_tell_rings(ground: Ground, outline: str) -> bool:
    """Return whether outlines that are not convex are asked for (`solver.outline`) and can be found.

    Few pings do not tell one, nor does power alone; without compiled kernels the search would take hours.
    """
    return outline == 'auto' and ground.coherent and IS_COMPILED and len(ground.data.positions) >= _RINGS_FROM


def ring_starts(ground: Ground) -> tuple[list[Power], NDArray[np.float64]]:
    """Return the best rings from closed walks, refined by two orders and three, and the lines they were chosen among.

    Changes, of which the best is made each time, lead one of the next rings to the outline where the first ends short.
    Where echoes are weak, some are made to the best ring here, so that it tells what rings are worth.
    """
    data, nothing = ground.data, ground.nothing.expected
    strength = first_strength(data, nothing)
    pool, evidence = oriented_lines(data, nothing, strength, _LINES)
    if len(pool) < 3:
        return [], pool
    direction = main_direction(data, nothing, strength)
    aligned = aligned_lines(data, nothing, strength, direction, _ALIGNED)
    pool, evidence = np.vstack((aligned.lines, pool)), np.concatenate((aligned.evidence, evidence))
    feet = ring_feet(data, nothing, strength)
    walks = [ring for costs in COSTS for ring in closed_walks(data, pool[:_WALKED], feet, costs)
             if len(ring) <= ground.max_edges]
    walks.sort(key=lambda ring: -ring_evidence(pool[ring], feet))
    rings: dict[tuple[int, ...], float] = {}
    for walk in walks[:_ANNEALED]:
        ground.checkpoint()
        ring, score = annealed(pool, evidence, walk, feet, ground.max_edges, _RING_ANNEALING, ground.generator)
        rings[tuple(np.roll(ring, -int(np.argmin(ring))).tolist())] = score
    refined: list[Power] = []
    for numbers in sorted(rings, key=lambda each: -rings[each])[:_KEPT]:
        ground.checkpoint()
        ring, _ = notched(pool, np.array(numbers), rings[numbers], feet, ground.max_edges)
        walls = _walls(pool[ring], np.ones(len(ring)))
        power = ground.power.refine(walls, ground.nothing.with_strength(strength), 2, 4)
        if power is not None and all(abs(power.value - other.value) > DIFFERENT for other in refined):
            refined.append(power)
    refined.sort(key=lambda power: -_worth(power))
    best = [ground.power.refine(power.walls, power, SEARCH_ORDER, 4) or power for power in refined[:_SET_OUT]]
    if ground.uncertainty > WEAK_ECHOES:
        best[:1] = [improved_ring(ground, first, pool, _FIRST_CHANGES) for first in best[:1]]
    return best, pool


def improved_ring(ground: Ground, power: Power, pool: NDArray[np.float64], most: int = _RING_CHANGES) -> Power:
    """Exchange neighbouring edges for lines of the pool (m, 2), and of the residual, while that is worth more.

    At most so many changes in a row are made.
    """
    direction = main_direction(ground.data, ground.nothing.expected, power.strength)
    for _ in range(most):
        ground.checkpoint()
        fitted = ground.power.fitted(power.walls, power, SEARCH_ORDER)
        assert fitted is not None, 'the walls bound an outline'
        more = oriented_lines(ground.data, fitted.expected, fitted.strength, _RESIDUAL).lines
        aligned = aligned_lines(ground.data, fitted.expected, fitted.strength, direction, _ALIGNED_RESIDUAL).lines
        tried = np.vstack((aligned, more, pool))[:_TRIED_LINES]
        better = _changed(ground, fitted, np.vstack((power.walls.lines, tried)))
        if better is None:
            break
        power = better
    return power


def _changed(ground: Ground, fitted: Power, lines: NDArray[np.float64]) -> Power | None:
    """Return the best change of a ring, whose edges are the first of the lines, if it is another outline.

    By first echoes alone the line of another edge, where two are on one, ranks behind clutter: first a list of those.
    So does a pair of walls of which the ring knows nothing, behind images of walls that it knows: last a list by what
    it leaves unexplained.
    """
    count, data, most = len(fitted.walls), ground.data, ground.max_edges
    feet = ring_feet(data, ground.nothing.expected, fitted.strength)
    left = ring_feet(data, fitted.expected, fitted.strength)
    rings = [*changes(lines[:count], count, feet, most), *changes(lines, count, feet, most),
             *changes(lines, count, left, most)]
    reflection = np.append(np.abs(fitted.walls.reflection), np.ones(len(lines) - count))
    trials = [_walls(lines[ring], reflection[ring]) for ring in rings]
    for value, order, most in (
            (ground.few_value, 2, _SCORED_RINGS), (ground.power.value, SEARCH_ORDER, _REFINED_RINGS)):
        ground.checkpoint()
        scored = [value(trial, fitted, order) - PRICE * len(trial) for trial in trials]
        trials = [trials[k] for k in np.argsort(scored, kind='stable')[::-1][:most]]
    best, least = None, _worth(fitted) + ANOTHER_POLYGON
    for trial in trials:
        ground.checkpoint()
        rough = ground.power.refine(trial, fitted, 2, 3)
        fine = rough and ground.power.refine(rough.walls, rough, SEARCH_ORDER, 3)
        if fine is not None and _worth(fine) > least:
            best, least = fine, _worth(fine)
    return best


def rehearse_rings(ground: Ground, lines: NDArray[np.float64]) -> None:
    """Use every kernel of this search once, on a convex ring of lines (n, 2) and whatever the pings heard."""
    data, nothing, ring = ground.data, ground.nothing.expected, np.arange(len(lines))
    feet = ring_feet(data, nothing, 1.0)
    aligned_lines(data, np.ones_like(data.power), 1.0, main_direction(data, np.ones_like(data.power), 1.0), 1)
    oriented_lines(data, np.ones_like(data.power), 1.0, 1)
    closed_walks(data, lines, feet, COSTS[0])
    annealed(lines, np.ones(len(lines)), ring, feet, len(lines), 1, ground.generator)
    notched(lines, ring, np.inf, feet, ground.max_edges)
    changes(lines, len(lines), feet, ground.max_edges)


def _walls(lines: NDArray[np.float64], reflection: NDArray[np.float64]) -> Walls:
    walls = Walls(np.ascontiguousarray(lines), reflection)
    return squared(walls) or walls


def _worth(power: Power) -> float:
    return power.value - PRICE * len(power.walls)
