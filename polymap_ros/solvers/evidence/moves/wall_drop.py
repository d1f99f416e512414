"""A wall too many: the others, refitted without it, are worth more."""

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.tuning import FULL_ORDER, OBVIOUS, PRICE
from polymap_ros.solvers.evidence.waveform import Wave


def drop_wall(ground: Ground, standing: Standing) -> Wave | None:
    """Return the best waveform with one edge fewer, if it is worth more."""
    wave, best = standing.wave, None
    for wall in range(len(wave.walls)):
        fewer = ground.wave.evaluate(wave.walls.without(wall), wave, FULL_ORDER)
        if fewer is None or fewer.value + PRICE < wave.value - OBVIOUS:
            continue
        ground.checkpoint()
        fewer = ground.wave.refine(fewer, FULL_ORDER)
        if fewer is not None and (best is None or fewer.value > best.value):
            best = fewer
    return best if best is not None and ground.worth(best) > ground.worth(wave) else None
