"""Pings as arrays and back, for a saved state."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.ping import LOUDEST, Ping
from polymap_ros.errors import StateError


def packed_pings(pings: Sequence[Ping]) -> dict[str, NDArray[np.generic]]:
    """All that is in the pings, as arrays; those of different lengths may be mixed."""
    return {
        'ns': np.array([ping.stamp_ns for ping in pings], np.int64),
        'times': np.array(
            [(ping.period_s, ping.t0_s, ping.range_min_m, ping.range_max_m) for ping in pings]).reshape(-1, 4),
        'frames': np.array([ping.frame_id for ping in pings], dtype=str),
        'ends': np.cumsum([ping.samples.size for ping in pings], dtype=np.int64),
        'samples': np.concatenate([np.empty(0), *(ping.samples for ping in pings)]),
    }


def unpacked_pings(state: Mapping[str, NDArray[np.generic]], prefix: str) -> list[Ping]:
    """The pings that `packed_pings` packed, whose arrays' names begin with `prefix`."""
    samples, times = np.asarray(state[f'{prefix}samples'], float), np.asarray(state[f'{prefix}times'], float)
    starts = np.concatenate((np.zeros(1, np.int64), state[f'{prefix}ends']))
    if np.any(np.diff(starts) <= 0) or starts[-1] != samples.size:
        raise StateError(f'the waiting pings do not share {samples.size} samples')
    if not (np.all(np.abs(samples) <= LOUDEST) and np.all(np.isfinite(times)) and np.all(times[:, 0] > 0.0)):
        raise StateError('the waiting pings are not finite')
    rows = zip(state[f'{prefix}ns'].tolist(), times.tolist(), state[f'{prefix}frames'].tolist(),
               starts[:-1].tolist(), starts[1:].tolist(), strict=True)
    return [Ping(stamp_ns, samples[start:end].copy(), period_s, t0_s, first_m, last_m, frame)
            for stamp_ns, (period_s, t0_s, first_m, last_m), frame, start, end in rows]
