"""Reflections that delay the echo: its phase and, by other than a cycle's share of that, its envelope."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.edge_phase import COMMON
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.louder import with_louder
from polymap_ros.solvers.evidence.moves.parabola import Changed, at_best, follow_covariance
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.tuning import (
    ALL_EXPLAINED,
    DIFFERENT,
    EDGE_MISFIT,
    EDGE_PRICE,
    EXPLAINED,
    FULL_ORDER,
    SEARCH_ORDER,
)
from polymap_ros.solvers.evidence.waveform import Wave

_LATEST = 1.0
"""Cycles of range by which an envelope is taken to be late, or early, at most."""

_DELAYS_PER_CYCLE = 12
"""Delays that are tried per cycle: half of one turns the phase by 15 degrees."""

_BENT_RAD = 0.3
"""What a law is mended by, in one of its numbers, from which it is doubted: Kirchhoff's by 0.05, a constant phase by
0.1, and by 0.5 to 1.2 where what is missing is a delay (even seeds)."""

_REFINED, _POLISHED = 4, 2
"""Delays that are refined, the best first, and those of them that are brought to their best."""

_POLISH_BRINGS = 0.1
"""Share of the echoes' power that being brought to their best has brought at most, up to 0.04 (four even seeds)."""

_AS_MUCH = 1.0 - 1e-6
"""Share of a value from which two are one."""

_DELAY_STEP = 0.03
"""Cycles of range between the delays that a parabola is drawn through."""


def delay_envelopes(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with envelopes that each reflection delays, where that explains all.

    First echoes are heard late by one delay, so that power has put all walls too far away by it; which one it is, and
    by which law the phase turns, is tried. It is where much is left, or where a law explains nearly all but for
    numbers that no law has: by such a one, all walls are a third of a cycle off.
    """
    wave = standing.wave
    bent = wave.edge.free and bool(np.any(np.abs(wave.edge.found) > _BENT_RAD))
    if ground.edges_are_real or wave.loudness.late != 0.0 or len(wave.storey) or not (wave.walls.convex_outline and (
            bent or standing.explained < EXPLAINED - ground.uncertainty)):
        return None
    power: Power | None = standing.power
    if len(standing.power.walls) != len(wave.walls):  # of which some have been dropped since
        power = ground.power.refine(wave.walls, standing.power, FULL_ORDER)
    if power is None:
        return None
    trials = [each for begun in _begun(ground, power) if (each := _in_phase(ground, begun)) is not None]
    for trial in sorted(trials, key=lambda each: -each.value)[:_POLISHED]:
        if trial.value > wave.value and ground.explained(trial) > EXPLAINED - _POLISH_BRINGS:
            late = _at_best_delay(ground, with_louder(ground, trial) or trial)
            if late.value > (1.0 + EDGE_MISFIT) * wave.value and ground.explained(late) > ALL_EXPLAINED:
                return _simplest(ground, late, wave)
    return None


def _simplest(ground: Ground, late: Wave, before: Wave) -> Wave:
    """Return the waveform without a delay, and what was freed beside it, where that is worth about as much: then walls
    have only been led to where they are.
    """
    least = max(EDGE_PRICE, EDGE_MISFIT * late.value)
    even = _delayed(late, -late.loudness.late, ground.data.pulse.carrier)
    for simpler in (replace(even, edge=before.edge, loudness=before.loudness), even):
        refined = ground.wave.refine(simpler, FULL_ORDER)
        if refined is not None and refined.value > late.value - least:
            return refined
    return late


def tune_delay(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with its delay at its best beside all else, where that is worth anything."""
    wave = standing.wave
    if wave.loudness.late == 0.0:
        return None
    better = _at_best_delay(ground, wave)
    return better if better.value > wave.value + DIFFERENT else None


def _begun(ground: Ground, power: Power) -> list[Wave]:
    """Return the best delay by each law, at walls that are nearer by as much, as they are."""
    walls, most, trials = power.walls, round(_LATEST * _DELAYS_PER_CYCLE), []
    for law in ground.edges:
        ground.checkpoint()
        for late_m in ground.cycle_m / _DELAYS_PER_CYCLE * np.arange(-most, most + 1):
            nearer = walls.on(walls.lines - np.array((late_m, 0.0)))
            wave = ground.wave.begun(nearer, law.held(), power.storey)
            wave = replace(wave, loudness=wave.loudness._replace(late=float(late_m)))
            trials += [ground.wave.evaluate(each.walls, each, SEARCH_ORDER) for each in (wave, wave.turned())]
    found: list[Wave] = []
    for each in sorted((each for each in trials if each is not None), key=lambda each: -each.value):
        if all(each.value < _AS_MUCH * other.value for other in found):  # a law and its opposite are one but for signs
            found.append(each)
    return found[:_REFINED]


def _in_phase(ground: Ground, begun: Wave) -> Wave | None:
    """Return a waveform with its walls at their best, from the first order up, then with the phases that it turns."""
    wave: Wave | None = begun
    for order in (1, SEARCH_ORDER):
        wave = wave and ground.wave.refine(wave, order)
    return wave and ground.wave.refine(replace(wave, edge=wave.edge.freed(), slopes=None), FULL_ORDER)


def _at_best_delay(ground: Ground, wave: Wave) -> Wave:
    """Return the waveform with the delay that fits best, which all else follows."""
    return at_best(ground, wave, _by_carrier(ground), _DELAY_STEP * ground.cycle_m)


def delay_covariance(ground: Ground, wave: Wave) -> NDArray[np.float64]:
    """Return what the delay, known as well as the echoes tell it, adds to the covariance (2 n, 2 n) of the lines."""
    return follow_covariance(ground, wave, _by_carrier(ground), _DELAY_STEP * ground.cycle_m)[1]


def _by_carrier(ground: Ground) -> Changed:
    return lambda wave, more_m: _delayed(wave, more_m, ground.data.pulse.carrier)


def _delayed(wave: Wave, more_m: float, carrier: float) -> Wave:
    """Return a waveform with so much more delay, and walls and phases with which what is reflected head on stays; not
    evaluated.
    """
    found = wave.edge.found + np.array((2.0 * carrier * more_m, *np.zeros(COMMON - 1)))
    walls = wave.walls.on(wave.walls.lines - np.array((more_m, 0.0)))
    loudness = wave.loudness._replace(late=wave.loudness.late + more_m)
    return replace(wave, walls=walls, loudness=loudness, edge=replace(wave.edge, found=found), slopes=None)
