"""What corners return: image sources end at once where a hit leaves its wall, real echoes fade and corners diffract.

For every corner and every pair of ways to it and on there is a path over the corner, with the amplitude of the uniform
theory (`acoustics.wedge`) at the pulse's frequency. In plates 7 to 30 % of the power is of that kind, and all of it
follows from the walls: once they are known, it is taken out of what was heard, and they are found again from the rest.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.wedge import diffracts, wedge_coefficient
from polymap_ros.geometry.image_sources import trace_images
from polymap_ros.geometry.sides import Sides
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
from polymap_ros.solvers.evidence.wave_sums import cubic
from polymap_ros.solvers.evidence.waveform import Wave

_ASIDE = 1e-5
"""Ways are traced to a place this share of the range inside a corner, which is on two walls itself."""
_ALONG_RAD = 1e-9
"""Ways nearer to a wall's own direction than this lead over the wall: the coefficient has its image already."""
_AS_GOOD_AS = 2e-3
"""An angle within this share of pi over a whole number is taken for that: both paths that return to their source hit
within a millimetre of such a corner, where walls are soft, and count once together as they are."""
_CAPACITY = 256
"""Ways from a place to a corner: of an octagon and order 4 there are about 80."""


class _Corner(NamedTuple):
    """x and y of a corner [m]; direction of the wall that begins there, the room to the left; the interior angle; and
    the walls that begin and end there."""

    x: float
    y: float
    first_rad: float
    angle_rad: float
    first: int
    last: int


class _Ways(NamedTuple):
    """Ways between places and a corner, in the order of the places.

    Attributes
    ----------
    ping, hits : ndarray, shape (m,), int64
        Number of the place, and of the reflections.
    length, angle : ndarray, shape (m,)
        Length [m], and direction at the corner, from its first wall [rad].
    strength : ndarray, shape (m,), complex
        Product of what the walls leave and how they turn the phase.
    """

    ping: NDArray[np.int64]
    hits: NDArray[np.int64]
    length: NDArray[np.float64]
    angle: NDArray[np.float64]
    strength: NDArray[np.complex128]

    def of(self, chosen: NDArray[np.int64]) -> '_Ways':
        """Return some of the ways."""
        return _Ways(self.ping[chosen], self.hits[chosen], self.length[chosen], self.angle[chosen],
                     self.strength[chosen])


def without_corner_echoes(data: EchoData, wave: Wave) -> EchoData:
    """Return echoes without those that corners return, as a waveform's walls make them."""
    return data.with_signal(data.signal - corner_echoes(data, wave).astype(np.complex64))


def corner_echoes(data: EchoData, wave: Wave) -> NDArray[np.complex128]:
    """Return what corners return of every ping (N, n_ranges), without the carrier, in units of the noise."""
    bound, sides = wave.walls.sides(0.0, data.shortest_m)
    total = np.zeros(data.signal.shape, complex)
    if not bound:
        return total
    amplitudes, spread = wave.amplitudes * np.exp(1j * wave.phase), data.spreading
    for corner in _corners(sides, wave):
        coming = _ways(sides, corner, data.ends[:, :2], wave, data.range_max_m)
        going = coming if not np.any(data.baselines) else _ways(
            sides, corner, data.ends[:, 2:4], wave, data.range_max_m)
        one, other = _pairs(coming.ping, coming.hits, coming.length, going.ping, going.hits, going.length,
                            2.0 * data.range_max_m)
        coming, going = coming.of(one), going.of(other)
        focus = coming.length * going.length / (coming.length + going.length)
        turned = wedge_coefficient(corner.angle_rad, _reflections(corner, wave, coming.angle), coming.angle,
                                   going.angle, data.pulse.carrier, focus)
        half = 0.5 * np.hypot(coming.length + going.length, data.ends[coming.ping, 4])
        strength = wave.loudness.strengths[np.minimum(coming.hits + going.hits, FULL_ORDER - 1)]
        b = strength * coming.strength * going.strength * turned / np.sqrt(focus) * half**-spread
        b *= amplitudes[coming.ping] * np.exp(-2j * data.pulse.carrier * half)
        add_echoes(coming.ping, half, b, data.pulse.baseband, data.pulse.step_m, total)
    return total


def _corners(sides: Sides, wave: Wave) -> list[_Corner]:
    """The corners of the outline and of holes that diffract."""
    walls, found, first = wave.walls, [], 0
    for count in (walls.ring, *walls.interior.holes.tolist()):
        for k in range(count):
            wall, before = first + k, first + (k - 1) % count
            c, s, x, y = sides.rows[wall, [0, 1, 5, 6]].tolist()
            turn = walls.lines[wall, 1] - walls.lines[before, 1]
            angle = float(np.mod(np.pi - turn, 2.0 * np.pi))
            if angle > 0.0 and diffracts(angle, _AS_GOOD_AS):
                found.append(_Corner(x, y, float(np.arctan2(c, -s)), angle, wall, before))
        first += count
    return found


def _ways(sides: Sides, corner: _Corner, places: NDArray[np.float64], wave: Wave, range_max_m: float) -> _Ways:
    middle = corner.first_rad + 0.5 * corner.angle_rad
    inside = np.array((corner.x, corner.y)) + _ASIDE * range_max_m * np.array((np.cos(middle), np.sin(middle)))
    ping, hits = np.empty((2, len(places) * _CAPACITY), np.int64)
    length, angle, delay, strength = np.empty((4, len(places) * _CAPACITY))
    walls = wave.walls
    count = _fill_ways(sides, np.array(corner[:4]), inside, places, FULL_ORDER - 1, 2.0 * range_max_m,
                       walls.reflection, wave.edge.table, wave.edge.own(walls.delay), ping, hits, length, angle,
                       strength, delay)
    return _Ways(ping[:count], hits[:count], length[:count], angle[:count],
                 strength[:count] * np.exp(-1j * delay[:count]))


def _reflections(
    corner: _Corner, wave: Wave, coming: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Coefficients (m,) of the corner's two walls where ways come from these directions."""
    found = []
    for wall, angle in ((corner.first, coming), (corner.last, corner.angle_rad - coming)):
        delay, table = np.zeros(len(coming)), wave.edge.table
        if len(table):
            delay += np.interp(np.abs(np.sin(angle)), np.linspace(0.0, 1.0, len(table)), table)
            delay += wave.walls.delay[wall] if len(wave.edge.own(wave.walls.delay)) else 0.0
        found.append(wave.walls.reflection[wall] * np.exp(-1j * delay))
    return found[0], found[1]


@kernel
def _fill_ways(
    sides: Sides, corner: NDArray[np.float64], inside: NDArray[np.float64], places: NDArray[np.float64], order: int,
    farthest: float, reflection: NDArray[np.float64], table: NDArray[np.float64], own: NDArray[np.float64],
    ping: NDArray[np.int64], hits: NDArray[np.int64], length: NDArray[np.float64], angle: NDArray[np.float64],
    strength: NDArray[np.float64], delay: NDArray[np.float64],
) -> int:
    """Fill the columns of `_Ways`; returns their number."""
    images, sequences = np.empty((_CAPACITY - 1, 3)), np.empty((_CAPACITY - 1, order), np.int64)
    kept = 0
    for i in range(len(places)):
        x, y = places[i, 0], places[i, 1]
        count = trace_images(sides, x, y, inside[0], inside[1], order, farthest, 0.0, False, images, sequences)
        for m in range(-1, min(count, len(images))):
            share = _straight(sides, x, y, inside[0], inside[1]) if m < 0 else images[m, 2]
            dx, dy = (x if m < 0 else images[m, 0]) - corner[0], (y if m < 0 else images[m, 1]) - corner[1]
            direction = (np.arctan2(dy, dx) - corner[2]) % (2.0 * np.pi)
            if share == 0.0 or direction <= _ALONG_RAD or direction >= corner[3] - _ALONG_RAD:
                continue
            ping[kept], length[kept], angle[kept] = i, np.sqrt(dx * dx + dy * dy), direction
            hits[kept], delay[kept] = 0, 0.0
            wx, wy = dx / length[kept], dy / length[kept]
            last = order - 1 if m >= 0 else -1
            for level in range(last, -1, -1):
                side = sequences[m, level]
                if side < 0:
                    continue
                wall, across = sides.wall[side], wx * sides.rows[side, 0] + wy * sides.rows[side, 1]
                wx, wy = wx - 2.0 * across * sides.rows[side, 0], wy - 2.0 * across * sides.rows[side, 1]
                share *= reflection[wall]
                hits[kept] += 1
                if len(table) > 0:
                    place = min(abs(across), 1.0) * (len(table) - 1)
                    low = min(int(place), len(table) - 2)
                    delay[kept] += table[low] + (place - low) * (table[low + 1] - table[low])
                    if len(own) > 0:
                        delay[kept] += own[wall]
            strength[kept] = share
            kept += 1
    return kept


@kernel
def _straight(sides: Sides, x: float, y: float, to_x: float, to_y: float) -> float:
    """Return what walls in the way leave of a wave straight from one place to another."""
    share = 1.0
    for wall in range(0 if sides.convex else len(sides.rows)):
        row = sides.rows[wall]
        here, there = row[2] - x * row[0] - y * row[1], row[2] - to_x * row[0] - to_y * row[1]
        if sides.forward[wall] > 0.0 and ((here < 0.0 < there) or (there < 0.0 < here)):
            t = here / (here - there)
            along = (y + t * (to_y - y)) * row[0] - (x + t * (to_x - x)) * row[1]
            if row[3] <= along <= row[4]:
                share *= sides.passed[wall]
    return share


@kernel
def _pairs(
    coming: NDArray[np.int64], coming_hits: NDArray[np.int64], coming_length: NDArray[np.float64],
    going: NDArray[np.int64], going_hits: NDArray[np.int64], going_length: NDArray[np.float64], farthest: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return which ways to a corner and on from it make paths of all orders within the range, ping by ping."""
    one, other = np.empty(0, np.int64), np.empty(0, np.int64)
    for fill in range(2):
        count, first = 0, 0
        for i in range(len(coming)):
            while first < len(going) and going[first] < coming[i]:
                first += 1
            j = first
            while j < len(going) and going[j] == coming[i]:
                if coming_hits[i] + going_hits[j] < FULL_ORDER and coming_length[i] + going_length[j] <= farthest:
                    if fill == 1:
                        one[count], other[count] = i, j
                    count += 1
                j += 1
        if fill == 0:
            one, other = np.empty(count, np.int64), np.empty(count, np.int64)
    return one, other


@kernel
def add_echoes(
    ping: NDArray[np.int64], half: NDArray[np.float64], b: NDArray[np.complex128],
    baseband: NDArray[np.complex128], step: float, out: NDArray[np.complex128],
) -> None:
    """Add echoes of these amplitudes to the pings' signals."""
    reach = (len(baseband) - 5) * step
    for m in range(len(half)):
        low, high = max(int(np.ceil((half[m] - reach) / step)), 0), int((half[m] + reach) / step)
        for j in range(low, min(high, out.shape[1] - 1) + 1):
            lag = j * step - half[m]
            psi, _ = cubic(baseband, abs(lag) / step + 2.0)
            out[ping[m], j] += b[m] * (psi if lag >= 0.0 else psi.conjugate())
