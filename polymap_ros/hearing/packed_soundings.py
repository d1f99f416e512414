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
        'heard_m': np.array([each.heard_m for each in soundings], float),
        'echoes': np.array([each.echo for each in soundings] or np.empty((0, 0)), np.complex64),
    }


def unpacked_soundings(state: dict[str, NDArray[np.generic]], n_fine: int, fold: int) -> list[Sounding]:
    """The soundings that `packed_soundings` packed, with echoes of `n_fine` ranges and envelopes of every `fold`-th."""
    stamps, places = np.asarray(state['stamps_ns'], np.int64), np.asarray(state['places'], float)
    echoes = np.asarray(state['echoes'], np.complex64)
    n = len(stamps)
    heard_m = np.asarray(state.get('heard_m', np.full(n, np.inf)), float)  # version 3 does not tell
    if places.ndim == 2 and places.shape[1] == _COLUMNS_OF_3:
        places = np.hstack((places, np.zeros((n, _COLUMNS - _COLUMNS_OF_3))))
        places[:, -SUMS:] = odometer_sums(places[:, [0, 1, 5]])  # as far as the pings tell that were kept
    shapes = stamps.shape, heard_m.shape, places.shape, echoes.shape
    if shapes != ((n,), (n,), (n, _COLUMNS), (n, n_fine if n else 0)):
        raise StateError(f'{n} soundings do not match {places.shape} places and {echoes.shape} echoes')
    near = np.all(np.abs(places[:, :2]) <= FARTHEST_M)
    loud = np.all((places[:, 3] > 0.0) & np.isfinite(places[:, 3]))
    finite = all(np.all(np.isfinite(each)) for each in (places[:, 4:], echoes))
    if not (near and loud and finite and np.all(heard_m > 0.0)):
        raise StateError('the soundings are not finite')
    return [Sounding(stamp_ns, x, y, echo, np.abs(echo[::fold]), rho, noise, confidence, end_m, yaw, Pose(*mount), way)
            for stamp_ns, (x, y, rho, noise, confidence, yaw, *mount), way, echo, end_m
            in zip(stamps.tolist(), places[:, :-SUMS].tolist(), places[:, -SUMS:], echoes, heard_m.tolist(),
                   strict=True)]
