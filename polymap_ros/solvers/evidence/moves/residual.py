"""A wall too few: lines proposed by what the waveform leaves unexplained."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.edge_phase import EdgePhase
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.exchange import convex_refined, with_line
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.proposals import strongest_chords
from polymap_ros.solvers.evidence.tuning import CHORDS, DIFFERENT, FULL_ORDER, PRICE, REFINED, SEARCH_ORDER
from polymap_ros.solvers.evidence.waveform import Wave


def add_from_residual(ground: Ground, standing: Standing) -> Wave | None:
    """Return the best waveform with one edge more, proposed by what is left of the echoes."""
    wave = standing.wave
    if len(wave.walls) >= ground.max_edges:
        return None
    left = dataclasses.replace(ground.data, power=ground.wave.residual_power(wave, FULL_ORDER))
    expected = np.maximum(np.mean(left.power, axis=0, keepdims=True), 1.0)
    base = base_of(ground, standing.power, wave)
    lines = strongest_chords(left, expected, base.strength, wave.walls.lines, CHORDS)
    return with_another(ground, base, lines, ground.worth(wave), wave.edge)


def base_of(ground: Ground, like: Power, wave: Wave) -> Power:
    """Return the walls of a waveform under the likelihood of power."""
    fitted = ground.power.fitted(wave.walls, like, SEARCH_ORDER)
    return like.with_walls(wave.walls) if fitted is None else fitted


def with_another(
    ground: Ground, base: Power, lines: NDArray[np.float64], worth: float, edge: EdgePhase
) -> Wave | None:
    """Return the first waveform with one of `lines` added to a base, the best by power first, that is worth more."""
    score = ground.power.value(base.walls, base, SEARCH_ORDER)
    refined = []
    for line in lines:
        trial = with_line(ground, base.walls, line)
        if trial is None or len(trial) > ground.max_edges:
            continue
        ground.checkpoint()
        rough = convex_refined(ground, trial, base, 2, 3)
        fine = None if rough is None else convex_refined(ground, rough.walls, rough, SEARCH_ORDER, 4)
        if fine is not None:
            refined.append(fine)
    for power in sorted(refined, key=lambda each: -each.value)[:REFINED]:
        if power.value < score + PRICE:
            break
        ground.checkpoint()
        full = convex_refined(ground, power.walls, power, FULL_ORDER, 6)
        more = None if full is None else ground.aligned(full, edge)
        if more is not None and ground.worth(more) > worth + DIFFERENT:
            return more
    return None
