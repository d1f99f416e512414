"""Soundings as arrays and back, for a saved state."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import FARTHEST_M, Pose
from polymap_ros.hearing.odometer import SUMS, odometer_sums
from polymap_ros.hearing.sounding import Sounding

_COLUMNS, _COLUMNS_OF_3 = 9 + SUMS, 6
"""Numbers of a place, and those in a state of version 3."""


def packed_soundings(soundings: Sequence[Sounding]) -> dict[str, NDArray[np.generic]]:
    """All soundings as arrays; the envelopes follow from the echoes."""
    return {
        'stamps_ns': np.array([sounding.stamp_ns for sounding in soundings], np.int64),
        'places': np.array([(each.x, each.y, each.rho, each.noise, each.confidence, each.yaw, each.mount.x,
                             each.mount.y, each.mount.yaw, *each.way) for each in soundings],
                           dtype=float).reshape(-1, _COLUMNS),
        'echoes': np.array([each.echo for each in soundings] or np.empty((0, 0)), np.complex64),
    }


def unpacked_soundings(state: dict[str, NDArray[np.generic]], n_fine: int, fold: int) -> list[Sounding]:
    """The soundings that `packed_soundings` packed, with echoes of `n_fine` ranges and envelopes of every `fold`-th."""
    stamps, places = np.asarray(state['stamps_ns'], np.int64), np.asarray(state['places'], float)
    echoes = np.asarray(state['echoes'], np.complex64)
    n = len(stamps)
    if places.ndim == 2 and places.shape[1] == _COLUMNS_OF_3:
        places = np.hstack((places, np.zeros((n, _COLUMNS - _COLUMNS_OF_3))))
        places[:, -SUMS:] = odometer_sums(places[:, [0, 1, 5]])  # as far as the pings tell that were kept
    if stamps.shape != (n,) or places.shape != (n, _COLUMNS) or echoes.shape != (n, n_fine if n else 0):
        raise StateError(f'{n} soundings do not match {places.shape} places and {echoes.shape} echoes')
    near = np.all(np.abs(places[:, :2]) <= FARTHEST_M)
    loud = np.all((places[:, 3] > 0.0) & np.isfinite(places[:, 3]))
    if not (near and loud and np.all(np.isfinite(places[:, 4:])) and np.all(np.isfinite(echoes))):
        raise StateError('the soundings are not finite')
    return [Sounding(stamp_ns, x, y, echo, np.abs(echo[::fold]), rho, noise, confidence, yaw, Pose(*mount), way)
            for stamp_ns, (x, y, rho, noise, confidence, yaw, *mount), way, echo
            in zip(stamps.tolist(), places[:, :-SUMS].tolist(), places[:, -SUMS:], echoes, strict=True)]
