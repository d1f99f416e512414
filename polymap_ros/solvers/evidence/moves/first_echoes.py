"""A wall's first echoes, by themselves: where they add up in phase is the wall, in whatever cycle the others are."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.paths import first_orders
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.tuning import DIFFERENT, EXPLAINED, FULL_ORDER, SEARCH_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave

STEP_CYCLES = 0.125
"""Cycles of range between what is tried, at a wall's end: its echoes turn by 45 degrees there."""

HEARD_ALONG = 6
"""First echoes from a wall, at least: three numbers are to be told from them."""

_SHIFTED_BY, _TURNED_BY = 12, 8
"""So many steps to either side are tried: of how far a wall is shifted, and of how far a turn moves its ends."""

_COMMON_STEPS = 6
"""The same of how far all walls are shifted in common."""

_IN_TURN = 3
"""How often, while all are worth more by it: lines that are refined together come nearer."""


def in_step(ground: Ground, wave: Wave | None) -> tuple[Wave | None, float]:
    """Return walls where their own first echoes add up, if much is left unexplained, and what they explain."""
    share = 0.0 if wave is None else ground.explained(wave, EXPLAINED)
    if wave is None or share > EXPLAINED - ground.uncertainty or not wave.walls.convex_outline:
        return wave, share
    better = by_first_echoes(ground, wave)
    return (wave, share) if better is None else (better, ground.explained(better, EXPLAINED))


def by_first_echoes(ground: Ground, wave: Wave) -> Wave | None:
    """Return the waveform with each wall where its first echoes add up most; None where that is worth no more.

    Where a pulse rings for long, power leaves several walls in wrong cycles at once, and none is worth more by itself.
    The device's phase, by which they add up, may be wrong with all walls a part of a cycle off in common.
    """
    best = wave
    for _ in range(_IN_TURN):
        ground.checkpoint()
        begun = _in_common(ground, best)
        moved = refined_by_orders(ground, begun.with_walls(_added_up(ground, begun)))
        if moved is None or moved.value < best.value + DIFFERENT:
            break
        best = moved
    return best if best is not wave else None


def _in_common(ground: Ground, wave: Wave) -> Wave:
    """Return the waveform with all walls shifted in common and the device's phase turned, so that first echoes stay in
    phase and those of higher orders come to be.
    """
    trials = []
    for steps in range(-_COMMON_STEPS, _COMMON_STEPS + 1):
        farther = steps * STEP_CYCLES * ground.cycle_m
        walls = wave.walls.on(wave.walls.lines + (farther, 0.0))
        turned = replace(wave.with_walls(walls), phase=wave.phase + 2.0 * ground.data.pulse.carrier * farther)
        trials.append(ground.few_wave.evaluate(walls, turned, SEARCH_ORDER))
    return max((each for each in trials if each is not None), key=lambda each: each.value, default=wave)


def _added_up(ground: Ground, wave: Wave) -> Walls:
    """Return the walls, each where its first echoes add up most, with that sign."""
    walls, lines, reflection = wave.walls, wave.walls.lines.copy(), wave.walls.reflection.copy()
    steps = [STEP_CYCLES * ground.cycle_m * np.arange(-most, most + 1) for most in (_TURNED_BY, _SHIFTED_BY)]
    turn, shift = np.meshgrid(*steps, indexing='ij')
    for wall, ends in enumerate(straight_ends(ground, walls).T):
        echoes = FirstEchoes.of(ground.data, walls.lines[wall], ends, ends.mean())
        if len(echoes.pings) < HEARD_ALONG:
            continue
        heard = echoes.summed(ground.data, wave, shift, turn)
        at = np.unravel_index(int(np.argmax(np.abs(heard))), heard.shape)
        lines[wall] = echoes.moved(shift[at], turn[at])
        reflection[wall] = np.copysign(reflection[wall], heard[at])
    return replace(walls.on(lines), reflection=reflection)


@dataclass(frozen=True)
class FirstEchoes:
    """The first echoes from a wall: of which pings (n,), how far away it is [m] and where along it they are reflected,
    from `middle` [m] in units of `half` its length [m].
    """

    line: NDArray[np.float64]
    pings: NDArray[np.intp]
    away: NDArray[np.float64]
    place: NDArray[np.float64]
    half: float
    middle: float

    @classmethod
    def of(cls, data: EchoData, line: NDArray[np.float64], ends: NDArray[np.float64], middle: float) -> Self:
        """Return those from a line between `ends` (2,), about a place along it [m]."""
        away, along = first_orders(line, data.positions, data.baselines)
        pings, half = np.flatnonzero((along > ends[0]) & (along < ends[1])), 0.5 * float(ends[1] - ends[0])
        return cls(line, pings, away[pings], (along[pings] - middle) / half, half, float(middle))

    def summed(
        self, data: EchoData, wave: Wave, shift: NDArray[np.float64], turn: NDArray[np.float64],
        sag: NDArray[np.float64] | float = 0.0,
    ) -> NDArray[np.float64]:
        """Return the sum of the signals there, in phase with the device: below 0 where the wall turns them round.

        It is for a wall that is shifted, turned by so much at its ends, which fall back by `sag`, all of a shape [m].
        """
        by_place = np.multiply.outer(turn, self.place) - np.multiply.outer(sag, self.place**2)
        far, pulse = self.away + shift[..., None] + by_place, data.pulse
        cell = np.clip(far / pulse.step_m, 0.0, data.signal.shape[1] - 2.0)
        low = cell.astype(int)
        share = cell - low
        signal = (1.0 - share) * data.signal[self.pings, low] + share * data.signal[self.pings, low + 1]
        turned = signal * np.exp(1j * (2.0 * pulse.carrier * far + wave.edge.head_on - wave.phase))
        near_m = np.maximum(self.away, pulse.step_m)  # a ping may be on the wall
        return np.asarray(np.sum(turned.real * near_m ** -data.spreading, axis=-1))

    def moved(self, shift: float, turn: float) -> NDArray[np.float64]:
        """Return the line (2,), shifted and turned by so much at its ends [m]."""
        # With r = x cos(theta) + y sin(theta), a turn moves r by the place along the wall about which it is.
        angle = -turn / self.half
        return self.line + (shift + self.middle * angle, angle)


def straight_ends(ground: Ground, walls: Walls) -> NDArray[np.float64]:
    """Return where along their lines edges start and end (2, n) [m], were they straight."""
    straight = replace(walls, bend=np.empty((0, 2)))
    _, sides = straight.sides(ground.data.soft_m, ground.data.shortest_m)
    return np.asarray(sides.rows[:, 3:5].T)


def refined_by_orders(ground: Ground, begun: Wave) -> Wave | None:
    """Return a waveform with its walls at their best, from the first order up: all of them may be off."""
    ground.checkpoint()
    wave: Wave | None = begun
    for order in (1, SEARCH_ORDER, FULL_ORDER):
        wave = wave and ground.wave.refine(wave, order)
    return wave
