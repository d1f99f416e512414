"""The pulse that echoes have in truth, found with the walls, from the signal after eq. (3).

Where a transducer rings, no polygon explains the echoes by the nominal pulse: they are later than its own by a range
that is common to all walls, and of another shape. At given walls the taps of `heard_pulse` follow in closed form, in
turn with the amplitudes of the pings. That is tried for shifts of all walls, and for each law by which walls may turn
the phase: echoes of higher orders, which a shift moves by multiples, tell which is right. From the best of these,
everything together takes some steps of Gauss and Newton: walls, taps, what the device and the medium do, and the
phases; taps and walls in turn would creep.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.edge_phase import COMMON, EdgePhase
from polymap_ros.solvers.evidence.heard_pulse import AFTER_CYCLES, HeardPulse, minimum_phase_pulse
from polymap_ros.solvers.evidence.moves.louder import DIFFERENCES, across, louder_by, unit
from polymap_ros.solvers.evidence.moves.start import starts
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.ring_search import improved_ring, ring_starts
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, EXPLAINED, FULL_ORDER, RING_WORTH, SEARCH_ORDER
from polymap_ros.solvers.evidence.walls import LOSS_DEVIATION, Walls
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

_BEFORE_CYCLES = 1.5
"""Cycles of range from the first tap to the nominal pulse."""

_SHIFTS_CYCLES, _STEP_CYCLES = 0.9, 0.1
"""Cycles of range by which all walls are shifted either way, and the step: a fit is sharp to a quarter cycle."""

_HOPEFUL = 0.5
"""Share of the best guess's score from which that of another law is followed: before walls are right, laws are near to
one another."""

_JOINT_STEPS, _NO_BETTER = 8, 2e-5
"""Steps of Gauss and Newton, at most, and the share of the energy by which a step has to be better for another one."""

_STEP_SHARES = 1.0, 0.3
"""Shares of such a step that are tried, the first that is better."""

_FITTED_TO = 15
"""Pings by which taps are fitted, or all where there are fewer: ten are enough at 0 dB."""

_TOLD_BY, _TOLD_TO = 10, 0.3
"""Pings from which a pulse is looked for: so many tell one at 0 dB; and the uncertainty of the share explained beyond
which echoes are too weak to tell it."""

_CONVEX = 0.6
"""Score of the best guess of convex walls below which outlines that are not convex are tried first: of 36 plates (even
seeds) it is less for four, and 0.42 and 0.36 of an L and a T."""

_BY_POWER = 0.75
"""Share of the echoes' power that an outline which is not convex explains by the pulse of minimum phase, to be fitted:
of four L and T (even seeds) it is 0.93 to 1, and 0.57 to 0.62 of three outlines of a T that are wrong."""

_ROUNDS_OF_WALLS = 4
"""How often walls are settled by a pulse and it is fitted to them again, at most."""

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

    def pulse(self, guess: Guess, laws: Sequence[EdgePhase]) -> HeardPulse:
        """Return the pulse of a guess, whose law is one of those given."""
        apart = round(self._data.cell_m / self._data.pulse.step_m)
        law = next(k for k, law in enumerate(laws) if law.law is guess.wave.edge.law)
        return HeardPulse(guess.taps, int(self._lags[0]) * apart, apart, law)

    def begun(self, walls: Walls, edge: EdgePhase) -> Wave:
        """Return a waveform of unit amplitudes."""
        return Wave(walls, 0.0, -np.inf, np.ones(len(self._data.positions)), edge=edge)

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

    def climbed(self, guess: Guess) -> Guess:
        """Return the guess after steps of Gauss and Newton, as long as they fit better."""
        for _ in range(_JOINT_STEPS):
            before, guess = guess, self.joint(guess)
            if guess.score < before.score + _NO_BETTER:
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
        slopes = [gains * np.tensordot(guess.taps, self._late(
            (self._likelihood.without_carrier(move(wave, step)) - plain) / step), 1) for move, step in moves]
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


def pulse_guesses(search: Search, fit: PulseFit, walls: Walls) -> list[Guess]:
    """Return what fits with walls that are shifted in common, for each shift and each law of phases, where it can."""
    count, guesses = round(_SHIFTS_CYCLES / _STEP_CYCLES), []
    for edge in search.edges:
        search.checkpoint()
        for k in range(-count, count + 1):
            moved = replace(walls, lines=walls.lines + (k * _STEP_CYCLES * search.cycle_m, 0.0))
            guesses.append(fit.fitted(fit.begun(moved, edge)))
    return [guess for guess in guesses if np.isfinite(guess.score)]


class Adapted(NamedTuple):
    """A pulse, the search over what is heard by it, and the polygon there."""

    pulse: HeardPulse
    search: Search
    found: Found


def adapted(search: Search, rings: bool = False) -> Adapted | None:
    """Return the pulse by which walls explain all of the echoes, and these walls; None where there is none.

    The first walls are those that power finds by the nominal pulse, and by one of minimum phase with the echoes'
    spectrum; or, where `rings` that need not be convex are asked for, such a ring by the latter, before the others where
    these fit badly.
    """
    if len(search.data.positions) < _TOLD_BY or search.uncertainty > _TOLD_TO:
        return None
    enough, best = ALL_EXPLAINED - search.uncertainty / 3.0, None
    data = search.data.every(max(len(search.data.positions) // _FITTED_TO, 1))
    fit = PulseFit(WaveformLikelihood(data))
    ringing = search.over(minimum_phase_pulse(search.data).heard(search.data))
    convex = [power for power in (_by_power(search), _by_power(ringing)) if power is not None]
    first = _climbed(search, fit, [guess for power in convex for guess in pulse_guesses(search, fit, power.walls)])
    others = _ring_guesses(search, ringing, fit, convex) if rings else ()
    convex_first = first is not None and first.score > _CONVEX
    for guess in chain((first,), others) if convex_first else chain(others, (first,)):
        own = guess and _told_by(search, fit, guess, enough)
        if own and (best is None or own.found.explained > best.found.explained):
            best = own
        if best is not None and best.found.explained > enough:
            return best
    return None


def _ring_guesses(search: Search, ringing: Search, fit: PulseFit, convex: Sequence[Power]) -> Iterator[Guess | None]:
    """Give what fits best from outlines that need not be convex, where they are worth clearly more than convex ones."""
    nothing = ringing.nothing
    like = [ringing.power.fitted(power.walls, nothing.with_strength(power.strength), SEARCH_ORDER) for power in convex]
    known = max((power.value for power in like if power is not None), default=nothing.value)
    starts, pool = ring_starts(ringing)
    for start in starts:
        ringing.checkpoint()
        ring = improved_ring(ringing, start, pool)
        judged = ringing.judged(ring, None)
        explains = judged is not None and judged.explained > _BY_POWER - ringing.uncertainty
        if explains and ring.value - nothing.value > RING_WORTH * (known - nothing.value):
            yield _climbed(search, fit, pulse_guesses(search, fit, ring.walls))


def _told_by(search: Search, fit: PulseFit, guess: Guess | None, enough: float) -> Adapted | None:
    """Return the pulse that a guess leads to, and the walls there that explain most.

    Walls that are missed at first are found by a better pulse, and tell more of it in turn.
    """
    best: Adapted | None = None
    for count in range(_ROUNDS_OF_WALLS):
        if guess is None:
            break
        pulse = fit.pulse(guess, search.edges)
        other = pulse.over(search)
        settled = _settled(other, guess.wave, anew=count == 0)
        # A later guess fits better: it counts where it explains enough, too.
        better = settled and settled.wave and (
            best is None or settled.explained > min(best.found.explained, enough))
        if settled is None or not (better or count == 0):
            break
        best = Adapted(pulse, other, settled) if better else best
        # Where walls were wrong, so may the law have been that they told.
        before, guesses = guess.score, pulse_guesses(search, fit, settled.walls)
        hopeful = guesses if settled.explained < enough else [max(guesses, key=lambda each: each.score)]
        guess = _climbed(search, fit, hopeful)
        if guess is not None and guess.score < before + _NO_BETTER:
            break
    return best


def _by_power(search: Search) -> Power | None:
    """The walls that a first start leads to, by power."""
    start = next(starts(search))
    power = start and search.by_power(start)
    return power and search.power.refine(power.walls, power, FULL_ORDER)


def _climbed(search: Search, fit: PulseFit, guesses: list[Guess]) -> Guess | None:
    """The best of guesses, of each law the one that fits best already, after all steps of Gauss and Newton."""
    best = None
    for law in search.edges:
        alike = [guess for guess in guesses if guess.wave.edge is law]
        first = max(alike, key=lambda each: each.score, default=None)
        if first is not None and first.score > _HOPEFUL * max(guess.score for guess in guesses):
            search.checkpoint()
            guess = fit.climbed(first)
            best = guess if best is None or guess.score > best.score else best
    return best


def _settled(search: Search, guess: Wave, anew: bool) -> Found | None:
    """The walls of a guess settled by its pulse, or a polygon that is begun `anew` where that is worth more."""
    law = search.edges[0]
    edge = replace(law.freed(), found=guess.edge.found) if len(law.law) else law
    wave = search.wave.evaluate(guess.walls, replace(guess, edge=edge), FULL_ORDER, derive=True)
    wave = wave and search.wave.refine(wave, FULL_ORDER)
    found = None if wave is None else search.changed(search.nothing.with_strength(1.0).with_walls(wave.walls), wave)
    if anew and guess.walls.convex_outline and (found is None or found.explained < EXPLAINED):
        other = next(search.polygons())
        found = other if other is not None and (found is None or other.value > found.value) else found
    return found

