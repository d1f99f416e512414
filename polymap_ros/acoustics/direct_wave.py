"""Time zero from the direct wave: when the receiver hears the emitter beside it."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.pulse import Pulse

_EARLY = 0.5
"""The direct wave is the first arrival of at least this share of the strongest: ringing and body come later."""


def direct_wave_t0(
    common: NDArray[np.floating], period_s: float, pulse: Pulse, travel_s: float = 0.0
) -> float | None:
    """Time of the first sample after emission [s], from what all pings have in common.

    Parameters
    ----------
    common : ndarray, shape (n,)
        Of `common_part`.
    period_s : float
        Sample period [s].
    pulse : Pulse
        What was emitted.
    travel_s : float
        Time from the emitter to the receiver [s].

    Returns
    -------
    float or None
        None where nothing is in common.
    """
    if not np.any(common):
        return None
    import scipy.signal  # takes as long to load as all the rest of scipy that is used

    # In full: the pulse may have begun before the first sample.
    wave = pulse.samples(period_s)
    envelope = np.abs(scipy.signal.hilbert(np.correlate(common, wave, mode='full')))
    at = scipy.signal.find_peaks(envelope, height=_EARLY * float(envelope.max()))[0]
    if len(at) == 0:
        return None
    left, top, right = envelope[at[0] - 1:at[0] + 2]
    first = at[0] + 0.5 * (left - right) / (left - 2.0 * top + right) - (len(wave) - 1)
    return float(travel_s - first * period_s)
