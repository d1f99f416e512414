"""The closest range rho of a ping: the first peak of its envelope that stands out."""

import numpy as np
from numpy.typing import NDArray

RELATIVE_THRESHOLD = 0.3
"""A peak counts from this share of the strongest one. Echoes of a lossless plate add up, so that the closest wall
may well be half as strong as a later range; side lobes of a rectangular pulse reach 0.22."""

NOISE_FACTOR = 3.0
"""... and from this multiple of the envelope's median, which is noise where a ping holds mostly noise: a Rayleigh
variable exceeds three medians with a probability of 2e-3."""


def closest_range(envelope: NDArray[np.floating], step_m: float, blanking_m: float = 0.0) -> float:
    """Closest range rho_i [m] by peak detection on the envelope.

    Parameters
    ----------
    envelope : ndarray, shape (n_ranges,)
        e_i(r) on the axis 0, step, 2 step, ...
    step_m : float
        Step of the range axis [m].
    blanking_m : float
        Peaks nearer than this are left out [m].

    Returns
    -------
    float
        Range of the first local maximum above the threshold, refined by a parabola; nan if there is none.
    """
    first = max(1, int(np.ceil(blanking_m / step_m - 1e-9)))
    e = np.asarray(envelope, dtype=float)
    if len(e) < first + 2:
        return float('nan')
    threshold = max(RELATIVE_THRESHOLD * e[first:].max(), NOISE_FACTOR * float(np.median(e[first:])))
    middle = e[first:-1]
    peaks = np.flatnonzero((middle >= threshold) & (middle > e[first - 1:-2]) & (middle >= e[first + 1:]))
    if len(peaks) == 0:
        return float('nan')
    at = first + int(peaks[0])
    left, top, right = e[at - 1:at + 2]
    return float(step_m * (at + 0.5 * (left - right) / (left - 2.0 * top + right)))
