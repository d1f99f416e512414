r"""Echoes among straight walls and round ones, such as the edge of a manhole: rays, and how a bend spreads them.

Every sequence of walls is tried. Straight ones are unfolded by images; where the path touches a round one follows from
Fermat's principle: on the way by it, as on all others, the path is as short as it can be. What a path leaves of the
amplitude beside the walls' coefficients is its tube of rays: a wave front with the radius of curvature rho that is
reflected by a circle of radius a, at the angle i from its normal, goes on with

    1 / rho' = 1 / rho + 2 / (a cos i),

and over a way d its amplitude falls by sqrt(rho' / (rho' + d)) [1]. Beside a straight wall an echo from the distance s
is weaker by sqrt(a / (a + s)). Right where a is many wavelengths; what creeps round the circle is left out.

[1] J. B. Keller, "Geometrical theory of diffraction", 1962; the tube of rays in its section on smooth bodies.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.jit import kernel
from polymap_ros.simulation.reflectors import Reflectors, beside, crossing, passed

_STILL_RAD = 1e-12
"""Places on circles that move by less are found."""

_ON_CIRCLE = 1e-9
"""Nearer to a circle than this share of its radius an image is taken to be on it, where no path begins."""

_SWEEPS, _STEPS = 200, 60
"""Rounds over the circles of a path, and steps of a root, at most: a path between two holes needs a dozen and five."""


def heard_paths(
    reflectors: Reflectors, circles: ArrayLike, emitter: ArrayLike, receiver: ArrayLike, order: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Paths from an emitter over straight and round walls to a receiver.

    Parameters
    ----------
    reflectors : Reflectors
        The straight walls.
    circles : array_like, shape (c, 4)
        Centre, radius [m] and signed reflection coefficient of each round wall; nothing crosses it.
    emitter, receiver : array_like, shape (2,)
        Their places [m], on no wall and in no circle.
    order : int
        Largest number of reflections, >= 1.

    Returns
    -------
    length_m : ndarray, shape (k,)
        Lengths, shortest first [m].
    amplitude : ndarray, shape (k,)
        What walls and bends leave of the amplitude, before the spreading of a path of that length.
    """
    walls = np.ascontiguousarray(np.stack((reflectors.starts, reflectors.ends), axis=1))
    rounds = np.ascontiguousarray(np.reshape(np.asarray(circles, dtype=float), (-1, 4)))
    source, place = np.asarray(emitter, dtype=float), beside(walls, np.asarray(receiver, dtype=float))
    capacity = 64
    while True:
        found = np.empty((capacity, 2))
        count = _trace(walls, reflectors.reflection, reflectors.transmission, rounds, source, place, order, found)
        if count <= capacity:
            found = found[:count]
            nearest = np.argsort(found[:, 0], kind='stable')
            return found[nearest, 0], found[nearest, 1]
        capacity = 2 * count


@kernel
def _trace(
    walls: NDArray[np.float64], reflection: NDArray[np.float64], transmission: NDArray[np.float64],
    circles: NDArray[np.float64], source: NDArray[np.float64], receiver: NDArray[np.float64], order: int,
    found: NDArray[np.float64],
) -> int:
    """Write lengths and amplitudes into `found` (capacity, 2); returns their number, which may be larger.

    Walls have the numbers from 0 on, circles those after them.
    """
    n, count = len(walls) + len(circles), 0
    hit, depth = np.full(order, -1), 0
    places = np.empty((order + 2, 2))
    while depth >= 0:
        hit[depth] += 1
        if hit[depth] == n:
            hit[depth] = -1
            depth -= 1
            continue
        if depth > 0 and hit[depth] == hit[depth - 1]:
            continue
        if _placed(walls, circles, hit[:depth + 1], source, receiver, places):
            amplitude = _followed(walls, reflection, transmission, circles, hit[:depth + 1], places)
            if amplitude != 0.0:
                length, spread = _spread(len(walls), circles, hit[:depth + 1], places)
                if count < len(found):
                    found[count, 0], found[count, 1] = length, amplitude * spread
                count += 1
        if depth < order - 1:
            depth += 1
    return count


@kernel
def _placed(
    walls: NDArray[np.float64], circles: NDArray[np.float64], hit: NDArray[np.int64], source: NDArray[np.float64],
    receiver: NDArray[np.float64], places: NDArray[np.float64],
) -> bool:
    """Fill the places of a path: source, hits, receiver; False where it leaves walls, or crosses a circle it hits."""
    depth, n = len(hit), len(walls)
    places[0], places[depth + 1] = source, receiver
    bends = 0
    for k in range(depth):
        if hit[k] >= n:
            places[k + 1] = circles[hit[k] - n, :2]
            bends += 1
    angle = np.full(depth, np.nan)
    for _ in range(_SWEEPS if bends > 0 else 0):
        moved = 0.0
        for k in range(depth):
            if hit[k] < n:
                continue
            circle = circles[hit[k] - n]
            ax, ay = _unfolded(walls, hit, places, k, -1)
            bx, by = _unfolded(walls, hit, places, k, 1)
            lit, turned = _touch(circle, ax, ay, bx, by)
            if not lit:
                return False
            moved = max(moved, abs(turned - angle[k]) if not np.isnan(angle[k]) else 1.0)
            angle[k] = turned
            places[k + 1, 0] = circle[0] + circle[2] * np.cos(turned)
            places[k + 1, 1] = circle[1] + circle[2] * np.sin(turned)
        if moved < _STILL_RAD:
            break
    for k in range(depth - 1, -1, -1):  # from the receiver back, as images are
        if hit[k] >= n:
            continue
        x, y = _image(walls, hit, places, k)
        px, py = places[k + 2]
        wall = walls[hit[k]]
        met, share = crossing(px, py, x, y, wall[0, 0], wall[0, 1], wall[1, 0], wall[1, 1])
        if not met:
            return False
        places[k + 1, 0], places[k + 1, 1] = px + share * (x - px), py + share * (y - py)
    return True


@kernel
def _image(
    walls: NDArray[np.float64], hit: NDArray[np.int64], places: NDArray[np.float64], last: int
) -> tuple[float, float]:
    """Image of the place on the circle before, or of the source, in the straight walls from there up to a hit."""
    first = last
    while first > 0 and hit[first - 1] < len(walls):
        first -= 1
    x, y = places[first]
    for k in range(first, last + 1):
        x, y = _mirrored(walls[hit[k]], x, y)
    return x, y


@kernel
def _unfolded(
    walls: NDArray[np.float64], hit: NDArray[np.int64], places: NDArray[np.float64], at: int, side: int
) -> tuple[float, float]:
    """Image in the straight walls between of the next place that is on none, before a hit (-1) or after it (1)."""
    other = at + side
    while 0 <= other < len(hit) and hit[other] < len(walls):
        other += side
    x, y = places[other + 1]
    while other != at + side:
        other -= side
        x, y = _mirrored(walls[hit[other]], x, y)
    return x, y


@kernel
def _mirrored(wall: NDArray[np.float64], x: float, y: float) -> tuple[float, float]:
    ex, ey = wall[1, 0] - wall[0, 0], wall[1, 1] - wall[0, 1]
    offset = 2.0 * ((x - wall[0, 0]) * ey - (y - wall[0, 1]) * ex) / (ex * ex + ey * ey)
    return x - offset * ey, y + offset * ex


@kernel
def _touch(circle: NDArray[np.float64], ax: float, ay: float, bx: float, by: float) -> tuple[bool, float]:
    """Where on a circle the way from a to b is reflected [rad], and whether both are in its sight.

    The way by a place at the angle phi is shortest there: its slope in phi, bracketed between the directions of a and
    b, is 0.
    """
    radius = circle[2]
    near, far = np.hypot(ax - circle[0], ay - circle[1]), np.hypot(bx - circle[0], by - circle[1])
    if min(near, far) <= radius * (1.0 + _ON_CIRCLE):
        return False, 0.0
    first = np.arctan2(ay - circle[1], ax - circle[0])
    turn = np.arctan2(by - circle[1], bx - circle[0]) - first
    turn -= 2.0 * np.pi * np.floor(turn / (2.0 * np.pi) + 0.5)
    low, high = min(0.0, turn), max(0.0, turn)
    phi = 0.5 * turn
    for _ in range(_STEPS):
        slope, bend = 0.0, 0.0
        for distance, psi in ((near, phi), (far, phi - turn)):
            square = (distance - radius) ** 2 + 4.0 * radius * distance * np.sin(0.5 * psi) ** 2
            way, along = np.sqrt(square), radius * distance * np.sin(psi)
            slope += along / way
            bend += radius * distance * np.cos(psi) / way - along * along / (square * way)
        if slope > 0.0:
            high = phi
        else:
            low = phi
        step = phi - slope / bend if bend > 0.0 else np.nan
        if not low <= step <= high:
            step = 0.5 * (low + high)
        done = abs(step - phi) < 0.1 * _STILL_RAD
        phi = step
        if done:
            break
    lit = np.cos(phi) * near > radius and np.cos(phi - turn) * far > radius
    return lit, first + phi


@kernel
def _followed(
    walls: NDArray[np.float64], reflection: NDArray[np.float64], transmission: NDArray[np.float64],
    circles: NDArray[np.float64], hit: NDArray[np.int64], places: NDArray[np.float64],
) -> float:
    """What coefficients and what is in the way leave of the amplitude of a path; 0: nothing."""
    n, amplitude = len(walls), 1.0
    for leg in range(len(hit) + 1):
        before, after = hit[leg - 1] if leg > 0 else -1, hit[leg] if leg < len(hit) else -1
        if after >= 0:
            amplitude *= reflection[after] if after < n else circles[after - n, 3]
        px, py, qx, qy = places[leg, 0], places[leg, 1], places[leg + 1, 0], places[leg + 1, 1]
        amplitude *= passed(walls, transmission, px, py, qx, qy, before, after)
        for c in range(len(circles)):
            if c + n != before and c + n != after and _in_the_way(circles[c], px, py, qx, qy):
                return 0.0
        if amplitude == 0.0:
            return 0.0
    return amplitude


@kernel
def _in_the_way(circle: NDArray[np.float64], px: float, py: float, qx: float, qy: float) -> bool:
    dx, dy = qx - px, qy - py
    square = dx * dx + dy * dy
    share = ((circle[0] - px) * dx + (circle[1] - py) * dy) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    away = (px + share * dx - circle[0]) ** 2 + (py + share * dy - circle[1]) ** 2
    return bool(away < circle[2] ** 2)


@kernel
def _spread(
    n: int, circles: NDArray[np.float64], hit: NDArray[np.int64], places: NDArray[np.float64]
) -> tuple[float, float]:
    """Length of a path, and the amplitude that bends leave beside that of as long a path over straight walls."""
    total, left, rho = 0.0, 1.0, 0.0
    for leg in range(len(hit) + 1):
        dx, dy = places[leg + 1, 0] - places[leg, 0], places[leg + 1, 1] - places[leg, 1]
        way = np.sqrt(dx * dx + dy * dy)
        if leg > 0:
            left *= rho / (rho + way)
        total, rho = total + way, rho + way
        if leg == 0:
            first = way
        if leg < len(hit) and hit[leg] >= n:
            circle = circles[hit[leg] - n]
            across = ((places[leg, 0] - places[leg + 1, 0]) * (places[leg + 1, 0] - circle[0])
                      + (places[leg, 1] - places[leg + 1, 1]) * (places[leg + 1, 1] - circle[1])) / (way * circle[2])
            rho = 1.0 / (1.0 / rho + 2.0 / (circle[2] * across))
    return total, np.sqrt(left * total / first)
