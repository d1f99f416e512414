"""A pulse fitted to the echoes of a few pings, together with the walls that they come from.

At given walls the taps of `heard_pulse` follow in closed form, in turn with the amplitudes of the pings. Then walls,
taps, what the device and the medium do, and the phases take steps of Gauss and Newton together; taps and walls in turn
would creep.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.edge_phase import COMMON, EdgePhase
from polymap_ros.solvers.evidence.heard_pulse import AFTER_CYCLES, HeardPulse
from polymap_ros.solvers.evidence.loudness import PLAIN, Loudness
from polymap_ros.solvers.evidence.moves.louder import DIFFERENCES, across, louder_by, unit
from polymap_ros.solvers.evidence.walls import LOSS_DEVIATION, Walls
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

_BEFORE_CYCLES = 1.5
"""Cycles of range from the first tap to the nominal pulse."""

_JOINT_STEPS, NO_BETTER = 8, 2e-5
"""Steps of Gauss and Newton, at most, and the share of the energy by which a step has to be better for another one."""

_STEP_SHARES = 1.0, 0.3
"""Shares of such a step that are tried, the first that is better."""

_IN_TURN = 3
"""Times that taps and amplitudes are found in turn."""

_DIAGONAL = 1e-4
"""Share of the mean diagonal that is added to normal equations: from 1e-5 to 1e-3 it changes nothing."""

_SILENCED = 1e-6
"""Coefficient that stands for none, where a logarithm is needed."""

_MOVED_M, _TURNED_RAD, _LOST, _DELAYED_RAD = 2e-5, 2e-5, 1e-3, 1e-3
"""Differences of r, theta, ln |rho| and phases by which derivatives are taken."""

_MENDED_RAD = 0.6
"""By how much each number of a law is mended at most: what differs by more is another law."""

_FARTHEST = 500.0
"""Times these differences that a step changes a number at most: 10 mm, 0.6 deg, and phases of 30 deg, beyond which
echoes are not linear in it."""


class Guess(NamedTuple):
    """A waveform of unit amplitudes by the nominal pulse, and the taps, amplitudes and score that fit it best.

    The score is the share of the signal's energy that they explain.
    """

    wave: Wave
    taps: NDArray[np.complex128]
    amplitudes: NDArray[np.float64]
    score: float


class PulseFit:
    """A few pings, and the pulse that fits them best at given walls.

    Parameters
    ----------
    likelihood : WaveformLikelihood
        Of these pings, by the nominal pulse.
    """

    def __init__(self, likelihood: WaveformLikelihood) -> None:
        self._likelihood, data = likelihood, likelihood.data
        self._data = data
        cycle = np.pi / data.pulse.carrier / data.cell_m
        last = min(int(AFTER_CYCLES * cycle), data.power.shape[1] - 1)
        self._lags = np.arange(-min(int(_BEFORE_CYCLES * cycle), last), last + 1)
        self._heard = likelihood.without_carrier()[:, data.first_cell:]
        self._energy = float(np.sum(np.abs(self._heard) ** 2))

    @property
    def loud(self) -> float:
        """Share of the signal's energy that is echoes: noise has 2 a cell."""
        return max(1.0 - 2.0 * self._heard.size / self._energy, 0.0)

    def pulse(self, guess: Guess, laws: Sequence[EdgePhase]) -> HeardPulse:
        """Return the pulse of a guess, whose law is one of those given."""
        apart = round(self._data.cell_m / self._data.pulse.step_m)
        law = next(k for k, law in enumerate(laws) if law.law is guess.wave.edge.law)
        return HeardPulse(guess.taps, int(self._lags[0]) * apart, apart, law)

    def begun(self, walls: Walls, edge: EdgePhase, loudness: Loudness = PLAIN) -> Wave:
        """Return a waveform of unit amplitudes."""
        return Wave(walls, 0.0, -np.inf, np.ones(len(self._data.positions)), edge=edge, loudness=loudness)

    def fitted(self, wave: Wave) -> Guess:
        """Return the taps and amplitudes that fit a waveform best, found in turn."""
        late = self._late(self._likelihood.without_carrier(wave))
        if not np.any(late):  # moved so far, the walls bound no outline, or leave the pings outside
            return Guess(wave, np.zeros(len(late), complex), wave.amplitudes, -np.inf)
        square = np.einsum('lnm,knm->nlk', np.conj(late), late, optimize=True)
        along = np.einsum('lnm,nm->nl', np.conj(late), self._heard, optimize=True)
        own = np.real(np.trace(square, axis1=1, axis2=2)) / len(self._lags)
        amplitudes = np.sqrt(np.sum(np.abs(self._heard) ** 2, axis=1) / np.maximum(own, 1e-300))
        for _ in range(_IN_TURN):
            whole = np.einsum('n,nlk->lk', amplitudes**2, square)
            whole += _DIAGONAL * np.trace(whole).real / len(whole) * np.eye(len(whole))
            values = np.linalg.solve(whole, amplitudes @ along)
            power = np.maximum(np.real(np.einsum('l,nlk,k->n', np.conj(values), square, values)), 1e-300)
            agreeing = np.real(along @ np.conj(values))
            amplitudes = np.maximum(agreeing, 0.0) / power
            if not np.any(amplitudes):  # the echoes have nothing of these walls
                return Guess(wave, values, amplitudes, -np.inf)
        score = float(np.sum(2.0 * amplitudes * agreeing - amplitudes**2 * power)) / self._energy
        return Guess(wave, values, amplitudes, score)

    def _late(self, waveform: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return a waveform (N, cells) at each lag, shape (L, N, cells), from the first cell that is not blanked."""
        n = waveform.shape[1]
        late = np.zeros((len(self._lags), *waveform.shape), complex)
        for row, lag in zip(late, self._lags, strict=True):
            row[:, max(lag, 0):n + min(lag, 0)] = waveform[:, max(-lag, 0):n - max(lag, 0)]
        return late[:, :, self._data.first_cell:]

    def _by_taps(self, taps: NDArray[np.complex128], waveforms: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return waveforms (k, N, cells) of the pulse of these taps, from the first cell that is not blanked."""
        n = waveforms.shape[-1]
        size = scipy.fft.next_fast_len(n + len(taps))
        filtered = scipy.fft.ifft(scipy.fft.fft(waveforms, size) * scipy.fft.fft(taps, size))
        before = -int(self._lags[0])
        return np.asarray(filtered[..., before + self._data.first_cell:before + n])

    def climbed(self, guess: Guess) -> Guess:
        """Return the guess after steps of Gauss and Newton, as long as they fit better."""
        for _ in range(_JOINT_STEPS):
            before, guess = guess, self.joint(guess)
            if guess.score < before.score + NO_BETTER:
                break
        return guess

    def joint(self, guess: Guess) -> Guess:
        """Return the guess after a step of Gauss and Newton over walls, pulse, device, medium and phases together."""
        wave, data = guess.wave, self._data
        plain = self._likelihood.without_carrier(wave)
        late = self._late(plain)
        gains = guess.amplitudes[:, None]
        whole = gains * np.tensordot(guess.taps, late, 1)
        own = unit(whole)
        moves = moves_of(wave)
        slopes = gains * self._by_taps(guess.taps, np.array([
            (self._likelihood.without_carrier(move(wave, step)) - plain) / step for move, step in moves]))
        columns = np.array([across(own, each).ravel() for each in (*slopes, *(gains * late), *(1j * gains * late))])
        square = np.real(np.conj(columns) @ columns.T) * data.weight
        along = np.real(np.conj(columns) @ (self._heard - whole).ravel()) * data.weight
        prior = np.zeros(len(columns))
        n = len(wave.walls)
        prior[2 * n:3 * n] = LOSS_DEVIATION**-2.0
        square += np.diag(prior + _DIAGONAL * np.diag(square))
        along[2 * n:3 * n] -= prior[2 * n:3 * n] * np.log(np.maximum(np.abs(wave.walls.reflection), _SILENCED))
        most = np.array([_FARTHEST * abs(step) for _, step in moves])
        if not np.all(np.isfinite(square)):
            return guess
        steps = np.clip(np.linalg.lstsq(square, along, rcond=1e-12)[0][:len(moves)], -most, most)
        best = guess
        for share in _STEP_SHARES:
            moved = wave
            for (move, _), step in zip(moves, share * steps, strict=True):
                moved = move(moved, float(step))
            tried = self.fitted(moved)
            if tried.score > best.score:
                return tried
        return best


Move: TypeAlias = Callable[[Wave, float], Wave]


def moves_of(wave: Wave) -> list[tuple[Move, float]]:
    """Return how each number changes a waveform, and by how much it is changed for a derivative.

    r, theta and ln |rho| of all walls, then what all echoes count for, then the phases but the one head on.
    """
    walls = range(len(wave.walls))
    phases = range(1, COMMON) if len(wave.edge.law) else ()
    return [
        *((partial(_shifted, 0, k), _MOVED_M) for k in walls), *((partial(_shifted, 1, k), _TURNED_RAD) for k in walls),
        *((partial(_reflecting_more, k), -_LOST) for k in walls),
        *((partial(_louder, name), step) for name, step in DIFFERENCES.items()),
        *((partial(_delayed, k), _DELAYED_RAD) for k in phases)]


def _shifted(axis: int, k: int, wave: Wave, step: float) -> Wave:
    lines = wave.walls.lines.copy()
    lines[k, axis] += step
    return wave.with_walls(replace(wave.walls, lines=lines))


def _reflecting_more(k: int, wave: Wave, step: float) -> Wave:
    reflection = wave.walls.reflection.copy()
    reflection[k] = np.clip(reflection[k] * np.exp(step), -1.0, 1.0)
    return wave.with_walls(replace(wave.walls, reflection=reflection))


def _louder(name: str, wave: Wave, step: float) -> Wave:
    return louder_by(wave, {name: step})


def _delayed(k: int, wave: Wave, step: float) -> Wave:
    found = wave.edge.found.copy()
    found[k] = np.clip(found[k] + step, -_MENDED_RAD, _MENDED_RAD)
    return replace(wave, edge=replace(wave.edge, found=found))
