"""Reflections that turn the phase by less than makes the echoes disagree: alike at all walls, then each by its own."""

from dataclasses import replace

from polymap_ros.solvers.evidence.edge_phase import REAL
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import (
    ALL_EXPLAINED,
    EDGE_MISFIT,
    EDGE_PRICE,
    EXPLAINED,
    FULL_ORDER,
    PHASED,
)
from polymap_ros.solvers.evidence.waveform import Wave


def turn_phase(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with phases that reflections turn, where these are worth clearly more; first those common to
    all walls, then each wall's own.
    """
    wave = standing.wave
    known = ground.edges == (REAL,) or wave.edge.by_wall
    if known or standing.explained < PHASED:
        return None
    least = max(EDGE_PRICE, EDGE_MISFIT * wave.value)
    for by_wall in (False, True):
        edge = wave.edge.freed(by_wall)
        if (wave.edge.free and not by_wall) or ground.wave.gained(wave, edge, FULL_ORDER) < least:
            continue
        ground.checkpoint()
        turned = ground.wave.refine(replace(wave, edge=edge, slopes=None), FULL_ORDER)
        if turned is not None and turned.value > wave.value + least:
            # It may only have led the walls on.
            plain = ground.wave.refine(replace(turned, edge=wave.edge, slopes=None), FULL_ORDER)
            better = plain if plain is not None and plain.value > turned.value - least else turned
            # Where much was left, it may be a wall that is wrong: then phases do not explain all of it.
            if standing.explained >= EXPLAINED or ground.explained(better) > ALL_EXPLAINED:
                return better
    return None
