"""Paths too straight to tell a wall from its mirror image about them."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.snapshot import Snapshot

STRAIGHTNESS = 0.02
"""A path is straight if it is no wider than this share of its length, or than one step of the range axis: but for
the few pings, no wall's distance then differs by more from that of its mirror image than twice the width."""

_FEW = 0.05
"""Share of the pings, those furthest aside, that make no path less straight: of a mirror image the others explain more
than the 0.95 of the echoes that a right polygon has to."""


def path_half_width(snapshot: Snapshot) -> float | None:
    """Half the width [m] of a path too straight to tell sides, else None."""
    if len(snapshot.positions) == 0:
        return None
    most = _without_few(snapshot.positions)
    _, along = _axis(most)
    length, width = np.ptp(most @ along), np.ptp(most @ (-along[1], along[0]))
    step = snapshot.r_m[1] - snapshot.r_m[0]
    return float(width / 2.0) if width <= max(step, STRAIGHTNESS * length) else None


def path_axis(positions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middle [m] of most of the positions (n, 2) and the unit vector along which these spread most."""
    return _axis(_without_few(positions))


def _without_few(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The positions without the few that are furthest aside of the line along which the others lie."""
    kept = positions
    for _ in range(2):  # those that are aside turn the line, too
        middle, along = _axis(kept)
        aside = np.abs((positions - middle) @ (-along[1], along[0]))
        nearest = np.argsort(aside, kind='stable')[:len(positions) - int(_FEW * len(positions))]
        kept = positions[np.sort(nearest)]
    return kept


def _axis(positions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    middle = positions.mean(axis=0)
    offsets = positions - middle
    _, directions = np.linalg.eigh(offsets.T @ offsets)
    return middle, directions[:, -1]
