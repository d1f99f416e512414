r"""The pulse that the echoes have in truth, fitted with the walls.

Where a transducer rings, no polygon explains the echoes by the nominal pulse, whose phases are wrong by as much as the
walls then are off. The walls of such an answer are in the right places but for a shift common to all, which is the
delay of the pulse that is not known. So the pulse is looked for as

    s(t) = sum_l h_l s_0(t - tau_l) ,    tau_l = 0, T / 4, T / 2, ...

s_0 being the nominal pulse and T its period, which are few numbers, and a causal pulse. At given walls ping i has the
spectrum A_i S(w) G_i(w), with G_i the sum over its images, and h follows in closed form: its normal equations are those
of a Toeplitz matrix. That is tried for shifts of all walls and for what a reflection may do to the phase; echoes of
higher orders, which such a shift moves by multiples, tell which is right. Then the pings are heard again by that pulse,
the walls are settled by it, and the pulse is fitted again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.pulse import RecordedPulse, make_pulse
from polymap_ros.calibration.session import Session
from polymap_ros.calibration.stages import CERTAIN_NATS, Refusal
from polymap_ros.errors import ParameterError
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.geometry.outline import corners_of
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, EXPLAINED, FULL_ORDER
from polymap_ros.solvers.evidence.walls import Walls

_PULSE_TAPS, _TAP_CYCLES = 28, 0.25
"""Numbers of the pulse, and cycles from one to the next: 70 us at 100 kHz. With 14 of them walls heard by a transducer
of Q 5 are 0.04 mm off, with half a cycle between them 0.18 mm."""

_DIAGONAL = 1e-3
"""Share of the mean diagonal that is added: from 1e-5 to 1e-2 it changes nothing."""

_LOOKED_IN = 0.2, 2.2
"""Frequencies that are looked at, over the nominal one."""

_PULSE_PINGS = 16
"""Pings by which the pulse is fitted: ten are enough at 0 dB."""

_SHIFTS_CYCLES, _STEP_CYCLES = 1.0, 0.1
"""Cycles of range by which all walls are shifted either way, and the step: a fit is sharp to a quarter cycle."""

_COARSER_CYCLES, _FINE_CYCLES = 0.05, 0.02
"""The steps of later rounds, of which six and two either way are tried."""

_PHASE_TURNS = (1.0,), (1j, -1j)
"""What a reflection does to the phase: nothing (or the opposite, which the pulse takes in), or where no pulse explains
the echoes so, 90 degrees either way, as the free edge of a plate does head on."""

_FITS = 8
"""Times the pulse is fitted."""

_POLISHED = -0.2, 0.2, -0.05, 0.05
"""Cycles by which walls and pulse are shifted together at last, each as long as that is likelier."""

_SURE = 0.995
"""Share explained at which no other guess is followed: with a pulse that is a fifth of a cycle off it is 0.985."""

_GUESSES = 3
"""Of the guesses of shift and turn, the best so many are followed."""

_NO_BETTER = 0.0002
"""Share of the energy by which a fit is no better than the one before."""


class _Agreed(NamedTuple):
    """A pulse, the log likelihood of walls by it, the share that they explain and how uncertain that is; the lines,
    coefficients and turn of these walls.
    """

    pulse: RecordedPulse
    value: float
    explained: float
    uncertainty: float
    lines: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    turn: complex


class _Guess(NamedTuple):
    """The share of the energy that is fitted, the taps, the shift of all walls [m], and the turn of the phase."""

    score: float
    taps: NDArray[np.float64]
    shift_m: float
    turn: complex


@dataclass(frozen=True)
class FittedPulse:
    """A pulse that makes the echoes agree.

    Parameters
    ----------
    recorded : RecordedPulse
        At the pings' sample period.
    explained : float
        Share of the echoes' power that the polygon explains by it.
    """

    recorded: RecordedPulse
    explained: float


class _Fit:
    """Some pings of a session as spectra, and the pulse that fits them best at given walls."""

    def __init__(self, session: Session, search: Search) -> None:
        parameters = session.parameters
        chosen = slice(None, None, max(len(session.pings) // _PULSE_PINGS, 1))
        pings, self._ends = session.pings[chosen], search.data.ends[chosen]
        self._period_s, size = pings[0].period_s, pings[0].samples.size
        frequency_hz = np.fft.rfftfreq(2 * size, self._period_s)
        low, high = (share * parameters.pulse.frequency_hz for share in _LOOKED_IN)
        band = (frequency_hz > low) & (frequency_hz < min(high, 0.45 / self._period_s))
        self._omega = 2.0 * np.pi * frequency_hz[band]
        samples = np.array([ping.samples for ping in pings], dtype=float)
        samples -= samples.mean(axis=1, keepdims=True)
        self._heard = np.fft.rfft(samples, 2 * size)[:, band] * np.exp(-1j * self._omega * pings[0].t0_s)
        self._energy = float(np.sum(np.abs(self._heard) ** 2))
        self._set_medium(parameters, pings[0].t0_s + size * self._period_s)

    def _set_medium(self, parameters: Parameters, end_s: float) -> None:
        medium = make_medium(parameters.medium)
        self._nominal = make_pulse(parameters.pulse, None, self._period_s)
        self._wavenumber, self._spreading = medium.wavenumber(self._omega), medium.spreading
        self._spectrum = self._nominal.spectrum(self._omega) * medium.excitability(self._omega)
        self._end_m = end_s * float(group_speed(medium, parameters.pulse.frequency_hz))
        self._taps_s = np.arange(_PULSE_TAPS) * _TAP_CYCLES / parameters.pulse.frequency_hz

    def tried(
        self, lines: NDArray[np.float64], reflection: NDArray[np.float64], shifts: NDArray[np.float64],
        turns: Sequence[complex],
    ) -> list[_Guess]:
        """Return what is fitted with each shift of all walls [m] and each turn of the phase, where anything can be."""
        tried = []
        for shift in shifts.tolist():
            moved = lines + (shift, 0.0)
            outline, corners = corners_of(moved)
            if outline and self._are_inside(moved):
                images = self._images(corners, reflection)
                tried += [_Guess(*self._fitted(self._summed(images, turn)), shift, turn) for turn in turns]
        return [guess for guess in tried if np.isfinite(guess.score)]

    def _are_inside(self, lines: NDArray[np.float64]) -> bool:
        """Whether emitter and receiver of all pings are."""
        normals = np.array((np.cos(lines[:, 1]), np.sin(lines[:, 1])))
        places = np.vstack((self._ends[:, :2], self._ends[:, 2:4]))
        return bool(np.all(places @ normals < lines[:, 0]))

    def _images(
        self, corners: NDArray[np.float64], reflection: NDArray[np.float64]
    ) -> list[list[NDArray[np.complex128]]]:
        """Of each ping, and of each order, the sum over its images."""
        rows = []
        for x, y, to_x, to_y, height in self._ends.tolist():
            found = visible_images(corners, (x, y), FULL_ORDER, reflection, (to_x, to_y))
            distance = np.hypot(found.distance_m, height)
            weight = found.amplitude * distance**-self._spreading * (distance < self._end_m)
            waves = np.exp(-1j * np.outer(self._wavenumber, distance)) * weight
            rows.append([waves[:, found.order == order].sum(axis=1) for order in range(1, FULL_ORDER + 1)])
        return rows

    def _summed(self, rows: list[list[NDArray[np.complex128]]], turn: complex) -> NDArray[np.complex128]:
        return np.array([sum(turn**order * wave for order, wave in enumerate(row, 1)) for row in rows]) * self._spectrum

    def _fitted(self, basis: NDArray[np.complex128], rounds: int = 4) -> tuple[float, NDArray[np.float64]]:
        """The share of the energy that a pulse takes away, and its taps; gains of the pings and taps in turn."""
        if not np.all(np.any(basis, axis=1)):  # a ping that hears no wall in time
            return -np.inf, np.zeros(_PULSE_TAPS)
        heard = np.sum(np.abs(self._heard) ** 2, axis=1)
        gains = np.sqrt(heard / np.maximum(np.sum(np.abs(basis) ** 2, axis=1), 1e-300))
        delays = np.exp(1j * np.outer(self._taps_s, self._omega))
        for _ in range(rounds):
            square = np.real(delays @ np.sum(gains[:, None] ** 2 * np.abs(basis) ** 2, axis=0))
            along = np.real(delays @ np.sum(gains[:, None] * np.conj(basis) * self._heard, axis=0))
            square[0] *= 1.0 + _DIAGONAL
            taps = solve_toeplitz(square, along)
            predicted = basis * (taps @ np.conj(delays))
            power = np.maximum(np.sum(np.abs(predicted) ** 2, axis=1), 1e-300)
            gains = np.maximum(np.real(np.sum(np.conj(predicted) * self._heard, axis=1)), 0.0) / power
            if not np.any(gains):
                break
        left = float(np.sum(np.abs(self._heard - gains[:, None] * predicted) ** 2))
        return 1.0 - left / self._energy, taps

    def pulse(self, taps: NDArray[np.float64]) -> RecordedPulse:
        """The pulse that taps make of the nominal one, at the pings' period."""
        whole_s = self._nominal.duration_s + self._taps_s[-1]
        size = 4 * (int(whole_s / self._period_s) + 2)
        omega = 2.0 * np.pi * np.fft.rfftfreq(size, self._period_s)
        spectrum = self._nominal.spectrum(omega) * (taps @ np.exp(-1j * np.outer(self._taps_s, omega)))
        wave = np.fft.irfft(spectrum, size)[:size // 4]
        return RecordedPulse(wave / np.abs(wave).max(), self._period_s)


def fitted_pulse(session: Session, starts: int = 3) -> FittedPulse | Refusal:
    """Return the pulse by which walls near those of a first search explain the echoes, or why there is none.

    Of the starts of that search so many are gone on from, until a pulse explains all.
    """
    if session.parameters.echo.kind != 'rf':
        return Refusal('the echoes are magnitudes (echo.kind: envelope), which have no pulse')
    if not session.pings or not _alike(session.pings):
        return Refusal('the pings differ in length, sample period or start')
    try:
        search = session.search(session.parameters)
    except ParameterError as error:  # too little is left to listen to
        return Refusal(str(error))
    fit, best = _Fit(session, search), None
    shifts = np.arange(-_SHIFTS_CYCLES, _SHIFTS_CYCLES + 1e-9, _STEP_CYCLES) * search.cycle_m
    founds = islice((found for found in search.polygons() if found is not None), starts)
    for start, turns in ((start, turns) for start in founds for turns in _PHASE_TURNS):
        for guess in _apart(fit.tried(start.lines, np.ones(len(start.lines)), shifts, turns), search.cycle_m):
            found = _refined(session, fit, start.lines, guess, search.cycle_m)
            best = found if found and (best is None or found.value > best.value) else best
            if best is not None and best.explained > _SURE:
                break
        if best is not None and best.explained > EXPLAINED - best.uncertainty:
            best = _polished(session, fit, best, search.cycle_m)
            # A pulse that is delayed by too much or too little leaves a little: 0.97 with walls that are 2 mm off.
            if best.explained > ALL_EXPLAINED - best.uncertainty:
                return FittedPulse(best.pulse, best.explained)
    return Refusal('by no pulse that was tried do walls explain the echoes')


def _apart(tried: list[_Guess], cycle_m: float) -> list[_Guess]:
    """The best guesses, each another turn or a quarter of a cycle from the better ones."""
    chosen: list[_Guess] = []
    for guess in sorted(tried, key=lambda guess: -guess.score):
        near = (other for other in chosen if guess.turn == other.turn)
        if all(abs(guess.shift_m - other.shift_m) > 0.25 * cycle_m for other in near):
            chosen.append(guess)
    return chosen[:_GUESSES]


def _refined(
    session: Session, fit: _Fit, lines: NDArray[np.float64], guess: _Guess, cycle_m: float
) -> _Agreed | None:
    """Go from a guess to the pulse and the walls that agree with each other."""
    best, score = None, -np.inf
    for _ in range(_FITS):
        if guess.score < score + _NO_BETTER:
            break
        score, agreed = guess.score, _agreed(session, fit, lines, guess)
        if agreed is None:
            break
        best = agreed if best is None or agreed.value > best.value else best
        fine = np.concatenate((_COARSER_CYCLES * np.arange(-6.0, 7.0), _FINE_CYCLES * np.arange(-2.0, 3.0))) * cycle_m
        lines = agreed.lines
        tried = fit.tried(lines, agreed.coefficients, fine, (guess.turn,))
        if not tried:
            break
        guess = max(tried, key=lambda each: each.score)
    return best


def _polished(session: Session, fit: _Fit, best: _Agreed, cycle_m: float) -> _Agreed:
    """Shift all walls, and with them the pulse, to where most is explained: what a fit of the pulse sees dimly."""
    for cycles in _POLISHED:
        shift = np.array((cycles * cycle_m,))
        while tried := fit.tried(best.lines, best.coefficients, shift, (best.turn,)):
            other = _agreed(session, fit, best.lines, tried[0])
            if other is None or other.value < best.value + CERTAIN_NATS:
                break
            best = other
    return best


def _agreed(session: Session, fit: _Fit, lines: NDArray[np.float64], guess: _Guess) -> _Agreed | None:
    """Hear the pings by the pulse of a guess and settle the walls by it; None where they do not agree in phase."""
    session.checkpoint()
    pulse = fit.pulse(guess.taps)
    heard = session.with_pulse(pulse)
    # A phase of reflections beside a free pulse moves the walls: 1 degree by 0.025 mm. So there is none without need.
    edge = heard.parameters.medium.edge if guess.turn != 1.0 else 'real'
    try:
        search = heard.search(heard.parameters.replaced({'medium.edge': edge}))
    except ParameterError:  # the pulse takes up too much of the pings
        return None
    found = search.settle(search.nothing.with_strength(1.0).with_walls(Walls.convex(lines + (guess.shift_m, 0.0))))
    if found is None or found.wave is None:
        return None
    coefficients = found.walls.reflection / np.median(np.abs(found.walls.reflection))
    return _Agreed(pulse, found.value, found.explained, search.uncertainty, found.lines, coefficients, guess.turn)


def _alike(pings: Sequence[Ping]) -> bool:
    """Whether all pings have one sample period, and one length and start."""
    return len({(ping.samples.size, ping.period_s, ping.t0_s) for ping in pings}) == 1
