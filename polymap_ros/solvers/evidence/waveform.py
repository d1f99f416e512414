r"""Evidence with phase: the waveform that the walls predict, against the waveform that was heard.

In units of the noise, a ping's correlation c(r) of eq. (3) is, for a real amplitude A_i and a phase phi of the device,

    c_i(r) = A_i exp(j phi) sum_m b_m psi(r - d_m) + noise,   b_m = d_m^-p prod(signed rho),

where psi is the compressed pulse and the noise is coloured by psi too. The log likelihood ratio against noise needs
only look-ups at the predicted ranges: with u_i = sum_m b_m Re[exp(-j phi) c_i(d_m)] and
v_i = sum_mn b_m b_n Re psi(d_m - d_n),

    L = sum_i A_i u_i - A_i^2 v_i / 2   =   sum_i max(u_i, 0)^2 / (2 v_i)   at the best A_i.

The matrix psi explains every echo once. Derivatives by the walls' r, theta and ln |rho| follow from those of the d_m,
J: with x_i = sum_m b_m c_i'(d_m) J_m and p_i = sum_mn b_m b_n Re psi'(d_m - d_n) J_m, a ping's score is
A Re[exp(-j phi) x_i] - A^2 p_i, and its Fisher information A^2 (sum_mn b_m b_n (-Re psi'')(d_m - d_n) J_m J_n^T
- p_i p_i^T / v_i), the second term being what A_i, which follows the walls, takes of it. One pass over the pings gives
all of these for any amplitudes and any phase.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.paths import first_orders
from polymap_ros.geometry.sides import Sides
from polymap_ros.geometry.storey import Storey
from polymap_ros.solvers.evidence.climb import climb
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.edge_phase import COMMON, REAL, EdgePhase
from polymap_ros.solvers.evidence.likelihood import Slopes
from polymap_ros.solvers.evidence.loudness import PLAIN, Loudness
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.wave_sums import Echoes, Sums, add_up, predict

_FARTHEST_RAD = 0.3
"""Largest step of the edges' phases: beyond it an echo is no longer linear in them to a tenth."""

_FAINT_ORDER = 1e-9
"""Share of their power by which the squares of echoes order by order are raised: of an order may be none."""


@dataclass(frozen=True, eq=False)
class Wave:
    """Walls under the likelihood of the waveform.

    Parameters
    ----------
    walls : Walls
        The walls, their coefficients signed.
    phase : float
        Phase of the device [rad].
    value : float
        L with the log prior of the walls.
    amplitudes : ndarray, shape (N,)
        A_i of each ping, in units of the noise.
    slopes : Slopes or None
        Derivatives, if they were asked for.
    edge : EdgePhase
        What every reflection delays the phase by.
    loudness : Loudness
        What echoes count for by order, direction and length, beside what walls take.
    storey : Storey
        Floor and ceiling.
    """

    walls: Walls
    phase: float
    value: float
    amplitudes: NDArray[np.float64]
    slopes: Slopes | None = None
    edge: EdgePhase = REAL
    loudness: Loudness = PLAIN
    storey: Storey = field(default_factory=Storey)

    @property
    def unknowns(self) -> Walls:
        """The walls."""
        return self.walls

    def with_slopes(self, slopes: Slopes | None) -> 'Wave':
        """Return the same with these derivatives."""
        return replace(self, slopes=slopes)

    def with_walls(self, walls: Walls) -> 'Wave':
        """Return the same with other walls, not evaluated."""
        return replace(self, walls=walls, slopes=None)

    def of_pings(self, pings: slice) -> 'Wave':
        """Return the same for some of the pings."""
        return replace(self, amplitudes=self.amplitudes[pings], slopes=None)

    def turned(self) -> 'Wave':
        """Return the same with all signs turned, which gives the same echoes of odd order; not evaluated."""
        return replace(self, walls=replace(self.walls, reflection=-self.walls.reflection), phase=self.phase + np.pi)


class WaveformLikelihood:
    """L of this module for the pings of `data`.

    The derivatives leave out that a path fades at the soft end of a wall (`EchoData.soft_m`), and the decay with range.
    """

    damping = 0.0
    derives_at_once = False

    def __init__(self, data: EchoData) -> None:
        self.data, pulse = data, data.pulse
        self._heard = Echoes(data.ends, data.signal, data.range_max_m, data.soft_m, data.spreading, pulse.step_m,
                            pulse.carrier, pulse.baseband, pulse.curvature, np.ascontiguousarray(data.poses[:, 2]))
        self._most = np.maximum(data.weight * data.power.sum(axis=1), 1e-300)  # nats of all that a ping heard

    def begun(self, walls: Walls, edge: EdgePhase = REAL, storey: Storey | None = None) -> Wave:
        """Return signed coefficients and the device's phase, from the first-order echoes alone; not evaluated.

        The phase that all walls share up to their signs maximises Re[exp(-2 j phi) sum_k s_k^2], s_k the
        sum of wall k's echoes. The majority is positive: phi + pi with all signs turned gives the same echoes of odd
        order, and only those of even order tell which it is.
        """
        sums = np.array([self._first_order(line) for line in walls.lines]) * np.exp(1j * edge.head_on)
        phase = 0.5 * float(np.angle(np.sum(sums**2))) if np.any(sums) else 0.0
        signs = np.where(np.real(sums * np.exp(-1j * phase)) >= 0.0, 1.0, -1.0)
        if np.sum(signs * np.abs(sums)) < 0.0:
            signs, phase = -signs, phase + np.pi
        walls = replace(walls, reflection=signs * np.abs(walls.reflection))
        return Wave(walls, phase, -np.inf, np.empty(0), edge=edge, storey=storey or Storey())

    def _first_order(self, line: NDArray[np.float64]) -> complex:
        data, pulse = self.data, self.data.pulse
        d, _ = first_orders(line, data.positions, data.baselines)
        cell = np.rint(d / pulse.step_m).astype(int)
        inside = (cell > 0) & (d < data.range_max_m)
        heard = data.signal[inside, cell[inside]] * np.exp(2j * pulse.carrier * cell[inside] * pulse.step_m)
        # Nearest sample: the phase is carried over the rest of the step with the carrier.
        heard *= np.exp(2j * pulse.carrier * (d[inside] - cell[inside] * pulse.step_m))
        return complex(np.sum(heard * d[inside] ** -data.spreading))

    def evaluate(self, walls: Walls, like: Wave, order: int, derive: bool = False) -> Wave | None:
        """Return L at the phases that fit the walls best, near those of another; None without an outline."""
        bound, sides = self._sides(walls)
        if not bound:
            return None
        if like.edge.by_wall and not len(walls.delay):
            walls = replace(walls, delay=np.zeros(len(walls)))
        here = self._at(sides, walls, like, order, derive or like.edge.free)
        if not like.edge.free:
            return here
        assert here.slopes is not None, 'derivatives were asked for'
        edge, walls = _mended(here.edge, walls, here.slopes)
        better = self._at(sides, walls, replace(here, edge=edge), order, derive)
        return better if better.value > here.value else here

    def _at(self, sides: Sides, walls: Walls, like: Wave, order: int, derive: bool) -> Wave:
        """Return L at the device's phase that fits best, near that of another, and its `edge`."""
        sums = self._sums(sides, like, order, walls, derive)
        v, phase = self._norms(sums), like.phase
        for _ in range(2):  # pings that disagree have no say in the phase
            agreeing = np.maximum(np.real(sums.u * np.exp(-1j * phase)), 0.0)
            if np.any(agreeing):
                phase = float(np.angle(np.sum(sums.u * agreeing / v)))
        amplitudes = np.maximum(np.real(sums.u * np.exp(-1j * phase)), 0.0) / v
        value = float(np.sum(0.5 * amplitudes**2 * v)) + walls.log_prior() + like.edge.log_prior(walls.delay)
        slopes = _slopes(sums, v, amplitudes, phase) if derive else None
        return Wave(walls, phase, value, amplitudes, slopes, like.edge, like.loudness, like.storey)

    def _norms(self, sums: Sums) -> NDArray[np.float64]:
        """Return |s|^2 of each ping (N,), no smaller than |<s, c>|^2 / |c|^2 allows, with a factor of two for sampling:
        paths that cancel leave nothing but rounding of both.
        """
        return np.asarray(np.maximum(sums.v, np.maximum(0.25 * np.abs(sums.u) ** 2 / self._most, 1e-300)))

    def gained(self, wave: Wave, edge: EdgePhase, order: int) -> float:
        """Return what L would gain by what is looked for of `edge`, the walls following, by its parabola about here."""
        _, sides = self._sides(wave.walls)
        walls = replace(wave.walls, delay=np.zeros(len(wave.walls))) if edge.by_wall else wave.walls
        slopes = self._at(sides, walls, replace(wave, edge=edge), order, True).slopes
        assert slopes is not None, 'derivatives were asked for'
        gradient, about = _about_edge(edge, walls, slopes)
        across, information = walls.by_phase(slopes), walls.information(slopes)
        information[walls.quiet, walls.quiet] += 1.0
        about -= across.T @ np.linalg.lstsq(information, across, rcond=1e-9)[0]
        return 0.5 * float(gradient @ np.linalg.lstsq(about, gradient, rcond=1e-9)[0])

    def shares(self, wave: Wave, order: int) -> NDArray[np.float64]:
        """Return each ping's share (N,) of L at the phase of a waveform, its amplitude at its best."""
        bound, sides = self._sides(wave.walls)
        if not bound:
            return np.zeros(len(self.data.positions))
        sums = self._sums(sides, wave, order, wave.walls, False)
        agreeing = np.maximum(np.real(sums.u * np.exp(-1j * wave.phase)), 0.0)
        return np.asarray(0.5 * agreeing**2 / self._norms(sums))

    def by_ping(self, wave: Wave, order: int) -> tuple[NDArray[np.float64], Slopes]:
        """Return each ping's share (N,) of L at the phase of a waveform, and its slopes."""
        _, sides = self._sides(wave.walls)
        sums = self._sums(sides, wave, order, wave.walls, True)
        v = self._norms(sums)
        amplitudes = np.maximum(np.real(sums.u * np.exp(-1j * wave.phase)), 0.0) / v
        return 0.5 * amplitudes**2 * v, _slopes(sums, v, amplitudes, wave.phase)

    def refine(self, start: Wave, order: int, iterations: int = 6) -> Wave | None:
        """Return the nearest maximum of L over the walls; None where they are no outline."""
        return climb(self, self.evaluate(start.walls, start, order, derive=True), order, iterations)

    def _sides(self, walls: Walls) -> tuple[bool, Sides]:
        return walls.sides(self.data.soft_m, self.data.shortest_m)

    def _sums(self, sides: Sides, like: Wave, order: int, walls: Walls, derive: bool) -> Sums:
        pings, size = len(self.data.positions), 3 * len(walls) if derive else 0
        more = len(like.edge.sought(walls.delay)) if derive else 0
        sums = Sums(np.zeros(pings, complex), np.zeros(pings), np.zeros((pings, size), complex),
                    np.zeros((pings, size)), np.zeros((pings, size, size)), np.zeros((pings, more), complex),
                    np.zeros((pings, more)), np.zeros((pings, more)), np.zeros((pings, more, more)),
                    np.zeros((pings, size, more)))
        add_up(sides, like.loudness.up_to(order), self._heard, walls.reflection, like.edge.table,
               like.edge.own(walls.delay), like.storey.images(order, self.data.level), derive, sums)
        return sums

    def residual_power(self, wave: Wave, order: int) -> NDArray[np.float64]:
        """Return half the squared magnitude of what the waveform leaves, on the cells of `data.power`."""
        return self._left(self._on_cells() - self._predicted(wave, wave.loudness.strengths[:order], 1)[0])

    def by_order(self, wave: Wave, order: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the strengths (order,) of the echoes of each order that fit best, none below 0, and what they leave.

        That is as in `residual_power`.
        """
        from scipy.optimize import nnls  # takes a tenth of a second to load

        heard, layers = self._on_cells(), self._predicted(wave, np.ones(order), order)
        inside = layers[:, :, self.data.first_cell:].reshape(order, -1)
        square = np.real(inside.conj() @ inside.T)
        if np.trace(square) == 0.0:  # nothing is predicted within the range
            return np.zeros(order), self._left(heard)
        root = np.linalg.cholesky(square + _FAINT_ORDER * np.trace(square) * np.eye(order))
        along = np.real(inside.conj() @ heard[:, self.data.first_cell:].ravel())
        strengths, _ = nnls(root.T, np.linalg.solve(root, along))
        return strengths, self._left(heard - np.tensordot(strengths, layers, 1))

    def left_without_carrier(self, wave: Wave) -> NDArray[np.complex128]:
        """Return what a waveform leaves of the signal, without the carrier, on the cells of `data.power`."""
        return self.without_carrier() - self.without_carrier(wave)

    def without_carrier(self, wave: Wave | None = None) -> NDArray[np.complex128]:
        """Return what is heard, or what a waveform predicts, without the carrier, on the cells of `data.power`."""
        ranges = self.data.cell_m * np.arange(self.data.power.shape[1])
        signal = self._on_cells() if wave is None else self._predicted(wave, wave.loudness.strengths, 1)[0]
        return np.asarray(signal * np.exp(-2j * self.data.pulse.carrier * ranges))

    def _on_cells(self) -> NDArray[np.complex128]:
        """The signal on the cells of `data.power`."""
        data, pulse = self.data, self.data.pulse
        cells = np.arange(data.power.shape[1])
        signal = data.signal[:, cells * round(data.cell_m / pulse.step_m)]
        return np.asarray(signal * np.exp(2j * pulse.carrier * cells * data.cell_m))

    def _predicted(self, wave: Wave, strengths: NDArray[np.float64], layers: int) -> NDArray[np.complex128]:
        """The same as the walls predict it, order by order up to the last of the layers."""
        _, sides = self._sides(wave.walls)
        predicted = np.zeros((layers, *self.data.power.shape), complex)
        loudness = wave.loudness._replace(strengths=strengths)
        predict(sides, loudness, self._heard, self.data.cell_m, wave.walls.reflection, wave.edge.table,
                wave.edge.own(wave.walls.delay), wave.storey.images(len(strengths), self.data.level),
                wave.amplitudes * np.exp(1j * wave.phase), predicted)
        return predicted

    def _left(self, waveform: NDArray[np.complex128]) -> NDArray[np.float64]:
        return np.asarray(0.5 * np.abs(waveform) ** 2 + self.data.filling[:, None])


def _slopes(sums: Sums, v: NDArray[np.float64], amplitudes: NDArray[np.float64], phase: float) -> Slopes:
    """Return the derivatives that the sums add up to, each ping's amplitude marginalised.

    The phases are the device's, turned the other way, and those of `edge_phase`: both delay an echo.
    """
    turned = (amplitudes * np.exp(-1j * phase))[:, None] * sums.x
    scores = turned.real - amplitudes[:, None] ** 2 * sums.p
    n = sums.p.shape[1] // 3
    information = amplitudes[:, None, None] ** 2 * sums.information
    information[:, 2 * n:, :2 * n] = np.swapaxes(information[:, :2 * n, 2 * n:], 1, 2)
    own = (amplitudes / np.sqrt(v))[:, None] * sums.p
    information -= own[:, :, None] * own[:, None, :]
    by_phase, about_phase = turned.imag[:, :, None], (amplitudes**2 * v)[:, None, None]
    if not sums.edge_x.shape[1]:
        return Slopes(scores, information, by_phase, about_phase)
    edges = (amplitudes * np.exp(-1j * phase))[:, None] * sums.edge_x
    edge_own, square = (amplitudes / np.sqrt(v))[:, None] * sums.edge_p, amplitudes[:, None, None] ** 2
    across = square * sums.across - own[:, :, None] * edge_own[:, None, :]
    about = square * sums.edge_information - edge_own[:, :, None] * edge_own[:, None, :]
    beside = (amplitudes[:, None] ** 2 * sums.edge_v)[:, None, :]
    above, below = (about_phase, beside), (np.swapaxes(beside, 1, 2), about)
    about_phase = np.concatenate((np.concatenate(above, axis=2), np.concatenate(below, axis=2)), axis=1)
    edge_scores = edges.real - amplitudes[:, None] ** 2 * sums.edge_p
    return Slopes(scores, information, np.concatenate((by_phase, across), axis=2), about_phase, edge_scores)


def _mended(edge: EdgePhase, walls: Walls, slopes: Slopes) -> tuple[EdgePhase, Walls]:
    """Return the phases of reflections after a step of Gauss and Newton at fixed lines, the device's phase free."""
    gradient, about = _about_edge(edge, walls, slopes)
    step = np.clip(np.linalg.lstsq(about, gradient, rcond=1e-12)[0][1:], -_FARTHEST_RAD, _FARTHEST_RAD)
    more = step[COMMON:]
    return replace(edge, found=edge.found + step[:COMMON]), (
        replace(walls, delay=walls.delay + more) if len(more) else walls)


def _about_edge(
    edge: EdgePhase, walls: Walls, slopes: Slopes
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return gradient (q,) and information (q, q) about the phases with the prior; the device's is at its best."""
    about, precision = slopes.phase.sum(axis=0), edge.precision(len(walls))
    about[1:, 1:] += np.diag(precision)
    return np.concatenate(((0.0,), slopes.by_edge.sum(axis=0) - edge.sought(walls.delay) * precision)), about
