"""Soundings as arrays and back, for a saved state."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.mapping.sounding import Sounding


def packed_soundings(soundings: Sequence[Sounding], n_ranges: int) -> dict[str, NDArray[np.generic]]:
    """All soundings as arrays; the envelopes follow from the echoes."""
    return {
        'stamps_ns': np.array([sounding.stamp_ns for sounding in soundings], np.int64),
        'places': np.array([(each.x, each.y, each.rho) for each in soundings], dtype=float).reshape(-1, 3),
        'echoes': np.array([sounding.echo for sounding in soundings], np.complex64).reshape(-1, n_ranges),
    }


def unpacked_soundings(state: dict[str, NDArray[np.generic]], n_ranges: int) -> list[Sounding]:
    """The soundings that `packed_soundings` packed."""
    stamps, places = np.asarray(state['stamps_ns'], np.int64), np.asarray(state['places'], float)
    echoes = np.asarray(state['echoes'], np.complex64)
    n = len(stamps)
    if stamps.shape != (n,) or places.shape != (n, 3) or echoes.shape != (n, n_ranges):
        raise StateError(f'{n} soundings do not match {places.shape} places and {echoes.shape} echoes')
    if not (np.all(np.isfinite(places[:, :2])) and np.all(np.isfinite(echoes))):
        raise StateError('the soundings are not finite')
    return [Sounding(stamp_ns, x, y, echo, np.abs(echo), rho)
            for stamp_ns, (x, y, rho), echo in zip(stamps.tolist(), places.tolist(), echoes, strict=True)]
