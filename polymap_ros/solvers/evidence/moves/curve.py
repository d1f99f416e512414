"""A wall that is curved a little: its first echoes turn along it as a straight one's do not."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.first_echoes import (
    HEARD_ALONG,
    STEP_CYCLES,
    FirstEchoes,
    refined_by_orders,
    straight_ends,
)
from polymap_ros.solvers.evidence.moves.parabola import at_best, follow_covariance
from polymap_ros.solvers.evidence.moves.round import round_corners
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import (
    ALL_EXPLAINED,
    EDGE_PRICE,
    EXPLAINED,
    FULL_ORDER,
    SEARCH_ORDER,
    WHOLE,
)
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave

_SAG_STEPS, _TURN_STEPS, _SHIFT_STEPS = 18, 5, 6
"""So many steps to either side are tried: of how much a wall's ends fall back, by which it is turned, and by which it
is shifted. Eighteen are 24 mm at 100 kHz in 6 mm of aluminium: a radius of 5 m over one metre, or of 20 m over two."""

_AS_GOOD = 0.98
"""Share of what stands that a wall that is bent has to be worth before its curvature is at its best."""

_BY_ITSELF = 0.5
"""Share of what a curve has to be worth that it has to gain with all else as it is, to be looked into, and by the top
of one parabola, to be looked into further."""

_CENTRED = 2
"""How often lines are turned to touch in the middle, which itself moves a hundredth as far."""

_BEND_CYCLES = 0.02
"""Cycles of range at a wall's end between the curvatures that a parabola is drawn through."""

_BEND_ERROR = 0.5
"""The same that a curvature is off by beside what the echoes tell, in these steps: 0.1 mm at a wall's end."""


def curve_wall(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with a wall that is curved, or curved otherwise, where that is worth clearly more.

    It has to explain the echoes, if need be with round corners: what a wall in another cycle leaves, a curve explains a
    part of.
    """
    wave = standing.wave
    if not wave.walls.convex_outline or len(wave.storey):
        return None
    if (tuned := _tuned(ground, wave)) is not None:
        return tuned
    least = ground.least_gain(wave.value)
    for wall, begun in _begun(ground, wave, least):
        if begun is None or begun.value < _AS_GOOD * wave.value:
            continue
        best = at_best(ground, begun, _Curved(ground, wall), 1.0, tops=1)
        if best.value < wave.value + _BY_ITSELF * least:
            continue
        best = at_best(ground, best, _Curved(ground, wall), 1.0)
        if best.value < wave.value + least:
            continue
        share = ground.explained(best, WHOLE)
        if share < WHOLE and (rounded := round_corners(ground, Standing(standing.power, best, share))) is not None:
            return rounded
        if share > EXPLAINED - ground.uncertainty:
            # It may only have led the walls on.
            plain = ground.wave.refine(best.with_walls(_with_bend(best.walls, wall, 0.0)), FULL_ORDER)
            return plain if plain is not None and plain.value > best.value - least else best
    return None


def curve_at_last(ground: Ground, standing: Standing) -> Wave | None:
    """Do the same where so little is left that other moves come first; where more is, it has been tried."""
    return curve_wall(ground, standing) if standing.explained >= ALL_EXPLAINED else None


def straightened(ground: Ground, wave: Wave) -> Wave:
    """Return the waveform with walls that are straight where that is worth as much, since what bent one may be gone,
    and the others' curvatures at their best.
    """
    for wall in np.flatnonzero(wave.walls.curvature):
        plain = ground.wave.refine(wave.with_walls(_with_bend(wave.walls, int(wall), 0.0)), FULL_ORDER)
        straight = plain is not None and plain.value > wave.value - ground.least_gain(wave.value)
        wave = plain if plain is not None and straight else at_best(ground, wave, _Curved(ground, int(wall)), 1.0)
    return wave


def in_the_middle(ground: Ground, wave: Wave) -> Wave:
    """Return the same waveform with lines that touch curved walls in the middles of the edges."""
    walls = wave.walls
    for _ in range(_CENTRED if len(walls.bend) else 0):
        walls = _centred(ground, walls)
    return replace(wave, walls=walls)


def rehearse_curves(ground: Ground, wave: Wave) -> None:
    """Use the kernels of curved walls and round corners once, on walls that are straight."""
    walls = replace(wave.walls, round=np.array((_BEND_CYCLES * ground.cycle_m, 0.0)))
    bent = replace(walls, bend=_straight(ground, walls))
    for derive in (False, True):
        ground.wave.evaluate(bent, wave, SEARCH_ORDER, derive=derive)


def _begun(ground: Ground, wave: Wave, least: float) -> Iterator[tuple[int, Wave | None]]:
    """Give the wall whose first echoes gain most by a curve, with that, and the one by which a little of it gains most.
    """
    bends = list(_bent(ground, wave))
    wall, gain, walls = max(bends, key=lambda each: each[1], default=(0, 0.0, wave.walls))
    if gain > 0.0:
        yield wall, refined_by_orders(ground, wave.with_walls(walls))
    ground.checkpoint()
    begun = wave.with_walls(replace(wave.walls, bend=_straight(ground, wave.walls)))
    here = ground.few_wave.evaluate(begun.walls, begun, FULL_ORDER)
    gains = [(_gain(ground, here, wall), wall) for wall, _, _ in bends] if here else []
    if gains and max(gains)[0] > _BY_ITSELF * least:
        yield max(gains)[1], ground.wave.refine(begun, FULL_ORDER)


def _gain(ground: Ground, here: Wave, wall: int) -> float:
    """Return what a wall's curvature gains with all else as it is, by a parabola, of a waveform by a part of the pings.
    """
    curved = _Curved(ground, wall)
    before, after = (ground.few_wave.evaluate(each.walls, each, FULL_ORDER)
                     for each in (curved(here, -1.0), curved(here, 1.0)))
    if before is None or after is None:
        return 0.0
    slope, bend = after.value - before.value, 2.0 * here.value - before.value - after.value
    return ground.share * (abs(slope) if bend <= 0.0 else 0.125 * slope**2 / bend)


def _straight(ground: Ground, walls: Walls) -> NDArray[np.float64]:
    """Return how walls are curved (n, 2), those that are straight not at all, in their middles."""
    return walls.bend if len(walls.bend) else np.column_stack((np.zeros(len(walls)), _middles(ground, walls)))


def _middles(ground: Ground, walls: Walls) -> NDArray[np.float64]:
    """Return where along their lines the edges (n,) have their middles [m]."""
    low, high = straight_ends(ground, walls)
    return np.asarray(0.5 * (low + high))


def curvature_covariance(ground: Ground, wave: Wave) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the deviations of the walls' curvatures (n,) [1/m], and what those that are not 0 add to the covariance
    (2 n, 2 n) of the lines.
    """
    n = len(wave.walls)
    deviations, covariance = np.zeros(n), np.zeros((2 * n, 2 * n))
    for wall in np.flatnonzero(wave.walls.curvature):
        curved = _Curved(ground, int(wall))
        variance, more = follow_covariance(ground, wave, curved, 1.0)
        deviations[wall] = np.hypot(np.sqrt(variance), _BEND_ERROR) * curved.step(wave.walls)
        covariance += more
    return deviations, covariance


@dataclass(frozen=True)
class _Curved:
    """A wall, curved more: in units in which the echoes of its ends turn by as much in every wall."""

    ground: Ground
    wall: int

    def __call__(self, wave: Wave, more: float) -> Wave:
        """Return the waveform with so much more curvature, the wall shifted so that it stays where it is on average."""
        walls, half = wave.walls, _half_lengths(self.ground, wave.walls)[self.wall]
        curvature = more * self.step(walls)
        bent = _with_bend(walls, self.wall, walls.curvature[self.wall] + curvature)
        return wave.with_walls(bent.shifted(self.wall, curvature * half**2 / 6.0))

    def step(self, walls: Walls) -> float:
        """Return a unit [1/m]."""
        return 2.0 * _BEND_CYCLES * self.ground.cycle_m / float(_half_lengths(self.ground, walls)[self.wall]) ** 2


def _tuned(ground: Ground, wave: Wave) -> Wave | None:
    """Return the waveform with all curvatures at their best, where that is worth anything."""
    best = wave
    for wall in np.flatnonzero(wave.walls.curvature):
        best = at_best(ground, best, _Curved(ground, int(wall)), 1.0)
    return best if best.value > wave.value + EDGE_PRICE else None


def _centred(ground: Ground, walls: Walls) -> Walls:
    """Return the same walls by other lines: those that touch them in the middles of the edges, but for the curvature's
    square.
    """
    off = _middles(ground, walls) - walls.bend[:, 1]
    turn = walls.bend[:, 0] * off
    lines = walls.lines + np.column_stack((turn * (walls.bend[:, 1] + 0.5 * off), turn))
    along = walls.bend[:, 1] + off - turn * walls.lines[:, 0]
    return replace(walls.on(lines), bend=np.column_stack((walls.bend[:, 0], along)))


def _with_bend(walls: Walls, wall: int, curvature: float) -> Walls:
    """Return the walls with one of them curved so."""
    bend = walls.bend.copy()
    bend[wall, 0] = curvature
    return walls.with_bend(bend)


def _half_lengths(ground: Ground, walls: Walls) -> NDArray[np.float64]:
    low, high = straight_ends(ground, walls)
    return np.asarray(0.5 * (high - low))


def _bent(ground: Ground, wave: Wave) -> Iterator[tuple[int, float, Walls]]:
    """Give each wall that is straight, how much more of its first echoes is in phase where it is curved as fits them
    best, and the walls with that.
    """
    walls = wave.walls
    ends, bend = straight_ends(ground, walls), _straight(ground, walls)
    each_way = (_SAG_STEPS, _TURN_STEPS, _SHIFT_STEPS)
    steps = [STEP_CYCLES * ground.cycle_m * np.arange(-most, most + 1) for most in each_way]
    sag, turn, shift = np.meshgrid(*steps, indexing='ij')
    for wall in np.flatnonzero(bend[:, 0] == 0.0).tolist():
        echoes = FirstEchoes.of(ground.data, walls.lines[wall], ends[:, wall], bend[wall, 1])
        if len(echoes.pings) < HEARD_ALONG:
            continue
        heard = np.abs(echoes.summed(ground.data, wave, shift + sag / 3.0, turn, sag))
        at = np.unravel_index(int(np.argmax(heard)), heard.shape)
        bent, lines = bend.copy(), walls.lines.copy()
        bent[wall, 0] = 2.0 * sag[at] / echoes.half**2
        lines[wall] = echoes.moved(shift[at] + sag[at] / 3.0, turn[at])
        yield wall, float(heard[at] - heard[_SAG_STEPS].max()), replace(walls.on(lines), bend=bent)
