r"""Echoes by the wave equation: everything that image sources leave out, such as diffraction, any number of times.

In the room D the pressure-like field u of a source at s obeys the Helmholtz equation with the wavenumber k of the
medium at every frequency, and all walls reflect whole and in phase: its slope across a wall is 0. Then Green's theorem
leaves an integral over the walls,

    u(x) / 2 + int u(y) dG(x, y) / dn_y ds_y = G(x, s),    G = H_0^(2)(k |x - y|) / 4j,

whose solution at x on the walls gives the echoes at the receiver, -int u dG/dn ds [1]. It is solved by Nystroem's
method with Gauss-Legendre panels, finer towards corners; the singular part of dG/dn is that of ln |x - y|, whose
integral over the walls is -1/2 exactly, and makes up for what the rule leaves of it [2].

So that nothing that comes after the window's end turns up in it, u is sought at frequencies w - j eta, which damps the
time signal by exp(-eta t), and that is taken back at the end. A tenth of a minute to several minutes of one core for a
scene, all of its pings together.

[1] D. Colton, R. Kress, "Inverse Acoustic and Electromagnetic Scattering Theory", section 3.1.
[2] R. Kress, "Linear Integral Equations", chapter 12.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy.special
from numpy.typing import ArrayLike, NDArray

from polymap_ros.acoustics.medium import Medium, make_medium
from polymap_ros.acoustics.pulse import Pulse
from polymap_ros.errors import SceneError
from polymap_ros.jit import kernel
from polymap_ros.simulation.edges import Edges
from polymap_ros.simulation.height import Height
from polymap_ros.simulation.inside import Hole
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import emitted

FLOOR = 3e-3
"""Frequencies at which the pulse is weaker than this, relative to its strongest, are left out."""

_DAMPING = 7.0
"""What lasts longer than the window is damped by exp of this, to a thousandth."""

_PANEL_WAVES, _PANEL_POINTS = 2.0, 12
"""Length of a panel in wavelengths, and its points: against images in a rectangle 2e-5 of an echo (measured)."""

_HALVINGS, _CORNER_POINTS = 4, 6
"""How often panels beside a corner are halved towards it, and points of these: 1e-4 of the echoes of an L (measured
against 8 and 10)."""

_TABLE = 4000
"""Places at which H_1 is worked out; in between it is interpolated over the root of the distance, 1e-6 off."""


def wave_echoes(scene: Scene) -> NDArray[np.float64]:
    """Return what a scene's pings hear by the wave equation, without noise (T, n_samples); `order` does not matter.

    It takes the place of `clean` in `waveforms.simulate` and `waveforms.pings`.

    Raises
    ------
    SceneError
        For what it does not know: walls that do not reflect everything, inner walls, edges that turn the phase, height,
        spreading other than that of a plane (0.5), and what `Faults` does to echoes one by one.
    """
    _check(scene)
    medium, pulse = make_medium(scene.medium), emitted(scene)
    period_s = scene.period_s
    size = scene.n_samples + int(np.ceil((abs(scene.t0_s) + 2.0 * pulse.duration_s) / period_s))
    eta = _DAMPING / (size * period_s)
    omega = 2.0 * np.pi / (size * period_s) * np.arange(1.0, size // 2)
    strength = _damped_spectrum(pulse, omega, eta, period_s) * medium.excitability(omega)
    loud = np.flatnonzero(np.abs(strength) > FLOOR * np.abs(strength).max())
    wavenumber = _damped_wavenumber(medium, omega[loud], eta)
    rings = [scene.vertices, *(hole.vertices for hole in scene.holes if isinstance(hole, Hole))]
    spectrum = np.zeros((len(scene.poses), size // 2 + 1), complex)
    for at, k in zip(loud, wavenumber, strict=True):
        # G far away is exp(-j k d) / sqrt(k d), as g of eq. (1), but for this.
        far = 4.0 * np.exp(0.25j * np.pi) * np.sqrt(0.5 * np.pi * k.real)
        spectrum[:, at + 1] = far * strength[at] * np.exp(1j * omega[at] * scene.t0_s) * scattered(
            rings, *scene.ends, k, scene.circles)
    times = scene.t0_s + period_s * np.arange(scene.n_samples)
    return np.asarray(np.fft.irfft(spectrum, size)[:, :scene.n_samples] / period_s * np.exp(eta * times))


def _check(scene: Scene) -> None:
    coefficients = [scene.reflection, *(hole.reflection for hole in scene.holes)]
    if any(np.any(np.asarray(each) != 1.0) for each in coefficients) or scene.inner_walls:
        raise SceneError('the wave equation is solved for walls that reflect everything in phase: set reflection to 1 '
                         'and leave out inner_walls')
    if scene.edges != Edges() or scene.height != Height() or scene.sensor.baseline_z_m:
        raise SceneError('the wave equation is solved in the plane, for edges that do not turn the phase; leave out '
                         'edges, height and sensor.baseline_z_m')
    if (spreading := make_medium(scene.medium).spreading) != 0.5:
        raise SceneError(f'waves in a plane fall off with the root of the distance, those of medium.model '
                         f'{scene.medium.model} with its power {spreading:g}')
    if scene.faults.missing_first or scene.faults.false_first or scene.faults.second_mode:
        raise SceneError('the wave equation knows no single echoes: leave out missing_first, false_first and '
                         'second_mode')


def _damped_spectrum(pulse: Pulse, omega: NDArray[np.float64], eta: float, period_s: float) -> NDArray[np.complex128]:
    """Fourier transform of s(t) exp(-eta t), by the trapezoidal rule at 16 points a sample."""
    fine_s = period_s / 16.0
    wave = pulse.samples(fine_s)
    times = fine_s * np.arange(len(wave))
    return np.asarray(fine_s * np.exp(-1j * omega[:, None] * times) @ (wave * np.exp(-eta * times)))


def _damped_wavenumber(medium: Medium, omega: NDArray[np.float64], eta: float) -> NDArray[np.complex128]:
    """k(w - j eta), by Taylor's series to the second order."""
    step = 1e-3 * omega
    below, here, above = (medium.wavenumber(omega + shift * step) for shift in (-1.0, 0.0, 1.0))
    slope, bend = (above - below) / (2.0 * step), (above - 2.0 * here + below) / step**2
    return np.asarray(here - 1j * eta * slope - 0.5 * eta**2 * bend)


class _Mesh(NamedTuple):
    """Points (m, 2) on the walls [m], outward normals (m, 2) and weights (m,) [m] of the rule."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    weights: NDArray[np.float64]


def scattered(
    rings: list[NDArray[np.float64]], emitters: NDArray[np.float64], receivers: NDArray[np.float64],
    wavenumber: complex, circles: ArrayLike = (),
) -> NDArray[np.complex128]:
    """Return the field that walls send back from each emitter to its receiver.

    Parameters
    ----------
    rings : list of ndarray, shape (n, 2)
        Corners of the outline and of holes [m], with the room on the left of the edges.
    emitters, receivers : ndarray, shape (T, 2)
        Places in the room, in pairs [m].
    wavenumber : complex
        k [rad/m]; its imaginary part, below 0, damps.
    circles : array_like, shape (c, 3) or more, optional
        Centre and radius of round holes [m].

    Returns
    -------
    ndarray, shape (T,), complex
        The field of sources whose own is G.
    """
    mesh = _mesh(rings, circles, _PANEL_WAVES * 2.0 * np.pi / wavenumber.real)
    step = np.sqrt(1.1 * np.hypot(*np.ptp(mesh.points, axis=0))) / _TABLE
    argument = wavenumber * (step * np.maximum(np.arange(_TABLE + 2), 0.03)) ** 2
    table = argument * scipy.special.hankel2e(1, argument)
    matrix = np.zeros((len(mesh.points), len(mesh.points)), complex)
    _add_slopes(mesh.points, *mesh, wavenumber, table, step, matrix)
    matrix[np.diag_indices(len(matrix))] += _static(*mesh)
    apart = np.hypot(*(mesh.points[:, None] - emitters[None]).transpose(2, 0, 1))
    walls = np.linalg.solve(matrix, -0.25j * scipy.special.hankel2(0, wavenumber * apart))
    heard = np.zeros((len(receivers), len(matrix)), complex)
    _add_slopes(receivers, *mesh, wavenumber, table, step, heard)
    return np.asarray(-np.einsum('tj,jt->t', heard, walls))


def _mesh(rings: list[NDArray[np.float64]], circles: ArrayLike, longest_m: float) -> _Mesh:
    """Panels of all edges, beside corners ever shorter, and of circles."""
    points, normals, weights = [], [], []
    for ring in rings:
        for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            along = end - start
            length = np.hypot(*along)
            count = max(int(np.ceil(length / longest_m)), 2)
            whole = np.arange(1, count) / count
            short = whole[0] * 0.5 ** np.arange(_HALVINGS, 0, -1)
            cuts = np.concatenate(([0.0], short, whole, 1.0 - short[::-1], [1.0]))
            for low, high in pairwise(cuts):
                node, weight = np.polynomial.legendre.leggauss(
                    _PANEL_POINTS if high - low > 0.9 / count else _CORNER_POINTS)
                share = 0.5 * (low + high) + 0.5 * (high - low) * node
                points.append(start + share[:, None] * along)
                weights.append(0.5 * (high - low) * length * weight)
                normals.append(np.tile((along[1] / length, -along[0] / length), (len(node), 1)))
    node, weight = np.polynomial.legendre.leggauss(_PANEL_POINTS)
    for x, y, radius, *_ in np.asarray(circles, dtype=float):
        count = max(int(np.ceil(2.0 * np.pi * radius / longest_m)), 8)
        turn = (np.pi / count * (2.0 * np.arange(count)[:, None] + 1.0 + node)).ravel()
        outwards = np.column_stack((-np.cos(turn), -np.sin(turn)))  # of the room
        points.append(np.array((x, y)) - radius * outwards)
        normals.append(outwards)
        weights.append(np.tile(np.pi / count * radius * weight, count))
    return _Mesh(np.vstack(points), np.vstack(normals), np.concatenate(weights))


@kernel
def _add_slopes(
    places: NDArray[np.float64], points: NDArray[np.float64], normals: NDArray[np.float64],
    weights: NDArray[np.float64], wavenumber: complex, table: NDArray[np.complex128], step: float,
    out: NDArray[np.complex128],
) -> None:
    """Add w_j dG(x_i, y_j) / dn_y; `table` has z H_1(z) exp(j z) at roots of the distance, `step` apart."""
    for i in range(len(places)):
        for j in range(len(points)):
            dx, dy = points[j, 0] - places[i, 0], points[j, 1] - places[i, 1]
            across = dx * normals[j, 0] + dy * normals[j, 1]
            square = dx * dx + dy * dy
            if abs(across) > 1e-12 * square:  # else on one straight wall
                distance = np.sqrt(square)
                place = np.sqrt(distance) / step
                low = int(place)
                slope = table[low] + (place - low) * (table[low + 1] - table[low])
                out[i, j] += 0.25j * slope * np.exp(-1j * wavenumber * distance) * across / square * weights[j]


@kernel
def _static(
    points: NDArray[np.float64], normals: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return at each point what 1/2 and the rule for the slope of -ln |x - y| / 2 pi have in sum to be made up for."""
    total = np.zeros(len(points))
    for i in range(len(points)):
        for j in range(len(points)):
            dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            if i != j:
                total[i] += (dx * normals[j, 0] + dy * normals[j, 1]) / (dx * dx + dy * dy) * weights[j]
    return total / (2.0 * np.pi)
