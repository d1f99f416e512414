"""The sums over a ping's paths that the likelihood of `waveform` is made of, and the waveform that they predict."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.path_room import Paths, room_for_paths
from polymap_ros.geometry.paths import trace_paths
from polymap_ros.geometry.sides import Sides
from polymap_ros.jit import kernel, within_kernels
from polymap_ros.solvers.evidence.edge_phase import COMMON
from polymap_ros.solvers.evidence.loudness import Loudness, amplitude, is_directed


class Sums(NamedTuple):
    """u (N,), v (N,), x (N, 3 n), p (N, 3 n) and the Fisher information (N, 3 n, 3 n) at amplitude 1, of `waveform`.

    By r of all walls, then theta, then ln |rho|; the information's rows of ln |rho| have columns of ln |rho| only. Last
    the same by the K numbers of `edge_phase`: x (N, K), the information with the device's phase and p (N, K), the
    information (N, K, K), and that with the walls (N, 3 n, K); K is 0 where they are not looked for.
    """

    u: NDArray[np.complex128]
    v: NDArray[np.float64]
    x: NDArray[np.complex128]
    p: NDArray[np.float64]
    information: NDArray[np.float64]
    edge_x: NDArray[np.complex128]
    edge_v: NDArray[np.float64]
    edge_p: NDArray[np.float64]
    edge_information: NDArray[np.float64]
    across: NDArray[np.float64]


@kernel
def cubic(y: NDArray[np.complexfloating], x: float) -> tuple[complex, complex]:
    """Value and derivative of the four-point Lagrange interpolant at index x."""
    j = int(x)
    f = x - j
    a, b, c, d = y[j - 1], y[j], y[j + 1], y[j + 2]
    one = -a / 3.0 - b / 2.0 + c - d / 6.0
    two = a / 2.0 - b + c / 2.0
    three = -a / 6.0 + b / 2.0 - c / 2.0 + d / 6.0
    return b + f * (one + f * (two + f * three)), one + f * (2.0 * two + 3.0 * f * three)


class Echoes(NamedTuple):
    """What the kernels need of the data, see `EchoData`; samples of the signal and of the pulse are `step` apart."""

    ends: NDArray[np.float64]
    signal: NDArray[np.complex64]
    range_max: float
    soft: float
    spreading: float
    step: float
    carrier: float
    baseband: NDArray[np.complex128]
    curvature: NDArray[np.complex128]
    yaw: NDArray[np.float64]


class _Room(NamedTuple):
    """Room for what a ping's paths add up to.

    Of each path: its amplitude b and b exp(2 j k0 d); where its envelope is; its slopes; the sums over the paths near
    it of the slope of psi and of psi; and what stands beside its slopes in the information, where losses have to do
    with losses by psi itself, in a place of their own. `delays` are the slopes of its phase by the numbers of
    `edge_phase`.
    """

    b: NDArray[np.float64]
    turn: NDArray[np.complex128]
    place: NDArray[np.float64]
    slopes: NDArray[np.float64]
    near: NDArray[np.float64]
    spread: NDArray[np.float64]
    delays: NDArray[np.float64]


@kernel
def _turn(angle: float) -> complex:
    """exp(j angle)."""
    return complex(np.cos(angle), np.sin(angle))


@within_kernels
def _delay(paths: Paths, m: int, table: NDArray[np.float64], own: NDArray[np.float64]) -> float:
    """What its reflections delay a path's phase by: a law over the cosine of incidence, and the walls' own."""
    total = 0.0
    if len(table) > 0:
        for level in range(paths.hits[m]):
            place = min(abs(paths.slopes[m, level, 0]), 1.0) * (len(table) - 1)
            low = min(int(place), len(table) - 2)
            total += table[low] + (place - low) * (table[low + 1] - table[low])
            if len(own) > 0:
                total += own[paths.walls[m, level]]
    return total


@within_kernels
def _fill_delays(paths: Paths, m: int, delays: NDArray[np.float64]) -> None:
    """Slopes of a path's delay: its reflections, the sums of s^2 and of s^4, and by wall its reflections there."""
    delays[m] = 0.0
    by_wall = delays.shape[1] > COMMON
    for level in range(paths.hits[m]):
        s2 = max(1.0 - paths.slopes[m, level, 0] ** 2, 0.0)
        delays[m, 0] += 1.0
        delays[m, 1] += s2
        delays[m, 2] += s2 * s2
        if by_wall:
            delays[m, COMMON + paths.walls[m, level]] += 1.0


@kernel
def add_up(
    sides: Sides, loudness: Loudness, heard: Echoes, reflection: NDArray[np.float64],
    table: NDArray[np.float64], own: NDArray[np.float64], storey: NDArray[np.float64], derive: bool, sums: Sums
) -> None:
    """Fill the sums of every ping; their columns are r of all walls, then theta, then ln |rho|.

    `loudness` has strengths up to the last order; `table` is the phase's delay by a reflection
    over the cosine of incidence, empty where there is none, and `own` what each wall adds, empty where it adds nothing;
    `storey` as in `trace_paths`.
    """
    slant, columns = derive or len(table) > 0 or is_directed(loudness), sums.edge_x.shape[1]
    order = len(loudness.strengths)
    paths, n = room_for_paths(order), len(reflection)
    size, farthest = len(paths.half), (heard.signal.shape[1] - 4) * heard.step
    room = _Room(np.empty(size), np.empty(size, np.complex128), np.empty(size), np.empty((size, 3 * n)),
                 np.empty((size, 2)), np.empty((size, 4 * n)), np.empty((size, columns)))
    for i in range(len(heard.ends)):
        count = trace_paths(sides, heard.ends[i], order, heard.range_max, heard.soft, slant, storey, paths)
        for m in range(count):
            room.place[m] = paths.half[m] + loudness.late * paths.hits[m]
            far = 2.0 * heard.step <= room.place[m] <= farthest
            room.b[m] = amplitude(
                paths, m, heard.spreading, reflection, heard.yaw[i], loudness) if far else 0.0
            room.turn[m] = room.b[m] * _turn(2.0 * heard.carrier * paths.half[m] + _delay(paths, m, table, own))
            if columns:
                _fill_delays(paths, m, room.delays)
        if derive:
            _gather_slopes(paths, count, n, room.slopes)
            room.near[:count] = 0.0
            room.spread[:count] = 0.0
        _add_ping(paths, count, n, heard, i, derive, loudness.lean, room, sums)
        for m in range(count if derive else 0):
            _add_information(sums.p[i], sums.information[i], paths, m, room.slopes[m], room.near[m], room.spread[m])
            for k in range(columns):
                sums.edge_v[i, k] += room.delays[m, k] * room.near[m, 1]


@kernel
def _add_ping(
    paths: Paths, count: int, n: int, heard: Echoes, i: int, derive: bool, lean: float, room: _Room, sums: Sums
) -> None:
    """A ping's u, v and x, and what its paths have to do with each other."""
    half, place, b, turn, step, carrier = paths.half, room.place, room.b, room.turn, heard.step, heard.carrier
    signal, baseband = heard.signal[i], heard.baseband
    reach = (len(baseband) - 5) * step
    nearest = np.argsort(place[:count])
    u, v = 0.0j, 0.0
    for q in range(count):
        m = nearest[q]
        if b[m] == 0.0:
            continue
        value, rate = cubic(signal, place[m] / step)
        if lean != 0.0:
            value += 1j * lean * half[m] / step * rate
        u += value * turn[m]
        v += b[m] * b[m]
        if derive:
            _add_heard(sums.x[i], paths, m, n, (rate / step + 2j * carrier * value) * turn[m], value * turn[m])
            if sums.edge_x.shape[1]:
                _add_edge(sums, i, room, m, value * turn[m], 2.0 * carrier * b[m] * b[m])
            room.near[m, 1] += b[m] * b[m]
            _add_pair(room.spread[m], room.slopes[m], -heard.curvature[2].real * b[m] * b[m], 0.0, b[m] * b[m])
        for p in range(q - 1, -1, -1):
            other = nearest[p]
            lag = place[m] - place[other]
            if lag > reach:
                break
            psi, psi_rate = cubic(baseband, lag / step + 2.0)
            if lean != 0.0:
                psi += 1j * lean * (half[m] + half[other]) / step * psi_rate
            wave = turn[m] * turn[other].conjugate()
            both = (psi * wave).real
            v += 2.0 * both
            if derive:
                steep = (psi_rate / step + 2j * carrier * psi) * wave
                slope = steep.real
                bend = -(cubic(heard.curvature, lag / step + 2.0)[0] * wave).real
                room.near[m, 0] += slope
                room.near[m, 1] += both
                room.near[other, 0] -= slope
                room.near[other, 1] += both
                _add_pair(room.spread[m], room.slopes[other], bend, slope, both)
                _add_pair(room.spread[other], room.slopes[m], bend, -slope, both)
                if sums.edge_x.shape[1]:
                    _add_edge_pair(sums, i, room, m, other, both, (psi * wave).imag, steep.imag)
    sums.u[i], sums.v[i] = u, v


@within_kernels
def _add_edge(sums: Sums, i: int, room: _Room, m: int, heard: complex, steep: float) -> None:
    """A path's share of the sums by the numbers of `edge_phase`: its echo's slopes by them are -j `delays` times it."""
    n = room.slopes.shape[1] // 3
    for k in range(room.delays.shape[1]):
        by = room.delays[m, k]
        sums.edge_x[i, k] += 1j * by * heard
        for other in range(room.delays.shape[1]):
            sums.edge_information[i, k, other] += by * room.delays[m, other] * room.b[m] ** 2
        for w in range(2 * n):
            sums.across[i, w, k] += room.slopes[m, w] * by * steep


@within_kernels
def _add_edge_pair(
    sums: Sums, i: int, room: _Room, m: int, other: int, both: float, aside: float, steep: float
) -> None:
    """A pair of paths' share: `both` + j `aside` is the product of one's echo with the other's, `steep` the imaginary
    part of its derivative by the first's range."""
    n = room.slopes.shape[1] // 3
    for k in range(room.delays.shape[1]):
        one, two = room.delays[m, k], room.delays[other, k]
        sums.edge_p[i, k] += (two - one) * aside
        for q in range(room.delays.shape[1]):
            sums.edge_information[i, k, q] += both * (one * room.delays[other, q] + two * room.delays[m, q])
        for w in range(2 * n):
            sums.across[i, w, k] += steep * (room.slopes[m, w] * two + room.slopes[other, w] * one)
        for w in range(2 * n, 3 * n):
            sums.across[i, w, k] += aside * (room.slopes[m, w] * two - room.slopes[other, w] * one)


@kernel
def _gather_slopes(paths: Paths, count: int, n: int, slopes: NDArray[np.float64]) -> None:
    """Derivatives of each path's half length by r and theta, and of ln |b| by ln |rho|, of every wall."""
    for m in range(count):
        slopes[m] = 0.0
        for level in range(paths.hits[m]):
            wall = paths.walls[m, level]
            slopes[m, wall] += paths.slopes[m, level, 0]
            slopes[m, n + wall] += paths.slopes[m, level, 1]
            slopes[m, 2 * n + wall] += 1.0


@within_kernels
def _add_heard(
    x: NDArray[np.complex128], paths: Paths, m: int, n: int, by_range: complex, by_loss: complex
) -> None:
    """A path's share of x."""
    for level in range(paths.hits[m]):
        wall = paths.walls[m, level]
        x[wall] += by_range * paths.slopes[m, level, 0]
        x[n + wall] += by_range * paths.slopes[m, level, 1]
        x[2 * n + wall] += by_loss


@within_kernels
def _add_pair(
    spread: NDArray[np.float64], other: NDArray[np.float64], bend: float, slope: float, both: float
) -> None:
    """An ordered pair of paths' share in the row `spread` of the first.

    The information is the sum over paths of their slopes times that row: of ranges with ranges by the bend of psi, of
    ranges with losses by its slope, and of losses with losses by psi itself.
    """
    n = len(other) // 3
    for w in range(2 * n):
        spread[w] += bend * other[w]
    for w in range(2 * n, 3 * n):
        spread[w] += slope * other[w]
        spread[n + w] += both * other[w]


@within_kernels
def _add_information(
    p: NDArray[np.float64], information: NDArray[np.float64], paths: Paths, m: int, slopes: NDArray[np.float64],
    near: NDArray[np.float64], spread: NDArray[np.float64],
) -> None:
    """A path's share of p and of the information, but for losses with ranges, once its row `spread` is whole."""
    n = len(slopes) // 3
    for w in range(2 * n):
        p[w] += near[0] * slopes[w]
    for w in range(2 * n, 3 * n):
        p[w] += near[1] * slopes[w]
    for level in range(paths.hits[m]):
        wall = paths.walls[m, level]
        for axis in range(2):
            by, row = paths.slopes[m, level, axis], information[axis * n + wall]
            for x in range(3 * n):
                row[x] += by * spread[x]
        row = information[2 * n + wall]
        for x in range(2 * n, 3 * n):
            row[x] += spread[n + x]


@kernel
def predict(
    sides: Sides, loudness: Loudness, heard: Echoes, cell: float,
    reflection: NDArray[np.float64], table: NDArray[np.float64], own: NDArray[np.float64],
    storey: NDArray[np.float64], amplitudes: NDArray[np.complex128], out: NDArray[np.complex128],
) -> None:
    """Add the waveform to every ping's cells, `cell` apart; `loudness`, `table`, `own`, `storey` as in `add_up`.

    `out` has the shape (layers, N, cells): echoes of the first order, of the second and so on, in the last of them
    those of all that are left.
    """
    order, slant = len(loudness.strengths), len(table) > 0 or is_directed(loudness)
    paths = room_for_paths(order)
    half = paths.half
    reach = (len(heard.baseband) - 5) * heard.step
    on = _turn(2.0 * heard.carrier * cell)
    for i in range(len(heard.ends)):
        count = trace_paths(sides, heard.ends[i], order, heard.range_max, heard.soft, slant, storey, paths)
        for m in range(count):
            b = amplitudes[i] * amplitude(paths, m, heard.spreading, reflection, heard.yaw[i], loudness)
            place = half[m] + loudness.late * paths.hits[m]
            low, high = max(int(np.ceil((place - reach) / cell)), 0), int((place + reach) / cell)
            turned = b * _turn(2.0 * heard.carrier * (low * cell - half[m]) - _delay(paths, m, table, own))
            leaning = loudness.lean * half[m] / heard.step
            layer = min(paths.hits[m] + paths.bounces[m], len(out)) - 1
            for j in range(low, min(high, out.shape[2] - 1) + 1):
                lag = j * cell - place
                psi, rate = cubic(heard.baseband, abs(lag) / heard.step + 2.0)
                if leaning != 0.0:
                    psi += 1j * leaning * rate
                out[layer, i, j] += turned * (psi if lag >= 0.0 else psi.conjugate())
                turned *= on
