"""Walls that are not heard: where a corner's echoes are missing, a silent wall cuts it off.

And corners that are not heard: where a corner has no echoes to miss, any wall may cut it off.
"""

from collections.abc import Generator, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.evidence.paths import corners_of
from polymap_ros.mapping.evidence.power_search import PRICE, SEARCH_ORDER
from polymap_ros.mapping.evidence.proposals import across_corners
from polymap_ros.mapping.evidence.search import FULL_ORDER, Found, Search

_SHARES = (0.15, 0.3, 0.6)
"""Shares of the shorter edge that a silent wall is tried to take away at a corner: what is cut off need not fit."""

_LEAST_CUT, _LEAST_SHARE, _LARGER = 2.5, 0.03, 2.0
"""The shortest wall across a corner that is asked for, in pulse widths (shorter ones are a limit of the method) and as
a share of the polygon's extent, and the factor from one to the next longer one."""


def is_cut_off(search: Search, found: Found) -> Generator[None, None, bool]:
    """Whether a silent wall across a corner, which takes echoes away that were not heard, is worth its price.

    Orders up to `SEARCH_ORDER` tell first which cuts take away what was heard; what is missing may be of higher order.
    """
    prices = (SEARCH_ORDER, -1.0), (FULL_ORDER, PRICE)
    least = [_value(search, found, found.lines, found.reflection, order) + price for order, price in prices]
    for lines, reflected in _cuts(search, found):
        yield
        if all(_value(search, found, lines, reflected, order) > value
               for (order, _), value in zip(prices, least, strict=True)):
            return True
    return False


def unheard_corners(search: Search, found: Found) -> Generator[None, None, dict[int, float]]:
    """Corners near which no echo that was heard has been, and how much of each may be missing [m].

    Corner i is between walls i - 1 and i. A silent wall across it takes nothing away that was heard, and one that
    reflects may send its echoes elsewhere: nothing tells the corner from such a wall.
    """
    least = _value(search, found, found.lines, found.reflection, FULL_ORDER) - PRICE
    _, corners = corners_of(found.lines)
    turn = np.mod(found.lines[:, 1] - np.roll(found.lines[:, 1], 1), 2.0 * np.pi)
    unheard: dict[int, float] = {}
    length = max(_LEAST_CUT * search.data.pulse.width_m, _LEAST_SHARE * float(np.ptp(corners, axis=0).max()))
    asked = set(range(len(corners)))
    while asked:
        depth = 0.5 * length * np.tan(0.5 * turn)
        lines = across_corners(found.lines[:, 1], corners, 0.5, depth)
        for corner in sorted(asked):
            yield
            cut, reflected = _with_silent(found, lines[corner])
            if _is_beyond(search, lines[corner]) and _value(search, found, cut, reflected, FULL_ORDER) > least:
                unheard[corner] = float(depth[corner])
            else:
                asked.remove(corner)
        length *= _LARGER
    return unheard


def _value(
    search: Search, found: Found, lines: NDArray[np.float64], reflection: NDArray[np.float64], order: int
) -> float:
    """Log likelihood of other walls with what else was found; -inf where they bound no polygon."""
    if found.wave is None:
        with np.errstate(divide='ignore'):
            return search.power(found.model.with_lines(lines, 2.0 * np.log(reflection)), order)
    wave = search.wave.evaluate(lines, reflection, found.wave.phase, order, False)
    return -np.inf if wave is None else wave.value


def _cuts(search: Search, found: Found) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Lines and reflection coefficients with a silent wall across a corner, beyond all pings."""
    walls = found.lines
    _, corners = corners_of(walls)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    turn = np.mod(walls[:, 1] - np.roll(walls[:, 1], 1), 2.0 * np.pi)
    depth = np.minimum(lengths, np.roll(lengths, 1)) * np.sin(0.5 * turn)  # that takes all of the shorter edge away
    for share in _SHARES:
        for r, theta in across_corners(walls[:, 1], corners, 0.5, share * depth):
            if _is_beyond(search, (r, theta)):
                yield _with_silent(found, (r, theta))


def _is_beyond(search: Search, line: Sequence[float]) -> bool:
    """Whether all pings are on the near side of a line."""
    return bool(line[0] > np.max(search.data.positions @ (np.cos(line[1]), np.sin(line[1]))))


def _with_silent(found: Found, line: Sequence[float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lines, sorted by theta, and reflection coefficients with a wall more that reflects nothing."""
    lines = np.vstack((found.lines, line))
    order = np.argsort(lines[:, 1], kind='stable')
    return np.ascontiguousarray(lines[order]), np.append(found.reflection, 0.0)[order]
