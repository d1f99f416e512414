"""Walls that are not heard: where a corner's echoes are missing, a silent wall cuts it off.

And corners that are not heard: where a corner has no echoes to miss, any wall may cut it off.
"""

from collections.abc import Iterator

import numpy as np

from polymap_ros.geometry.lines import away_from
from polymap_ros.geometry.outline import corners_of
from polymap_ros.solvers.evidence.proposals import across_corners
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tuning import FULL_ORDER, PRICE, SEARCH_ORDER
from polymap_ros.solvers.evidence.walls import Walls

CUT_SHARES = (0.15, 0.3, 0.6)
"""Shares of the shorter edge that a silent wall is tried to take away at a corner: what is cut off need not fit."""

_LEAST_CUT, _LEAST_SHARE, _LARGER = 2.5, 0.03, 2.0
"""The shortest wall across a corner that is asked for, in pulse widths (shorter ones are a limit of the method) and as
a share of the polygon's extent, and the factor from one to the next longer one."""


def is_cut_off(search: Search, found: Found) -> bool:
    """Whether a silent wall across a corner, which takes echoes away that were not heard, is worth its price.

    Orders up to `SEARCH_ORDER` tell first which cuts take away what was heard; what is missing may be of higher order.
    """
    prices = (SEARCH_ORDER, -1.0), (FULL_ORDER, PRICE)
    least = [_value(search, found, found.walls, order) + price for order, price in prices]
    for walls in silent_cuts(search, found):
        search.checkpoint()
        if all(_value(search, found, walls, order) > value
               for (order, _), value in zip(prices, least, strict=True)):
            return True
    return False


def unheard_corners(search: Search, found: Found) -> dict[int, float]:
    """Corners near which no echo that was heard has been, and how much of each may be missing [m].

    Corner i is between walls i - 1 and i. A silent wall across it takes nothing away that was heard, and one that
    reflects may send its echoes elsewhere: nothing tells the corner from such a wall.
    """
    least = _value(search, found, found.walls, FULL_ORDER) - PRICE
    _, corners = corners_of(found.lines)
    turn = found.walls.turns
    unheard: dict[int, float] = {}
    length = max(_LEAST_CUT * search.data.pulse.width_m, _LEAST_SHARE * float(np.ptp(corners, axis=0).max()))
    asked = set(np.flatnonzero(turn < np.pi).tolist())  # a corner that points inwards cannot be cut off
    while asked:
        depth = 0.5 * length * np.tan(0.5 * turn)
        lines = across_corners(found.lines[:, 1], corners, 0.5, depth)
        for corner in sorted(asked):
            search.checkpoint()
            cut = found.walls.inserted(corner, lines[corner], 0.0)
            if _holds_pings(search, cut, corner) and _value(search, found, cut, FULL_ORDER) > least:
                unheard[corner] = float(depth[corner])
            else:
                asked.remove(corner)
        length *= _LARGER
    return unheard


def _value(search: Search, found: Found, walls: Walls, order: int) -> float:
    """Log likelihood of other walls with what else was found; -inf where they bound no polygon."""
    if found.wave is None:
        return search.power.value(walls, found.power, order)
    wave = search.wave.evaluate(walls, found.wave, order)
    return -np.inf if wave is None else wave.value


def silent_cuts(search: Search, found: Found) -> Iterator[Walls]:
    """The walls with a silent one across a corner, beyond all pings."""
    lines = found.lines
    _, corners = corners_of(lines)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    turn = found.walls.turns
    depth = np.minimum(lengths, np.roll(lengths, 1)) * np.sin(0.5 * turn)  # that takes all of the shorter edge away
    for share in CUT_SHARES:
        for corner, line in enumerate(across_corners(lines[:, 1], corners, 0.5, share * depth)):
            cut = found.walls.inserted(corner, line, 0.0)
            if turn[corner] < np.pi and _holds_pings(search, cut, corner):
                yield cut


def _holds_pings(search: Search, cut: Walls, at: int) -> bool:
    """Whether no ping is in the triangle that a line across a corner, wall `at`, cuts off."""
    sides = cut.outline[[at - 1, at, (at + 1) % cut.ring]]
    away = np.array([away_from(side, search.data.positions) for side in sides])
    return not bool(np.any((away[0] > 0.0) & (away[1] <= 0.0) & (away[2] > 0.0)))
