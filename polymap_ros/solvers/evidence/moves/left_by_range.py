"""What a waveform leaves, in phase and by range: what a foot of one more wall would be worth."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.waveform import Wave

_FINE_PER_CYCLE = 16.0
"""Steps to a cycle of range: half of one turns the phase by 11 degrees."""


def fine_step_m(ground: Ground) -> float:
    """Return the step of range [m] of `left_by_range`."""
    return ground.cycle_m / _FINE_PER_CYCLE


def left_by_range(ground: Ground, wave: Wave) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return x = A d^-p Re[exp(-j phi) c(d)] (N, m) of what is left, and y = d^-2p (m,), at multiples d of the step."""
    data = ground.data
    left = ground.wave.left_without_carrier(wave)
    ranges = np.arange(0.0, data.range_max_m, fine_step_m(ground))
    cells = data.cell_m * np.arange(left.shape[1])
    falloff = np.maximum(ranges, ground.cycle_m) ** -data.spreading
    turn = np.exp(1j * (2.0 * data.pulse.carrier * ranges - wave.phase))
    x = np.empty((len(left), len(ranges)), np.float32)
    for ping, row in enumerate(left):
        envelope = np.interp(ranges, cells, row.real) + 1j * np.interp(ranges, cells, row.imag)
        x[ping] = wave.amplitudes[ping] * falloff * np.real(turn * envelope)
    return x, falloff**2
