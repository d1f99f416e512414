"""Corners that are rounded: edges end before they meet, and echoes from where they would are missing."""

from dataclasses import replace

import numpy as np

from polymap_ros.geometry.outline import corners_of
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.parabola import Changed, at_best, follow_covariance
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, EXPLAINED, FULL_ORDER, SHORT_EDGES
from polymap_ros.solvers.evidence.waveform import Wave

_RADII_CYCLES = 0.5, 1.0, 2.0, 3.0, 4.5
"""Cycles of range that corners' radii are tried at: 5 to 47 mm at 100 kHz in 6 mm of aluminium. Less cuts off less than
the ends of walls are soft by."""

_REFINED_RADII = 3
"""Of them, with these edges or those, the best so many are refined."""

_AHEAD_CYCLES = 0.25
"""By how many cycles of range the echo of a round corner seems nearer than it is: it has passed a focus."""

_RADIUS_ERROR = 0.03
"""Cycles of range by which a radius is off beside what the echoes tell, since ends of walls are soft: 0.3 mm; of twelve
that were found two were off by more, by 0.4 and 0.5 mm (radii of 10 and 20 mm, even seeds)."""

_FROM = 0.8
"""Share of the echoes' power that is explained from which corners are taken to be round: where they are, by 20 mm,
sharp ones explain 0.87 to 0.94 (four plates of 1 to 1.5 m, even seeds)."""

_ROUND_WORTH = 0.02
"""Share of the log likelihood that round corners have to bring over sharp ones: by 20 mm they bring 6 to 15 %, by 10 mm
2.6 to 6 (four plates, even seeds), and where an edge is curved, which none are, up to 1 % was put down to them."""

_FAINT = 0.5
"""Coefficient of an edge that may stand for a corner's silence: where corners are round those had 0.08 to 0.33 (three
plates, even seeds)."""

_RADIUS_STEP = 0.1
"""Cycles of range between the radii that a parabola is drawn through."""


def round_corners(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with corners that are all rounded by one radius, where that explains the echoes and is worth
    clearly more.
    """
    wave = standing.wave
    if standing.explained < _FROM or not wave.walls.convex_outline or len(wave.walls.round) or len(wave.storey):
        return None
    radii = [cycles * ground.cycle_m for cycles in _RADII_CYCLES]
    begun = [_rounded(ground, base, radius) for base in _bases(ground, wave) for radius in radii]
    few = [ground.few_wave.evaluate(each.walls, each, FULL_ORDER) for each in begun]
    as_is = ground.few_wave.evaluate(wave.walls, wave, FULL_ORDER)
    better = [each for each in few if each is not None and as_is is not None and each.value > as_is.value]
    ground.checkpoint()
    better = sorted(better, key=lambda each: -each.value)[:_REFINED_RADII]
    trials = [ground.wave.refine(each, FULL_ORDER) for each in better]
    best = max((each for each in trials if each is not None), key=lambda each: each.value, default=None)
    if best is None:
        return None
    best = at_best(ground, best, _more(ground), _RADIUS_STEP * ground.cycle_m)
    least = (1 + len(best.walls) - len(wave.walls)) * ground.least_gain(wave.value)
    enough = ground.explained(best, ALL_EXPLAINED) > EXPLAINED - ground.uncertainty
    if not enough or best.value < wave.value + least:
        return None
    sharp = ground.wave.refine(best.with_walls(replace(best.walls, round=np.empty(0))), FULL_ORDER)
    return best if sharp is None or best.value > (1.0 + _ROUND_WORTH) * sharp.value else None


def _bases(ground: Ground, wave: Wave) -> list[Wave]:
    """Return the waveform, and that without the short edges, the faint ones or all, that may stand where a corner is
    silent.
    """
    _, corners = corners_of(wave.walls.outline)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    short, bases = lengths < SHORT_EDGES[-1] * ground.width_m, [wave]
    for left_out in (short & (np.abs(wave.walls.reflection) < _FAINT), short):
        walls = wave.walls
        for wall in np.flatnonzero(left_out)[::-1]:
            walls = walls.without(int(wall))
        if len(walls) < len(bases[-1].walls):
            bases.append(wave.with_walls(walls))
    return bases


def corner_radius(ground: Ground, wave: Wave) -> tuple[float, float]:
    """Return the radius of round corners and its deviation [m]."""
    variance, _ = follow_covariance(ground, wave, _more(ground), _RADIUS_STEP * ground.cycle_m)
    return float(wave.walls.round[0]), float(np.hypot(np.sqrt(variance), _RADIUS_ERROR * ground.cycle_m))


def _more(ground: Ground) -> Changed:
    return lambda wave, more_m: _rounded(ground, wave, max(float(wave.walls.round[0]) + more_m, 0.0))


def _rounded(ground: Ground, wave: Wave, radius_m: float) -> Wave:
    """Return the waveform with corners of a radius [m], not evaluated."""
    corners = np.array((radius_m, _AHEAD_CYCLES * ground.cycle_m))
    return wave.with_walls(replace(wave.walls, round=corners))
