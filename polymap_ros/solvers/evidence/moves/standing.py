"""What a move of the waveform starts from, and how it ends."""

from typing import NamedTuple

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.tuning import DIFFERENT, FULL_ORDER, REFINED
from polymap_ros.solvers.evidence.waveform import Wave


class Standing(NamedTuple):
    """A waveform, the power that led to it, and the share of the echoes that it explains."""

    power: Power
    wave: Wave
    explained: float


def better_of(ground: Ground, wave: Wave, trials: list[Wave]) -> Wave | None:
    """Return the first of the best trials that, refined, is another maximum than a waveform's, and a higher one."""
    for trial in sorted(trials, key=lambda each: -each.value)[:REFINED]:
        ground.checkpoint()
        refined = ground.wave.refine(trial, FULL_ORDER)
        if refined is not None and refined.value > wave.value + DIFFERENT:
            return refined
    return None
