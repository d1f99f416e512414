"""How strong the noise is where echoes are: by what is heard before the first one.

A ping tells its noise by the frequencies that its pulse does not reach (`acoustics.noise`). Noise that is not white is
stronger or weaker at those that it does. What is heard before the first echo is noise in the pulse's band, of few cells
in one ping, and of enough in all.
"""

import numpy as np
from numpy.typing import NDArray

_BEFORE_WIDTHS = 2.0
"""Widths of the pulse before the first echo that are left out: it begins there."""

_QUANTILE = 0.25
"""Of cells before the first echo: some hold an echo of another mode, or of a wall that reflects little."""

_OTHER, _DEVIATIONS = 0.1, 3.0
"""Share by which the noise differs from what it counts as, and standard deviations beyond, from which it does. Of white
noise (plates, air, walls of 0.2, even seeds) it is 0.95 to 1.12 times that, with echoes of S0 before the first of A0
1.1 to 1.6; of noise of which a sample passes 0.9 on to the next, 2.3 to 2.6."""


def early_noise(
    power: NDArray[np.float64], first_cell: int, first_m: NDArray[np.float64], cell_m: float, width_m: float
) -> float:
    """Return the noise's power over what it counts as, 1 where it is not clearly another.

    Parameters
    ----------
    power : ndarray, shape (N, n_cells)
        As in `EchoData`: exponential with mean 1 where there is noise only.
    first_cell : int
        Cells before this are blanked.
    first_m : ndarray, shape (N,)
        Range of each ping's first echo [m]; nan where none is heard.
    cell_m, width_m : float
        Step of the cells, and the pulse's width, which is one independent cell [m].
    """
    cells_per_width = width_m / cell_m
    last = np.maximum(before_echoes(first_m, cell_m, width_m), first_cell)
    early = np.concatenate([row[first_cell:end] for row, end in zip(power, last, strict=True)])
    if len(early) == 0:
        return 1.0
    level = float(np.quantile(early, _QUANTILE)) / -np.log(1.0 - _QUANTILE)
    # Of an exponential's quantile, over its mean.
    deviation = np.sqrt(_QUANTILE / (1.0 - _QUANTILE) * cells_per_width / len(early)) / -np.log(1.0 - _QUANTILE)
    return level if abs(level - 1.0) > _OTHER + _DEVIATIONS * level * deviation else 1.0


def before_echoes(first_m: NDArray[np.float64], step_m: float, width_m: float) -> NDArray[np.int64]:
    """Return how many steps of range are before each ping's first echo, and its rise (N,)."""
    return np.asarray((np.nan_to_num(first_m) - _BEFORE_WIDTHS * width_m) / step_m).astype(np.int64)
