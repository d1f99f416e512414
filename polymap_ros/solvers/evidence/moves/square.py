"""Right angles that are nearly right: made so, together, where the waveform is worth more then."""

from dataclasses import replace

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.square_walls import SquareWalls, free, squared
from polymap_ros.solvers.evidence.tuning import DIFFERENT, FULL_ORDER
from polymap_ros.solvers.evidence.waveform import Wave

_ALONG = 10
"""Steps of the climb along the ridge, at most."""


def square_up(ground: Ground, standing: Standing) -> Wave | None:
    """Return the waveform with right angles for those that nearly are, if it is worth more."""
    return on_ridge(ground, standing.wave)


def on_ridge(ground: Ground, wave: Wave) -> Wave | None:
    """Return a refined waveform with right angles for those that nearly are, if it is worth more."""
    square = None if isinstance(wave.walls, SquareWalls) else squared(wave.walls)
    if square is None:
        return None
    ground.checkpoint()
    best = ground.wave.refine(replace(wave, walls=square, slopes=None), FULL_ORDER, _ALONG)
    if best is None or best.value < wave.value + DIFFERENT:
        return None
    return ground.wave.evaluate(free(best.walls), best, FULL_ORDER, derive=True)
