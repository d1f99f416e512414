"""What all pings have in common: the direct wave, the robot's own body, the ceiling."""

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

_LOW_QUANTILE = 0.2
_PRESENT = 0.5
"""What is in common is in four of five pings with at least half of its strength: a wall's echo is not, not even where
the robot drives along it for most of the way, nor is the median of what differs from ping to ping."""

_STRONG = 4.0
"""... and it is so many times as strong, somewhere in one stretch, as what differs from ping to ping: the echo that
goes to and fro between two parallel walls has the same length everywhere, too, and is no stronger than others."""

_GAP = 1
"""A stretch goes on over twice so many half windows in which it is too weak."""

_GAIN_LIMITS = 0.5, 2.0
"""Between these a ping may hold what is common weaker or stronger than the median ping."""


def common_part(samples: NDArray[np.floating], window: int) -> NDArray[np.float64]:
    """What pings taken at different places have in common, sample by sample.

    The median over the pings, in stretches where at least `_PRESENT` of it is in all but the lowest fifth of them, and
    where it is strong, else 0. How much of it is in a ping is its projection there, over a sliding window.

    Parameters
    ----------
    samples : ndarray, shape (N, n)
        Pings of one length, period and start.
    window : int
        Samples of a pulse.

    Returns
    -------
    ndarray, shape (n,)
    """
    median = np.median(samples, axis=0).astype(float)
    half = max(window // 2, 1)
    energy = _window_sums(median * median, half)
    inside = _window_sums(samples * median, half)
    hops = np.arange(0, len(median), half)
    share = np.divide(inside[:, hops], energy[hops], out=np.zeros((len(samples), len(hops))), where=energy[hops] > 0.0)
    rest = np.median(_window_sums((samples - median) ** 2, half)[:, hops], axis=0)
    present = np.quantile(share, _LOW_QUANTILE, axis=0) > _PRESENT
    stretches, _ = scipy.ndimage.label(scipy.ndimage.binary_dilation(present, iterations=_GAP))
    strong = stretches[present & (energy[hops] > _STRONG**2 * rest)]
    present &= np.isin(stretches, strong[strong > 0])
    common: NDArray[np.float64] = median * np.interp(np.arange(len(median)), hops, present.astype(float))
    return common


def without_common(samples: NDArray[np.floating], common: NDArray[np.float64]) -> NDArray[np.floating]:
    """A ping (n,) less what is common, as strong as it is there."""
    energy = float(common @ common)
    if energy == 0.0:
        return samples
    gain = float(np.clip(samples @ common / energy, *_GAIN_LIMITS))
    less: NDArray[np.floating] = samples - gain * common
    return less


def _window_sums(values: NDArray[np.floating], half: int) -> NDArray[np.float64]:
    """Sums over the last axis from `half` before to `half` after each sample."""
    n = values.shape[-1]
    total = np.concatenate((np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1, dtype=float)), axis=-1)
    index = np.arange(n)
    sums: NDArray[np.float64] = total[..., np.minimum(index + half + 1, n)] - total[..., np.maximum(index - half, 0)]
    return sums
