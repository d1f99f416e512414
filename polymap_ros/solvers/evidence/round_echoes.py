"""What round holes change of a plate's echoes: the paths over them come, and those of the outline behind them go.

Image sources know straight walls only. Once outline and circles are known, all of that follows from them: taken out of
what was heard, it leaves the echoes of the outline as if nothing stood inside, from which the walls are found again.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import inside
from polymap_ros.geometry.path_room import Paths, room_for_paths
from polymap_ros.geometry.paths import trace_paths
from polymap_ros.geometry.round_legs import is_hidden
from polymap_ros.geometry.round_ways import round_echoes
from polymap_ros.geometry.sides import Sides
from polymap_ros.geometry.storey import Storey
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.corner_echoes import add_echoes
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.rings import RingFeet
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
from polymap_ros.solvers.evidence.wave_sums import cubic
from polymap_ros.solvers.evidence.waveform import Wave


class RoundHoles(NamedTuple):
    """Round holes that were found.

    Attributes
    ----------
    circles : ndarray, shape (c, 4)
        Centre, radius [m] and signed reflection of each.
    covariance : ndarray, shape (4 c, 4 c)
        Of all of these.
    """

    circles: NDArray[np.float64]
    covariance: NDArray[np.float64]


def over_circles(
    data: EchoData, wave: Wave, circles: NDArray[np.float64], order: int = FULL_ORDER
) -> NDArray[np.complex128]:
    """Return the echoes over circles (c, 4) in every ping (N, n_ranges), in units of the noise, without the carrier.

    Paths have up to so many reflections; the wave is that of a convex outline with real coefficients.
    """
    total = np.zeros(data.signal.shape, complex)
    bound, sides = wave.walls.sides(0.0, data.shortest_m)
    if bound:
        echoes = round_echoes(sides, wave.walls.reflection, circles, data.ends, order, data.range_max_m)
        _add_up(data, wave, echoes.ping, echoes.order, echoes.half, echoes.strength, total)
    return total


def of_outline(
    data: EchoData, wave: Wave, circles: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the echoes of the outline alone, and of these the ones that circles are in the way of, as above."""
    total, hidden = np.zeros(data.signal.shape, complex), np.zeros(data.signal.shape, complex)
    bound, sides = wave.walls.sides(0.0, data.shortest_m)
    if bound:
        ping, order, half, strength, gone = _outline_paths(
            sides, wave.walls.reflection, circles, data.ends, FULL_ORDER, data.range_max_m,
            Storey().images(FULL_ORDER, data.level), room_for_paths(FULL_ORDER))
        _add_up(data, wave, ping, order, half, strength, total)
        _add_up(data, wave, ping[gone], order[gone], half[gone], strength[gone], hidden)
    return total, hidden


def _add_up(
    data: EchoData, wave: Wave, ping: NDArray[np.int64], order: NDArray[np.int64], half: NDArray[np.float64],
    strength: NDArray[np.float64], out: NDArray[np.complex128],
) -> None:
    b = wave.loudness.strengths[order - 1] * strength * half**-data.spreading * wave.amplitudes[ping]
    b = b * np.exp(1j * (wave.phase - 2.0 * data.pulse.carrier * half))
    add_echoes(ping, half, b, data.pulse.baseband, data.pulse.step_m, out)


@kernel
def _outline_paths(
    sides: Sides, reflection: NDArray[np.float64], circles: NDArray[np.float64], ends: NDArray[np.float64], order: int,
    range_max: float, storey: NDArray[np.float64], paths: Paths,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return ping, order, half the length and strength of the outline's paths, and whether a circle is in the way."""
    capacity = len(paths.half) * len(ends)
    ping, hits = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    half, strength, gone, count = np.empty(capacity), np.empty(capacity), np.empty(capacity, np.bool_), 0
    for i in range(len(ends)):
        for m in range(trace_paths(sides, ends[i], order, range_max, 0.0, False, storey, paths)):
            walls = paths.walls[m, :paths.hits[m]]
            ping[count], hits[count], half[count], strength[count] = i, len(walls), paths.half[m], paths.weight[m]
            for wall in walls:
                strength[count] *= reflection[wall]
            gone[count] = is_hidden(sides.rows, walls, circles, ends[i])
            count += 1
    return ping[:count], hits[:count], half[:count], strength[:count], gone[:count]


@kernel
def best_circle(
    feet: RingFeet, corners: NDArray[np.float64], step: float, least: float, most: float
) -> NDArray[np.float64]:
    """Return evidence [nats], centre and radius (4,) of the circle in an outline that first echoes speak for most.

    Centres lie on a grid of `step` [m], within `most` of the pings' box, radii of `least` to `most` twice as dense; no
    ping is inside.
    """
    best = np.zeros(4)
    low_x = max(np.min(corners[:, 0]) + least, np.min(feet.positions[:, 0]) - most)
    low_y = max(np.min(corners[:, 1]) + least, np.min(feet.positions[:, 1]) - most)
    high_x = min(np.max(corners[:, 0]) - least, np.max(feet.positions[:, 0]) + most)
    high_y = min(np.max(corners[:, 1]) - least, np.max(feet.positions[:, 1]) + most)
    away = np.empty(len(feet.positions))
    for ix in range(int((high_x - low_x) / step) + 1):
        for iy in range(int((high_y - low_y) / step) + 1):
            x, y = low_x + ix * step, low_y + iy * step
            if not inside(corners, x, y):
                continue
            for i in range(len(away)):
                away[i] = np.hypot(feet.positions[i, 0] - x, feet.positions[i, 1] - y)
            free = min(most, np.min(away))
            for k in range(int((free - least) / (0.5 * step)) + 1):
                radius, total = least + 0.5 * k * step, 0.0
                for i in range(len(away)):
                    at = (away[i] - radius) / feet.cell
                    q = int(at)
                    if at >= 0.0 and q < feet.evidence.shape[1] - 1:
                        total += feet.evidence[i, q] + (at - q) * (feet.evidence[i, q + 1] - feet.evidence[i, q])
                if total > best[0]:
                    best[0], best[1], best[2], best[3] = total, x, y, radius
    return best


@kernel
def first_echoes_in_phase(
    data: NDArray[np.complex128], ends: NDArray[np.float64], gain: NDArray[np.float64], carrier: float, step: float,
    spreading: float, x: float, y: float, radius: float,
) -> tuple[complex, float]:
    """Return the sum of the first echoes of a circle as heard, each by the strength that is expected, and their square.

    The signal is without its carrier, in steps of range.
    """
    total, square = 0.0j, 0.0
    for i in range(len(ends)):
        near = np.hypot(ends[i, 0] - x, ends[i, 1] - y)
        far = np.hypot(ends[i, 2] - x, ends[i, 3] - y)
        flat = near + far - 2.0 * radius
        half = 0.5 * np.sqrt(flat * flat + ends[i, 4] ** 2)
        at = half / step
        q = int(at)
        if flat <= 0.0 or radius <= 0.0 or q < 1 or q + 3 > data.shape[1]:
            continue
        b = np.sqrt(gain[i] * radius / (radius + 0.5 * flat)) * half**-spreading
        heard, _ = cubic(data[i], at)
        total += b * heard * np.exp(2j * carrier * half)
        square += b * b
    return total, square
