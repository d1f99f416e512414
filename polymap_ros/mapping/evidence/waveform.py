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

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.evidence.data import EchoData
from polymap_ros.mapping.evidence.paths import corners_of
from polymap_ros.mapping.evidence.wave_sums import Heard, Sums, add_up, predict

_LOSS_DEVIATION = 0.35
"""Prior standard deviation of ln |rho| about 0, as in `power`."""

_LEAST_REFLECTION = 1e-3
"""Reflection coefficient of a wall that is silent, where a logarithm is needed."""

_CONVERGED = 0.01
"""Nats that are not worth another step: a seventh of a standard deviation."""

_SMALL = 0.5
"""Nats that a step promises, one standard deviation's, below which it is the last: it changes neither the information
nor how the pings' scores differ, and what is left after it is second order."""

_LEAST_KNOWN = 1e-3
"""Share of the information about the walls that the phase leaves at least."""


@dataclass(frozen=True, eq=False)
class Wave:
    """Walls with signed reflection coefficients, and what their waveform says.

    Attributes
    ----------
    lines : ndarray, shape (n, 2)
        r [m] and theta [rad], sorted by theta.
    reflection : ndarray, shape (n,)
        Signed coefficients; 0 for a wall that bounds the polygon and is not heard.
    phase : float
        Phase of the device [rad].
    amplitudes : ndarray, shape (N,)
        A_i of each ping, in units of the noise.
    value : float
        L, with the prior of the losses.
    scores : ndarray, shape (N, 3 n)
        Gradient of each ping's share of L by (r, theta, ln |rho|) of each wall, without the prior; none if not derived.
    information : ndarray, shape (3 n, 3 n)
        Fisher information of the same with the prior, the amplitudes and the device's phase marginalised.
    """

    lines: NDArray[np.float64]
    reflection: NDArray[np.float64]
    phase: float
    amplitudes: NDArray[np.float64]
    value: float
    scores: NDArray[np.float64]
    information: NDArray[np.float64]

    @property
    def loss(self) -> NDArray[np.float64]:
        """Each wall's loss of power as `power.Model` has it, ln rho^2; a silent wall's is finite."""
        return np.asarray(2.0 * np.log(np.maximum(np.abs(self.reflection), _LEAST_REFLECTION)))


class WaveformLikelihood:
    """L of this module for the pings of `data`."""

    def __init__(self, data: EchoData) -> None:
        self.data, pulse = data, data.pulse
        self._heard = Heard(data.ends, data.signal, data.range_max_m, data.soft_m, data.spreading, pulse.step_m,
                             pulse.carrier, pulse.baseband, pulse.curvature)

    def signs(self, lines: NDArray[np.float64], loss: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Signed reflection coefficients and the device's phase, from the first-order echoes alone.

        The phase that all walls share up to their signs maximises Re[exp(-2 j phi) sum_k s_k^2], s_k the
        sum of wall k's echoes. The majority is positive: phi + pi with all signs turned gives the same echoes of odd
        order, and only those of even order tell which it is.
        """
        sums = np.array([self._first_order(line) for line in lines])
        phase = 0.5 * float(np.angle(np.sum(sums**2))) if np.any(sums) else 0.0
        signs = np.where(np.real(sums * np.exp(-1j * phase)) >= 0.0, 1.0, -1.0)
        if np.sum(signs * np.abs(sums)) < 0.0:
            signs, phase = -signs, phase + np.pi
        return signs * np.exp(loss / 2.0), phase

    def _first_order(self, line: NDArray[np.float64]) -> complex:
        data, pulse = self.data, self.data.pulse
        normal, along = np.array([[np.cos(line[1]), np.sin(line[1])], [-np.sin(line[1]), np.cos(line[1])]])
        away = line[0] - data.positions @ normal
        aside, up = data.baselines[:, :2] @ along, data.baselines[:, 2]
        d = np.where(away > 0.0, np.sqrt(away**2 + 0.25 * (aside**2 + up**2)), 0.0)
        cell = np.rint(d / pulse.step_m).astype(int)
        inside = (cell > 0) & (d < data.range_max_m)
        heard = data.signal[inside, cell[inside]] * np.exp(2j * pulse.carrier * cell[inside] * pulse.step_m)
        # Nearest sample: the phase is carried over the rest of the step with the carrier.
        heard *= np.exp(2j * pulse.carrier * (d[inside] - cell[inside] * pulse.step_m))
        return complex(np.sum(heard * d[inside] ** -data.spreading))

    def evaluate(
        self, lines: NDArray[np.float64], reflection: NDArray[np.float64], phase: float, order: int,
        derive: bool = True,
    ) -> Wave | None:
        """L and its derivatives at given walls, sorted by theta; None where they bound no polygon."""
        closed, corners = corners_of(lines, self.data.shortest_m)
        if not closed:
            return None
        sums = self._sums(corners, order, reflection, derive)
        v = np.maximum(sums.v, 1e-300)
        for _ in range(2):  # pings that disagree have no say in the phase
            agreeing = np.maximum(np.real(sums.u * np.exp(-1j * phase)), 0.0)
            if np.any(agreeing):
                phase = float(np.angle(np.sum(sums.u * agreeing / v)))
        amplitudes = np.maximum(np.real(sums.u * np.exp(-1j * phase)), 0.0) / v
        loss = np.log(np.maximum(np.abs(reflection[reflection != 0.0]), 1e-6))
        value = float(np.sum(0.5 * amplitudes**2 * v)) - 0.5 * float(np.sum(loss**2)) / _LOSS_DEVIATION**2
        if not derive:
            return Wave(lines, reflection, phase, amplitudes, value, np.empty((0, 0)), np.empty((0, 0)))
        n, by_wall = len(lines), np.arange(3 * len(lines)).reshape(3, -1).T.ravel()
        turned = (amplitudes * np.exp(-1j * phase))[:, None] * sums.x
        scores = (turned.real - amplitudes[:, None] ** 2 * sums.p)[:, by_wall]
        information = np.tensordot(amplitudes**2, sums.information, 1)
        information[2 * n:, :2 * n] = information[:2 * n, 2 * n:].T
        own = (amplitudes / np.sqrt(v))[:, None] * sums.p
        information = (information - own.T @ own)[np.ix_(by_wall, by_wall)]
        information = _with_phase(_with_prior(information, reflection), turned.imag.sum(axis=0)[by_wall] * (
            np.repeat(reflection, 3) != 0.0), float(np.sum(amplitudes**2 * v)))
        return Wave(lines, reflection, phase, amplitudes, value, scores, information)

    def shares(self, wave: Wave, order: int) -> NDArray[np.float64]:
        """Each ping's share (N,) of L for the walls and the phase of a waveform, its amplitude at its best."""
        closed, corners = corners_of(wave.lines, self.data.shortest_m)
        if not closed:
            return np.zeros(len(self.data.positions))
        sums = self._sums(corners, order, wave.reflection, False)
        agreeing = np.maximum(np.real(sums.u * np.exp(-1j * wave.phase)), 0.0)
        return np.asarray(0.5 * agreeing**2 / np.maximum(sums.v, 1e-300))

    def refine(
        self, lines: NDArray[np.float64], reflection: NDArray[np.float64], phase: float, order: int,
        iterations: int = 6,
    ) -> Wave | None:
        """Climb to the nearest maximum of L (Gauss-Newton, a parabola where a step leads too far); None where no
        polygon is bounded.
        """
        wave = self.evaluate(lines, reflection, phase, order)
        for _ in range(iterations):
            if wave is None:
                return None
            step, expected = _step(wave)
            if expected < _CONVERGED:
                return wave
            share = 1.0
            for _ in range(3):
                trial = self._moved(wave, share * step, order)
                if trial is not None and trial.value > wave.value:
                    if expected < _SMALL:
                        return dataclasses.replace(trial, scores=wave.scores, information=wave.information)
                    trial = self.evaluate(trial.lines, trial.reflection, trial.phase, order)
                    break
                loss = 0.0 if trial is None else wave.value - trial.value
                # The maximum of the parabola with the gradient here and the value there.
                share *= max(expected * share / (2.0 * expected * share + loss), 0.1)
            else:
                return wave
            wave = trial
        return wave

    def _moved(self, wave: Wave, step: NDArray[np.float64], order: int) -> Wave | None:
        lines = wave.lines + step[:, :2]
        reflection = np.sign(wave.reflection) * np.minimum(np.abs(wave.reflection) * np.exp(
            np.clip(step[:, 2], -0.5, 0.5)), 1.0)
        by_angle = np.argsort(lines[:, 1], kind='stable')
        return self.evaluate(
            np.ascontiguousarray(lines[by_angle]), reflection[by_angle], wave.phase, order, derive=False)

    def _sums(
        self, corners: NDArray[np.float64], order: int, reflection: NDArray[np.float64], derive: bool
    ) -> Sums:
        pings, size = len(self.data.positions), 3 * len(corners) if derive else 0
        sums = Sums(np.zeros(pings, complex), np.zeros(pings), np.zeros((pings, size), complex),
                     np.zeros((pings, size)), np.zeros((pings, size, size)))
        add_up(corners, order, self._heard, reflection, derive, sums)
        return sums

    def residual_power(self, wave: Wave, order: int) -> NDArray[np.float64]:
        """Half the squared magnitude of what the waveform leaves, on the cells of `data.power`."""
        _, corners = corners_of(wave.lines)
        data, pulse = self.data, self.data.pulse
        stride = round(data.cell_m / pulse.step_m)
        cells = np.arange(data.power.shape[1])
        heard = data.signal[:, cells * stride] * np.exp(2j * pulse.carrier * cells * data.cell_m)
        predicted = np.zeros_like(heard, dtype=complex)
        predict(corners, order, self._heard, data.cell_m, wave.reflection, wave.amplitudes * np.exp(1j * wave.phase),
                 predicted)
        return np.asarray(0.5 * np.abs(heard - predicted) ** 2 + self.data.filling[:, None])


def gradient(wave: Wave) -> NDArray[np.float64]:
    """Gradient (3 n,) of L with the prior of the losses; what is not heard is held fast.

    That a path fades at the soft end of a wall (`EchoData.soft_m`) is left out, as is the decay with range.
    """
    slope: NDArray[np.float64] = wave.scores.sum(axis=0)
    slope[2::3] -= np.log(np.maximum(np.abs(wave.reflection), 1e-6)) / _LOSS_DEVIATION**2
    slope[np.repeat(wave.reflection == 0.0, 3)] = 0.0
    return slope


def _step(wave: Wave) -> tuple[NDArray[np.float64], float]:
    """Gauss-Newton step (n, 3) in r, theta and ln |rho|, and what L is expected to gain by it."""
    slope, information = gradient(wave), wave.information.copy()
    full = np.zeros(len(slope), np.bool_)
    full[2::3] = (np.abs(wave.reflection) >= 1.0) & (slope[2::3] > 0.0)  # no wall reflects more than all
    slope[full], information[full], information[:, full] = 0.0, 0.0, 0.0
    information[full, full] = 1.0
    step = np.asarray(np.linalg.solve(information, slope), dtype=float)
    return step.reshape(-1, 3), 0.5 * float(slope @ step)


def _with_prior(information: NDArray[np.float64], reflection: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fisher information with the prior of the losses and, where a wall is not heard, 1."""
    size = len(information)
    information[range(2, size, 3), range(2, size, 3)] += 1.0 / _LOSS_DEVIATION**2
    quiet = np.repeat(reflection == 0.0, 3) | (np.diag(information) <= 0.0)
    information[quiet], information[:, quiet] = 0.0, 0.0
    information[quiet, quiet] = 1.0
    information[range(size), range(size)] *= 1.0 + 1e-6
    return information


def _with_phase(information: NDArray[np.float64], cross: NDArray[np.float64], phase: float) -> NDArray[np.float64]:
    """Fisher information with the device's phase marginalised, which trades against all ranges.

    Without it, walls that all move by the same r would seem to change little, and the steps be far too short.
    """
    # Where the echoes fit badly, the cross term may claim more than the walls know; they keep a little of it.
    taken = float(cross @ np.linalg.solve(information, cross))
    return information - np.outer(cross, cross) / max(phase, taken / (1.0 - _LEAST_KNOWN), 1e-300)
