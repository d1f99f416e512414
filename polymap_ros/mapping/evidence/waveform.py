r"""Evidence with phase: the waveform that the walls predict, against the waveform that was heard.

In units of the noise, a ping's correlation c(r) of eq. (3) is, for a real amplitude A_i and a phase phi of the device,

    c_i(r) = A_i exp(j phi) sum_m b_m psi(r - d_m) + noise,   b_m = d_m^-p prod(signed rho),

where psi is the compressed pulse and the noise is coloured by psi too. The log likelihood ratio against noise needs
only look-ups at the predicted ranges: with u_i = sum_m b_m Re[exp(-j phi) c_i(d_m)] and
v_i = sum_mn b_m b_n Re psi(d_m - d_n),

    L = sum_i A_i u_i - A_i^2 v_i / 2   =   sum_i max(u_i, 0)^2 / (2 v_i)   at the best A_i.

The matrix psi explains every echo once. Derivatives by the walls' r, theta and ln |rho| follow from those of the d_m;
the Fisher information A^2 sum_mn b_m b_n (-Re psi'')(d_m - d_n) J_m J_n gives the step and the covariance.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.jit import kernel
from polymap_ros.mapping.evidence.data import EchoData
from polymap_ros.mapping.evidence.paths import CAPACITY, corners_of, path_derivatives, trace_paths

_LOSS_DEVIATION = 0.35
"""Prior standard deviation of ln |rho| about 0, as in `power`."""

_LEAST_KNOWN = 1e-3
"""Share of the information about the walls that the phase leaves at least."""

_TURN = 1e-4
"""Turn of the phase [rad] for a derivative by differences."""


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
        Gradient of each ping's share of L by (r, theta, ln |rho|) of each wall.
    information : ndarray, shape (3 n, 3 n)
        Fisher information of the same.
    """

    lines: NDArray[np.float64]
    reflection: NDArray[np.float64]
    phase: float
    amplitudes: NDArray[np.float64]
    value: float
    scores: NDArray[np.float64]
    information: NDArray[np.float64]


class WaveformLikelihood:
    """L of this module for the pings of `data`."""

    def __init__(self, data: EchoData) -> None:
        self.data = data

    def signs(self, lines: NDArray[np.float64], loss: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Signed reflection coefficients and the device's phase, from the first-order echoes alone.

        The phase that all walls share up to their signs maximises Re[exp(-2 j phi) sum_k s_k^2], s_k the
        sum of wall k's echoes; phi + pi with all signs turned is the same device, and the majority is positive.
        """
        sums = np.array([self._first_order(line) for line in lines])
        phase = 0.5 * float(np.angle(np.sum(sums**2))) if np.any(sums) else 0.0
        signs = np.where(np.real(sums * np.exp(-1j * phase)) >= 0.0, 1.0, -1.0)
        if np.sum(signs * np.abs(sums)) < 0.0:
            signs, phase = -signs, phase + np.pi
        return signs * np.exp(loss / 2.0), phase

    def _first_order(self, line: NDArray[np.float64]) -> complex:
        data, pulse = self.data, self.data.pulse
        d = line[0] - data.positions @ np.array([np.cos(line[1]), np.sin(line[1])])
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
        closed, corners = corners_of(lines)
        if not closed:
            return None
        u, v, scores, information = self._sums(lines, corners, order, reflection, None)
        v = np.maximum(v, 1e-300)
        for _ in range(2):  # pings that disagree have no say in the phase
            agreeing = np.maximum(np.real(u * np.exp(-1j * phase)), 0.0)
            if np.any(agreeing):
                phase = float(np.angle(np.sum(u * agreeing / v)))
        amplitudes = np.maximum(np.real(u * np.exp(-1j * phase)), 0.0) / v
        loss = np.log(np.maximum(np.abs(reflection[reflection != 0.0]), 1e-6))
        value = float(np.sum(0.5 * amplitudes**2 * v)) - 0.5 * float(np.sum(loss**2)) / _LOSS_DEVIATION**2
        if derive:
            *_, scores, information = self._sums(
                lines, corners, order, reflection, amplitudes * np.exp(1j * phase))
        return Wave(lines, reflection, phase, amplitudes, value, scores, information)

    def refine(
        self, lines: NDArray[np.float64], reflection: NDArray[np.float64], phase: float, order: int,
        iterations: int = 6,
    ) -> Wave | None:
        """Climb to the nearest maximum of L (Gauss-Newton with step halving); None where no polygon is bounded."""
        wave = self.evaluate(lines, reflection, phase, order)
        for _ in range(iterations):
            if wave is None:
                return None
            step = self._step(wave, order)
            for _ in range(6):
                trial = self._moved(wave, step, order)
                if trial is not None and trial.value > wave.value:
                    break
                step = step / 4.0
            else:
                return wave
            gain, wave = trial.value - wave.value, trial
            if gain < 0.01:
                break
        return wave

    def _step(self, wave: Wave, order: int) -> NDArray[np.float64]:
        """Gauss-Newton step (n, 3) in r, theta and ln |rho|, with the phase following the walls.

        Walls that all move by the same r change little but the phase: at a phase held fast the steps are far too short.
        """
        gradient, _ = self.penalised(wave)
        return np.asarray(np.linalg.solve(self.marginal_information(wave, order), gradient).reshape(-1, 3), dtype=float)

    def penalised(self, wave: Wave) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Gradient and Fisher information of L with the prior of the losses; what is not heard is held fast."""
        gradient, information = wave.scores.sum(axis=0), wave.information.copy()
        loss = np.log(np.maximum(np.abs(wave.reflection), 1e-6))
        gradient[2::3] -= loss / _LOSS_DEVIATION**2
        size = len(gradient)
        information[range(2, size, 3), range(2, size, 3)] += 1.0 / _LOSS_DEVIATION**2
        quiet = np.repeat(wave.reflection == 0.0, 3) | (np.diag(information) <= 0.0)
        gradient[quiet], information[quiet], information[:, quiet] = 0.0, 0.0, 0.0
        information[quiet, quiet] = 1.0
        diagonal = np.diag(information)
        information[range(size), range(size)] += 1e-6 * diagonal
        return gradient, information

    def _moved(self, wave: Wave, step: NDArray[np.float64], order: int) -> Wave | None:
        lines = wave.lines + step[:, :2]
        reflection = np.sign(wave.reflection) * np.minimum(np.abs(wave.reflection) * np.exp(
            np.clip(step[:, 2], -0.5, 0.5)), 1.0)
        by_angle = np.argsort(lines[:, 1], kind='stable')
        return self.evaluate(np.ascontiguousarray(lines[by_angle]), reflection[by_angle], wave.phase, order)

    def marginal_information(self, wave: Wave, order: int) -> NDArray[np.float64]:
        """Fisher information of the walls with the device's phase, which trades against all ranges, marginalised."""
        closed, corners = corners_of(wave.lines)
        _, information = self.penalised(wave)
        if not closed:
            return information
        turn = np.exp(1j * (wave.phase + _TURN))
        turned = self._sums(wave.lines, corners, order, wave.reflection, wave.amplitudes * turn)
        cross = (wave.scores - turned[2]).sum(axis=0) / _TURN
        cross[np.repeat(wave.reflection == 0.0, 3)] = 0.0
        # Where the echoes fit badly, the difference may claim more than the walls know; they keep a little of it.
        taken = float(cross @ np.linalg.solve(information, cross))
        phase = max(float(np.sum(wave.amplitudes**2 * turned[1])), taken / (1.0 - _LEAST_KNOWN), 1e-300)
        return information - np.outer(cross, cross) / phase

    def _sums(
        self, lines: NDArray[np.float64], corners: NDArray[np.float64], order: int, reflection: NDArray[np.float64],
        amplitudes: NDArray[np.complex128] | None,
    ) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """u_i, v_i and, where amplitudes are given, each ping's gradient and the Fisher information."""
        data, pulse = self.data, self.data.pulse
        n, pings = len(lines), len(data.positions)
        u, v = np.zeros(pings, complex), np.zeros(pings)
        scores, information = np.zeros((pings, 3 * n)), np.zeros((3 * n, 3 * n))
        _waveform_likelihood(
            lines, corners, data.positions, order, data.range_max_m, data.signal, pulse.step_m, pulse.carrier,
            pulse.baseband, pulse.curvature, data.spreading, reflection,
            np.zeros(pings, complex) if amplitudes is None else amplitudes, amplitudes is not None, u, v, scores,
            information)
        return u, v, scores, information

    def residual_power(self, wave: Wave, order: int) -> NDArray[np.float64]:
        """Half the squared magnitude of what the waveform leaves, on the cells of `data.power`."""
        _, corners = corners_of(wave.lines)
        data, pulse = self.data, self.data.pulse
        stride = round(data.cell_m / pulse.step_m)
        cells = np.arange(data.power.shape[1])
        heard = data.signal[:, cells * stride] * np.exp(2j * pulse.carrier * cells * data.cell_m)
        predicted = np.zeros_like(heard, dtype=complex)
        _predict(wave.lines, corners, data.positions, order, data.range_max_m, data.cell_m, pulse.step_m, pulse.carrier,
                 pulse.baseband, data.spreading, wave.reflection, wave.amplitudes * np.exp(1j * wave.phase), predicted)
        return np.asarray(0.5 * np.abs(heard - predicted) ** 2 + data.filling[:, None])


@kernel
def _cubic(y: NDArray[np.complexfloating], x: float) -> tuple[complex, complex]:
    """Value and derivative of the four-point Lagrange interpolant at index x."""
    j = int(x)
    f = x - j
    a, b, c, d = y[j - 1], y[j], y[j + 1], y[j + 2]
    one = -a / 3.0 - b / 2.0 + c - d / 6.0
    two = a / 2.0 - b + c / 2.0
    three = -a / 6.0 + b / 2.0 - c / 2.0 + d / 6.0
    return b + f * (one + f * (two + f * three)), one + f * (2.0 * two + 3.0 * f * three)


@kernel
def _amplitude(half: float, spreading: float, hits: int, walls: NDArray[np.int64],
               reflection: NDArray[np.float64]) -> float:
    b: float = half**-spreading
    for level in range(hits):
        b *= reflection[walls[level]]
    return b


@kernel
def _waveform_likelihood(
    lines: NDArray[np.float64],
    corners: NDArray[np.float64],
    positions: NDArray[np.float64],
    order: int,
    range_max: float,
    signal: NDArray[np.complex64],
    step: float,
    carrier: float,
    baseband: NDArray[np.complex128],
    curvature: NDArray[np.complex128],
    spreading: float,
    reflection: NDArray[np.float64],
    amplitudes: NDArray[np.complex128],
    derive: bool,
    u: NDArray[np.complex128],
    v: NDArray[np.float64],
    scores: NDArray[np.float64],
    information: NDArray[np.float64],
) -> None:
    found, walls = np.empty((CAPACITY, 2)), np.empty((CAPACITY, order), np.int64)
    half, hits = np.empty(CAPACITY), np.empty(CAPACITY, np.int64)
    b, slopes = np.empty(CAPACITY), np.empty((CAPACITY, order, 2))
    reach = (len(baseband) - 5) * step
    for i in range(len(positions)):
        count = trace_paths(corners, positions[i, 0], positions[i, 1], order, range_max, found, walls, half, hits)
        strength = abs(amplitudes[i]) ** 2
        for m in range(count):
            b[m] = _amplitude(half[m], spreading, hits[m], walls[m], reflection)
            if derive:
                path_derivatives(lines, positions[i, 0], positions[i, 1], walls[m], hits[m], slopes[m])
        nearest = np.argsort(half[:count])
        u[i], v[i] = 0.0, 0.0
        for q in range(count):
            m = nearest[q]
            d = half[m]
            if b[m] == 0.0 or d < 2.0 * step:
                continue
            value, rate = _cubic(signal[i], d / step)
            turn = np.exp(2j * carrier * d)
            u[i] += b[m] * value * turn
            near, near_slope = b[m], 0.0
            for direction in (-1, 1):
                p = q + direction
                while 0 <= p < count:
                    other = nearest[p]
                    lag = d - half[other]
                    if abs(lag) > reach:
                        break
                    psi, psi_rate = _cubic(baseband, abs(lag) / step + 2.0)
                    wave = np.exp(2j * carrier * abs(lag))
                    near += b[other] * (psi * wave).real
                    sign = 1.0 if lag > 0.0 else -1.0
                    near_slope += sign * b[other] * ((psi_rate / step + 2j * carrier * psi) * wave).real
                    if derive and direction < 0:
                        bend, _ = _cubic(curvature, abs(lag) / step + 2.0)
                        pair = -strength * b[m] * b[other] * (bend * wave).real
                        both = strength * b[m] * b[other] * (psi * wave).real
                        for s in range(hits[m]):
                            for t in range(hits[other]):
                                w, x = 3 * walls[m, s], 3 * walls[other, t]
                                for k in range(2):
                                    for l in range(2):
                                        h = pair * slopes[m, s, k] * slopes[other, t, l]
                                        information[w + k, x + l] += h
                                        information[x + l, w + k] += h
                                information[w + 2, x + 2] += both
                                information[x + 2, w + 2] += both
                    p += direction
            v[i] += b[m] * near
            if not derive:
                continue
            heard_slope = (np.conj(amplitudes[i]) * (rate / step + 2j * carrier * value) * turn).real
            slope = b[m] * (heard_slope - strength * near_slope)
            rise = b[m] * ((np.conj(amplitudes[i]) * value * turn).real - strength * near)
            bend_self = -strength * b[m] * b[m] * curvature[2].real
            for s in range(hits[m]):
                w = 3 * walls[m, s]
                scores[i, w] += slope * slopes[m, s, 0]
                scores[i, w + 1] += slope * slopes[m, s, 1]
                scores[i, w + 2] += rise
                for t in range(hits[m]):
                    x = 3 * walls[m, t]
                    for k in range(2):
                        for l in range(2):
                            information[w + k, x + l] += bend_self * slopes[m, s, k] * slopes[m, t, l]
                    information[w + 2, x + 2] += strength * b[m] * b[m]


@kernel
def _predict(
    lines: NDArray[np.float64],
    corners: NDArray[np.float64],
    positions: NDArray[np.float64],
    order: int,
    range_max: float,
    cell: float,
    step: float,
    carrier: float,
    baseband: NDArray[np.complex128],
    spreading: float,
    reflection: NDArray[np.float64],
    amplitudes: NDArray[np.complex128],
    out: NDArray[np.complex128],
) -> None:
    found, walls = np.empty((CAPACITY, 2)), np.empty((CAPACITY, order), np.int64)
    half, hits = np.empty(CAPACITY), np.empty(CAPACITY, np.int64)
    reach = (len(baseband) - 5) * step
    for i in range(len(positions)):
        count = trace_paths(corners, positions[i, 0], positions[i, 1], order, range_max, found, walls, half, hits)
        for m in range(count):
            b = amplitudes[i] * _amplitude(half[m], spreading, hits[m], walls[m], reflection)
            low, high = int(np.ceil((half[m] - reach) / cell)), int((half[m] + reach) / cell)
            for j in range(max(low, 0), min(high, out.shape[1] - 1) + 1):
                lag = j * cell - half[m]
                psi, _ = _cubic(baseband, abs(lag) / step + 2.0)
                wave = psi * np.exp(2j * carrier * abs(lag))
                out[i, j] += b * (wave if lag >= 0.0 else np.conj(wave))
