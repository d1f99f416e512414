"""Floor and ceiling: their images of the emitter, which make every path over walls another, longer one.

A path over walls alone is flat; that which also meets floor and ceiling is its image, as long as the flat one with a
height between its ends: the planes are perpendicular to all walls, so that the reflections may come in any order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_SAME_M = 1e-9
"""Heights closer than this are one."""


@dataclass(frozen=True, eq=False)
class Storey:
    """Horizontal planes that reflect: none, one, or floor and ceiling, in this order.

    Parameters
    ----------
    height_m : ndarray, shape (k,)
        How far they are from the emitter [m], above 0: the floor below it, the ceiling above it.
    reflection : ndarray, shape (k,)
        Their signed coefficients.
    """

    height_m: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    reflection: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        """Return the number of planes."""
        return len(self.height_m)

    @property
    def planes(self) -> list[tuple[str, float, float]]:
        """Name, height [m] and coefficient of each."""
        return list(zip(('floor', 'ceiling'), self.height_m.tolist(), self.reflection.tolist(), strict=False))

    def images(self, order: int, level: bool = True) -> NDArray[np.float64]:
        """Return the emitter's images by up to so many reflections from the planes, the emitter itself first.

        Returns
        -------
        ndarray, shape (m, 3)
            How high each is above the emitter [m], the product of its coefficients, and its number of reflections. Of
            one height above and below, which is the same path for a receiver that is `level` with the emitter, there is
            one row, of both together.
        """
        rows = [(0.0, 1.0, 0)]
        for first in range(len(self)):
            z, strength, plane = 0.0, 1.0, first
            for bounces in range(1, order + 1):
                below = plane == 0
                z = (-2.0 if below else 2.0) * float(self.height_m[plane]) - z
                strength *= float(self.reflection[plane])
                rows.append((z, strength, bounces))
                if len(self) == 1:
                    break
                plane = 1 - plane
        return np.array(_together(rows) if level else rows)


def _together(rows: Sequence[tuple[float, float, int]]) -> list[tuple[float, float, int]]:
    """Return the rows, those as far above as others are below, by as many reflections, added to them."""
    kept: list[tuple[float, float, int]] = []
    for z, strength, bounces in rows:
        for k, (other, more, as_many) in enumerate(kept):
            if bounces == as_many > 0 and abs(abs(z) - abs(other)) < _SAME_M:
                kept[k] = other, more + strength, as_many
                break
        else:
            kept.append((z, strength, bounces))
    return kept
