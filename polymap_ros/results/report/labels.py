"""Where the labels of a drawing go, so that they can be read beside each other."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SIZE = 20.0
"""Height of the letters on the narrowest screen, in units of the drawing; elsewhere they are smaller."""
_WIDTH, _LINE = 0.56, 1.15
"""Of a letter and from line to line, in heights of a letter."""
_GAP = 3.0
"""To the left and right of a label, in units of the drawing."""
_SLOPE = 0.38
"""A label whose direction from its anchor is steeper than this is centred above or below it."""


class Box(NamedTuple):
    """A rectangle, y downwards."""

    left: float
    top: float
    right: float
    bottom: float

    def overlap(self, other: 'Box') -> float:
        """Return the area that two boxes share."""
        width = min(self.right, other.right) - max(self.left, other.left)
        height = min(self.bottom, other.bottom) - max(self.top, other.top)
        return max(width, 0.0) * max(height, 0.0)


class Place(NamedTuple):
    """An anchor, and the direction from it in which the text lies."""

    x: float
    y: float
    dx: float
    dy: float

    @property
    def anchor(self) -> str:
        """Return SVG's text-anchor."""
        return 'middle' if abs(self.dx) < _SLOPE else 'start' if self.dx > 0.0 else 'end'

    def baseline_em(self, lines: int) -> float:
        """Return how far below the anchor the first line's baseline is, in heights of a letter."""
        above = _LINE * (lines - 1)
        return 0.35 - 0.5 * above + self.dy * (0.5 * above + 0.4)

    def box(self, lines: Sequence[str]) -> Box:
        """Return what the text covers."""
        width = _WIDTH * SIZE * max(map(len, lines))
        left = {'start': 0.0, 'middle': -0.5, 'end': -1.0}[self.anchor] * width + self.x
        first = self.y + SIZE * self.baseline_em(len(lines))
        return Box(left - _GAP, first - 0.8 * SIZE, left + width + _GAP,
                   first + SIZE * (_LINE * (len(lines) - 1) + 0.2))


def best(
    places: Iterable[Place], lines: Sequence[str], taken: Sequence[Box], ink: NDArray[np.float64]
) -> tuple[Place, Box]:
    """Choose the first place where a label covers nothing, or the one where it covers least.

    Parameters
    ----------
    places : iterable of Place
        The favourite first.
    lines : sequence of str
        The text.
    taken : sequence of Box
        Labels that have their places.
    ink : ndarray, shape (n, 2)
        Points of lines that had better not be covered.
    """
    def covered(place: Place) -> float:
        box = place.box(lines)
        inside = np.all((ink > (box.left, box.top)) & (ink < (box.right, box.bottom)), axis=1)
        return sum(map(box.overlap, taken)) + 20.0 * float(np.sum(inside))

    found = min(places, key=covered)
    return found, found.box(lines)
