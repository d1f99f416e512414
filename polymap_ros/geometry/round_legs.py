"""Legs of paths among walls and circles: where they are reflected, what is left of them, what is in their way."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.jit import kernel

_ROOT_STEPS, STILL_RAD = 40, 1e-10
"""Steps of a root, at most, and what counts as still."""
_GRAZING = 1e-9
"""Nearer to a circle by this share than its radius a leg crosses it."""


@kernel
def way_size(sequence: NDArray[np.int64]) -> int:
    count = 0
    while count < len(sequence) and sequence[count] >= 0:
        count += 1
    return count


@kernel
def over_walls(
    rows: NDArray[np.float64], walls: NDArray[np.int64], x: float, y: float, backwards: bool
) -> tuple[float, float]:
    """Image of a place over walls, the last of which is the farthest from it unless they are taken backwards."""
    size = way_size(walls)
    for level in range(size):
        row = rows[walls[size - 1 - level if backwards else level]]
        away = 2.0 * (row[2] - x * row[0] - y * row[1])
        x, y = x + away * row[0], y + away * row[1]
    return x, y


@kernel
def reflected_at(
    circle: NDArray[np.float64], ax: float, ay: float, bx: float, by: float
) -> tuple[bool, float]:
    """Where on a circle the way from a to b is reflected [rad], and whether any place there is in sight of both.

    At such a place the angles to the normal are alike: the sines' difference rises from one end of what is in sight of
    both to the other.
    """
    radius = circle[2]
    near, far = np.hypot(ax - circle[0], ay - circle[1]), np.hypot(bx - circle[0], by - circle[1])
    first = np.arctan2(ay - circle[1], ax - circle[0])
    span = (np.arctan2(by - circle[1], bx - circle[0]) - first + np.pi) % (2.0 * np.pi) - np.pi
    size = abs(span)
    if min(near, far) <= radius * (1.0 + _GRAZING) or np.arccos(radius / near) + np.arccos(radius / far) <= size:
        return False, 0.0
    low, high = max(0.0, size - np.arccos(radius / far)), min(size, np.arccos(radius / near))
    below, above = _sines_apart(radius, near, far, low, size), _sines_apart(radius, near, far, high, size)
    turn, side = 0.5 * (low + high), 0
    for _ in range(_ROOT_STEPS if size > 0.0 else 0):  # the Illinois rule
        turn = (low * above - high * below) / (above - below) if above > below else 0.5 * (low + high)
        here = _sines_apart(radius, near, far, turn, size)
        if abs(here) < STILL_RAD or high - low < STILL_RAD:
            break
        if here < 0.0:
            low, below = turn, here
            above = 0.5 * above if side < 0 else above
            side = -1
        else:
            high, above = turn, here
            below = 0.5 * below if side > 0 else below
            side = 1
    return True, first + (turn if span >= 0.0 else -turn)


@kernel
def _sines_apart(radius: float, near: float, far: float, turn: float, size: float) -> float:
    """Sine of the angle at which the way from a place comes in, less that at which it goes on to the other."""
    rest = size - turn
    come = np.sqrt((near - radius) ** 2 + 4.0 * radius * near * np.sin(0.5 * turn) ** 2)
    go = np.sqrt((far - radius) ** 2 + 4.0 * radius * far * np.sin(0.5 * rest) ** 2)
    return float(near * np.sin(turn) / come - far * np.sin(rest) / go)


@kernel
def leg_share(
    rows: NDArray[np.float64], reflection: NDArray[np.float64], circles: NDArray[np.float64],
    walls: NDArray[np.int64], start: NDArray[np.float64], end: NDArray[np.float64], before: int, after: int,
) -> float:
    """Return what walls leave on the way from one place to the next, or 0 where it misses one or crosses a circle."""
    size, share = way_size(walls), 1.0
    x, y = end[0], end[1]
    own = after
    for level in range(size - 1, -1, -1):
        row = rows[walls[level]]
        ix, iy = over_walls(rows, walls[:level + 1], start[0], start[1], False)
        here, there = row[2] - x * row[0] - y * row[1], row[2] - ix * row[0] - iy * row[1]
        if here <= 0.0 or there >= 0.0:
            return 0.0
        t = here / (here - there)
        hx, hy = x + t * (ix - x), y + t * (iy - y)
        along = hy * row[0] - hx * row[1]
        if along < row[3] or along > row[4] or crosses(circles, x, y, hx, hy, own, -1):
            return 0.0
        share *= reflection[walls[level]]
        x, y, own = hx, hy, -1
    return 0.0 if crosses(circles, x, y, start[0], start[1], own, before) else share


@kernel
def crosses(
    circles: NDArray[np.float64], px: float, py: float, qx: float, qy: float, one: int, other: int
) -> bool:
    """Return whether a circle, other than two, is in the way from p to q."""
    dx, dy = qx - px, qy - py
    square = max(dx * dx + dy * dy, 1e-300)
    for c in range(len(circles)):
        if c in (one, other):
            continue
        share = ((circles[c, 0] - px) * dx + (circles[c, 1] - py) * dy) / square
        share = min(max(share, 0.0), 1.0)
        x, y = px + share * dx - circles[c, 0], py + share * dy - circles[c, 1]
        if x * x + y * y < (circles[c, 2] * (1.0 - _GRAZING)) ** 2:
            return True
    return False


@kernel
def is_hidden(
    rows: NDArray[np.float64], walls: NDArray[np.int64], circles: NDArray[np.float64], end: NDArray[np.float64]
) -> bool:
    """Return whether a circle is in the way of the outline's path over walls from emitter to receiver."""
    x, y = end[2], end[3]
    for level in range(len(walls) - 1, -1, -1):
        row = rows[walls[level]]
        ix, iy = over_walls(rows, walls[:level + 1], end[0], end[1], False)
        here, there = row[2] - x * row[0] - y * row[1], row[2] - ix * row[0] - iy * row[1]
        if here - there > 0.0:
            t = min(max(here / (here - there), 0.0), 1.0)
            hx, hy = x + t * (ix - x), y + t * (iy - y)
            if crosses(circles, x, y, hx, hy, -1, -1):
                return True
            x, y = hx, hy
    return crosses(circles, x, y, end[0], end[1], -1, -1)
