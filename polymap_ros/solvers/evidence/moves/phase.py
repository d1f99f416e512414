"""Reflections that turn the phase by less than makes the echoes disagree: alike at all walls, then each by its own."""

from dataclasses import replace

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.louder import hear_louder
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import (
    ALL_EXPLAINED,
    EDGE_MISFIT,
    EDGE_PRICE,
    EXPLAINED,
    FULL_ORDER,
    LAW_WORTH,
    PHASED,
)
from polymap_ros.solvers.evidence.waveform import Wave


def turn_phase(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with phases that reflections turn, where these are worth clearly more; first those common to
    all walls, then each wall's own.
    """
    wave = standing.wave
    if ground.edges_are_real or wave.edge.by_wall or standing.explained < PHASED:
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


def turn_law(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform by another law of phases, where that explains all, with what device and medium do beside.

    By a pulse of narrow band a law that is wrong explains much, with walls that are a quarter of a cycle off.
    """
    if standing.explained < PHASED:
        return None
    for law in ground.edges:
        if law.law is standing.wave.edge.law:
            continue
        ground.checkpoint()
        turned = ground.aligned(standing.power, law.freed() if len(law.law) else law)
        if turned is None:
            continue
        louder = hear_louder(ground, Standing(standing.power, turned, ground.explained(turned))) or turned
        if louder.value > LAW_WORTH * standing.wave.value and ground.explained(louder) > ALL_EXPLAINED:
            return louder
    return None
