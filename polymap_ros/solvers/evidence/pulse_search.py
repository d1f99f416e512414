"""The pulse that echoes have in truth, found with the walls, from the signal after eq. (3).

Where a transducer rings, no polygon explains the echoes by the nominal pulse: they are later than its own by a range
that is common to all walls, and of another shape. The pulse that fits given walls (`tap_fit`) is tried for shifts
of all walls, and for each law by which walls may turn the phase: echoes of higher orders, which a shift moves by
multiples, tell which is right. From the best of these everything is fitted together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, islice
from typing import NamedTuple

import numpy as np

from polymap_ros.solvers.evidence.echo_spectrum import minimum_phase_pulse
from polymap_ros.solvers.evidence.heard_pulse import HeardPulse
from polymap_ros.solvers.evidence.loudness import PLAIN, Loudness
from polymap_ros.solvers.evidence.moves.start import starts
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.ring_search import improved_ring, ring_starts
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tap_fit import NO_BETTER, Guess, PulseFit
from polymap_ros.solvers.evidence.tracking import Track
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, BY_POWER, EXPLAINED, FULL_ORDER, RING_WORTH, SEARCH_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

_SHIFTS_CYCLES, _STEP_CYCLES = 0.875, 0.125
"""Cycles of range by which all walls are shifted either way, and the step: a fit is sharp to a quarter cycle. Laws are
a quarter of a turn apart head on, and each has its best shift on the grid: beside it, a wrong one may fit better."""

_STARTS_BY_PULSE = 2
"""Starts of convex walls, at most."""

_ALL_FITS = 0.8
"""Share of the echoes' energy in a guess from which no other is looked for: of eight plates at Q 10 (even seeds) two
had 0.92 and more, with all true walls, but for a common shift; the others 0.63 and less, with walls elsewhere."""

_HOPEFUL = 0.5
"""Share of the best guess's score from which that of another law is followed: before walls are right, laws are near to
one another."""

_FITTED_TO = 15
"""Pings by which taps are fitted, or all where there are fewer: ten are enough at 0 dB."""

_TOLD_BY, _TOLD_TO = 10, 0.3
"""Pings from which a pulse is looked for: so many tell one at 0 dB; and the uncertainty of the share explained beyond
which echoes are too weak to tell it."""

_CONVEX_FITS = 0.6
"""Score of the best guess of convex walls below which outlines that are not convex are tried first: of 36 plates (even
seeds) it is less for three, and 0.42 and 0.36 of an L and a T."""

_HOPELESS = 0.28
"""Share of the echoes' energy in the best guess of convex walls below which poses are likelier to be wrong than
anything else: with everything mild it is 0.15 to 0.21 at the level `typical` (six plates, even seeds), and 0.88 and
more where poses are right (five of them); in two L and two T 0.31 and more, before echoes were sharpened. A
wrong verdict costs time alone."""

_ROUNDS_OF_WALLS = 4
"""How often walls are settled by a pulse and it is fitted to them again, at most."""


def pulse_guesses(search: Search, fit: PulseFit, walls: Walls, loudness: Loudness = PLAIN) -> list[Guess]:
    """Return what fits with walls that are shifted in common, for each shift and each law of phases, where it can.

    The device and the medium are as `loudness` says: what it leaves out costs more than a wrong shift does.
    """
    count, guesses = round(_SHIFTS_CYCLES / _STEP_CYCLES), []
    alike = replace(walls, reflection=np.copysign(1.0, np.sum(walls.reflection)) * walls.reflection)
    turned = replace(alike, reflection=-alike.reflection)
    for edge, signed in (*((edge, alike) for edge in search.edges), (search.edges[0], turned)):
        search.checkpoint()
        for k in range(-count, count + 1):
            moved = replace(signed, lines=walls.lines + (k * _STEP_CYCLES * search.cycle_m, 0.0))
            guesses.append(fit.fitted(fit.begun(moved, edge, loudness)))
    return [guess for guess in guesses if np.isfinite(guess.score)]


def _guesses_of(search: Search, fit: PulseFit, found: Found) -> list[Guess]:
    """Return the guesses of walls that were found by another pulse, with the device and the medium found there."""
    if found.wave is None:
        return pulse_guesses(search, fit, found.walls)
    return pulse_guesses(search, fit, found.walls.without_delays(), found.wave.loudness)


class Adapted(NamedTuple):
    """A pulse, the search over what is heard by it, and the polygon there; a track where poses were estimated, too."""

    pulse: HeardPulse
    search: Search
    found: Found
    track: Track | None = None


class FirstGuess(NamedTuple):
    """What fits best by convex walls, with these, pings that are sharpened, and what fits pulses."""

    fit: PulseFit
    sharp: Search
    convex: Sequence[Power]
    guess: Guess | None

    @classmethod
    def of(cls, search: Search) -> 'FirstGuess':
        """Return it by walls that power finds where echoes are sharpened by the pulse of minimum phase.

        From another start where these do not fit.
        """
        fit = _fit_of(search)
        sharp = search.over(minimum_phase_pulse(search.data).sharpened(search.data))
        convex: list[Power] = []
        best: Guess | None = None
        for start in islice(starts(sharp), _STARTS_BY_PULSE):
            begun = start and sharp.by_power(start)
            power = begun and sharp.power.refine(begun.walls, begun, FULL_ORDER)
            if power is None:
                continue
            convex.append(power)
            guess = _climbed(search, fit, pulse_guesses(search, fit, power.walls))
            best = guess if best is None or (guess and guess.score > best.score) else best
            if best is not None and best.score > _ALL_FITS * fit.loud:
                break
        return cls(fit, sharp, convex, best)

    @property
    def hopeless(self) -> bool:
        """Whether poses are likelier to be wrong than anything else."""
        return self.guess is None or self.guess.score < _HOPELESS * self.fit.loud


def may_be_told(search: Search) -> bool:
    """Whether there are enough pings, and echoes that are strong enough, to tell a pulse."""
    return len(search.data.positions) >= _TOLD_BY and search.uncertainty <= _TOLD_TO


def adapted(search: Search, first: FirstGuess, rings: bool = False) -> Adapted | None:
    """Return the pulse by which walls explain all of the echoes, and these walls; None where there is none.

    The first walls are convex; where `rings` that need not be are asked for, such a ring by the pulse of minimum phase,
    too, and first where convex ones fit badly.
    """
    enough, best = ALL_EXPLAINED - search.uncertainty / 3.0, None
    fit, convex = first.fit, first.guess
    others = _ring_guesses(search, first) if rings else ()
    convex_first = convex is not None and convex.score > _CONVEX_FITS
    for guess in chain((convex,), others) if convex_first else chain(others, (convex,)):
        own = guess and _told_by(search, fit, guess, enough)
        if own and (best is None or own.found.explained > best.found.explained):
            best = own
        if best is not None and best.found.explained > enough:
            return best
    return None


def pulse_of_walls(search: Search, found: Found, least: float) -> Adapted | None:
    """Return the pulse that walls tell which are right but for a common shift, and what they are by it.

    None where the best guess of it has a score below `least`.
    """
    fit = _fit_of(search)
    guess = _climbed(search, fit, _guesses_of(search, fit, found))
    if guess is None or guess.score < least:
        return None
    return _told_by(search, fit, guess, ALL_EXPLAINED - search.uncertainty / 3.0)


def _fit_of(search: Search) -> PulseFit:
    data = search.data.every(max(len(search.data.positions) // _FITTED_TO, 1))
    return PulseFit(WaveformLikelihood(data))


def _ring_guesses(search: Search, first: FirstGuess) -> Iterator[Guess | None]:
    """Give what fits best from outlines that need not be convex, where they are worth clearly more than convex ones."""
    fit, sharp, convex = first.fit, first.sharp, first.convex
    nothing = sharp.nothing
    like = [sharp.power.fitted(power.walls, nothing.with_strength(power.strength), SEARCH_ORDER) for power in convex]
    known = max((power.value for power in like if power is not None), default=nothing.value)
    starts, pool = ring_starts(sharp)
    for start in starts:
        sharp.checkpoint()
        ring = improved_ring(sharp, start, pool)
        judged = sharp.judged(ring, None)
        explains = judged is not None and judged.explained > BY_POWER - sharp.uncertainty
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
        before, guesses = guess.score, _guesses_of(search, fit, settled)
        hopeful = guesses if settled.explained < enough else sorted(guesses, key=lambda each: each.score)[-1:]
        guess = _climbed(search, fit, hopeful)
        if guess is not None and guess.score < before + NO_BETTER:
            break
    return best


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

