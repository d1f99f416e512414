"""What a move of the waveform starts from."""

from typing import NamedTuple

from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.waveform import Wave


class Standing(NamedTuple):
    """A waveform, the power that led to it, and the share of the echoes that it explains."""

    power: Power
    wave: Wave
    explained: float
