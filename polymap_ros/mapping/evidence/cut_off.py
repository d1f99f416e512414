"""Walls that are not heard: where a corner's echoes are missing, a silent wall cuts it off."""

from collections.abc import Generator, Iterator

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.evidence.paths import corners_of
from polymap_ros.mapping.evidence.power_search import PRICE, SEARCH_ORDER
from polymap_ros.mapping.evidence.proposals import across_corners
from polymap_ros.mapping.evidence.search import FULL_ORDER, Found, Search

_SHARES = (0.15, 0.3, 0.6)
"""Shares of the shorter edge that a silent wall is tried to take away at a corner: what is cut off need not fit."""


def is_cut_off(search: Search, found: Found) -> Generator[None, None, bool]:
    """Whether a silent wall across a corner, which takes echoes away that were not heard, is worth its price.

    Orders up to `SEARCH_ORDER` tell first which cuts take away what was heard; what is missing may be of higher order.
    """
    prices = (SEARCH_ORDER, -1.0), (FULL_ORDER, PRICE)
    reflection = np.exp(0.5 * found.model.loss) if found.wave is None else found.wave.reflection
    least = [_value(search, found, found.lines, reflection, order) + price for order, price in prices]
    for lines, reflected in _cuts(search, found.lines, reflection):
        yield
        if all(_value(search, found, lines, reflected, order) > value
               for (order, _), value in zip(prices, least, strict=True)):
            return True
    return False


def _value(
    search: Search, found: Found, lines: NDArray[np.float64], reflection: NDArray[np.float64], order: int
) -> float:
    """Log likelihood of other walls with what else was found; -inf where they bound no polygon."""
    if found.wave is None:
        with np.errstate(divide='ignore'):
            return search.power(found.model.with_lines(lines, 2.0 * np.log(reflection)), order)
    wave = search.wave.evaluate(lines, reflection, found.wave.phase, order, False)
    return -np.inf if wave is None else wave.value


def _cuts(
    search: Search, walls: NDArray[np.float64], reflection: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Lines and reflection coefficients with a silent wall across a corner, beyond all pings."""
    _, corners = corners_of(walls)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    turn = np.mod(walls[:, 1] - np.roll(walls[:, 1], 1), 2.0 * np.pi)
    depth = np.minimum(lengths, np.roll(lengths, 1)) * np.sin(0.5 * turn)  # that takes all of the shorter edge away
    for share in _SHARES:
        for r, theta in across_corners(walls[:, 1], corners, 0.5, share * depth):
            if r > np.max(search.data.positions @ (np.cos(theta), np.sin(theta))):
                lines = np.vstack((walls, (r, theta)))
                order = np.argsort(lines[:, 1], kind='stable')
                yield np.ascontiguousarray(lines[order]), np.append(reflection, 0.0)[order]
