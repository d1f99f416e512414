"""What is known of walls whose corners' echoes were taken out: these follow the walls, and so does what is left.

The walls stand where the gradient g(x, c) of the log likelihood by the walls x is 0, what corners return being that of
the walls c = x. If x moves, so does what is taken out: g changes by -(I - C) dx, I being the information of the images
alone and C the derivative of g by c. Scores of covariance I then leave the walls uncertain by (I - C)^-1 I (I - C)^-T,
which is a fifth to a half more than I^-1, and up to twice (nine plates of six to eight edges, even seeds).
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.corner_echoes import without_corner_echoes
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.likelihood import covariance_of, gradient_of
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

_ONE_OF = 2
"""One ping of so many tells how the gradient changes: it is a mean over places."""


def corner_slopes(whole: EchoData, wave: Wave, information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return C (3 n, 3 n): how the gradient changes as what corners return does.

    Parameters
    ----------
    whole : EchoData
        What was heard, with what corners return.
    wave : Wave
        The walls found without that.
    information : ndarray, shape (3 n, 3 n)
        That of the images.
    """
    few, here = whole.every(_ONE_OF), wave.of_pings(slice(None, None, _ONE_OF))
    deviations = np.sqrt(np.diag(covariance_of(information)))
    numbers = 2 * len(wave.walls)  # what corners return hangs on their places; coefficients are known as well without
    slopes = np.zeros_like(information)
    start = _gradient(few, here, here)
    for number in range(numbers):
        step = np.zeros(len(information))
        step[number] = deviations[number]
        moved = _gradient(few, here, here.with_walls(here.walls.moved(step)))
        slopes[:, number] = _ONE_OF * (moved - start) / deviations[number]
    return slopes


def _gradient(data: EchoData, wave: Wave, corners: Wave) -> NDArray[np.float64]:
    """Return the gradient by a waveform's walls where what others' corners return is taken out; 0 where none bound."""
    heard = WaveformLikelihood(without_corner_echoes(data, corners)).evaluate(wave.walls, wave, FULL_ORDER, derive=True)
    return np.zeros(3 * len(wave.walls)) if heard is None else gradient_of(heard)
