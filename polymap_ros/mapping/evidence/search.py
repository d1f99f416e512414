"""The whole search: the polygon that power finds, put right by the waveform's likelihood."""

import dataclasses
from collections.abc import Generator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.evidence.data import EchoData
from polymap_ros.mapping.evidence.paths import corners_of
from polymap_ros.mapping.evidence.power import Model
from polymap_ros.mapping.evidence.power_search import CHORDS, PRICE, ROUNDS, SEARCH_ORDER, PowerSearch
from polymap_ros.mapping.evidence.proposals import corner_cuts, strongest_chords
from polymap_ros.mapping.evidence.waveform import Wave, WaveformLikelihood

FULL_ORDER = 5
"""Orders of reflection that the waveform explains."""

_COHERENT = 0.2
"""Share of the power's log likelihood below which the waveform's says that phases are not to be trusted. At the
right polygon the waveform is worth 1.1 times the power at 0 dB and twice as much at -10 dB; where positions are off by
5 mm, 0.01 to 0.15, seldom a third (random plates, even seeds). Wrong polygons are worth all between."""

_IN_PHASE = 0.4
"""The same share after the single changes that the waveform asks for. Where positions are off by 5 mm, what took to
phases by accident ends at 0.2 to 0.3, with walls lost that power had found; what is right, at 0.7 or more."""

OBVIOUS = 400.0
"""Nats by which a waveform may be worse without a wall to be refitted: the others, three numbers each, make up for tens
where they take the place of the one that is missing; a wall that is heard is worth thousands."""

_ALL_EXPLAINED = 0.98
"""Share of the echoes' power from which nothing is looked for in the rest: the tail of higher orders."""

_WHOLE = 0.995
"""Share from which not even an edge as short as the pulse may be missing."""

_SHORT, _CUTS = (1.2, 2.5, 5.0), 10
"""Pulse widths of the edges by which corners are cut off, and how many of these, the best by power, are looked into."""

_MISFIT = 0.005
"""Share of the log likelihood that an edge has to bring, where that is more than its price. At the truth it differs by
up to 0.7 % from that of full waveform synthesis, and what is predicted a little wrong, an edge that is not there may
put right. In 36 random plates every edge brings more than 20 %."""

_EXCHANGED = 2
"""Edges, those worth least, for which others are tried."""

_SCAN_WIDTHS = 1.25
"""Pulse widths between the lines that are tried: power is smooth over one to each side."""

_RESCORED = 300
"""Of these, the best by a few pings, so many are scored by all."""


class Found(NamedTuple):
    """A polygon as a model of power and, where the echoes agree in phase, as a waveform.

    `explained` is the share of the echoes' power that it explains, `value` its log likelihood less the edges' price;
    `misplaced_m` says by how much the pings were moved in x and y (standard deviation) for their echoes to agree.
    """

    model: Model
    wave: Wave | None
    explained: float
    value: float
    misplaced_m: float = 0.0

    @property
    def lines(self) -> NDArray[np.float64]:
        """r [m] and theta [rad] of the edges, sorted by theta."""
        return self.model.lines if self.wave is None else self.wave.lines

    @property
    def reflection(self) -> NDArray[np.float64]:
        """Reflection coefficients of the edges, signed where there is phase."""
        return np.exp(0.5 * self.model.loss) if self.wave is None else self.wave.reflection

    def moved_to(self, lines: NDArray[np.float64]) -> 'Found':
        """The same walls on other lines, not judged anew."""
        return self._replace(model=dataclasses.replace(self.model, lines=lines),
                             wave=self.wave and dataclasses.replace(self.wave, lines=lines))


class Search(PowerSearch):
    """A search that ends with the waveform, if `coherent`, and with power alone otherwise.

    Echoes that are `dispersed` are drawn out, the more the farther they come: their pulse is not the one looked for.
    """

    def __init__(
        self, data: EchoData, max_edges: int, generator: np.random.Generator, coherent: bool = True,
        dispersed: bool = False,
    ) -> None:
        super().__init__(data, max_edges, generator)
        self.wave = WaveformLikelihood(data)
        self.few_wave = WaveformLikelihood(self.few.data)
        self.coherent, self.dispersed = coherent, dispersed

    def over(self, data: EchoData) -> 'Search':
        """The same search over other data."""
        return Search(data, self.max_edges, self._generator, self.coherent, self.dispersed)

    def polygon(self, start: Model) -> Generator[None, None, Found | None]:
        """Improve a start by single changes: power of two orders, then of three, then the waveform of five."""
        model = yield from self.improve(start, 2, residual=False)
        model = yield from self.improve(model, SEARCH_ORDER, residual=True)
        return (yield from self.settle(model))

    def again(self, last: Found) -> Generator[None, None, Found | None]:
        """The last answer, refined on the pings of today."""
        yield
        model = self._start.with_lines(last.lines, last.model.loss)
        model.strength = last.model.strength
        if last.wave is None or not self.coherent:
            model, _ = self.power.refine(model, FULL_ORDER, 3)
            return self._judged(model, None)
        wave = self.wave.refine(last.wave.lines, last.wave.reflection, last.wave.phase, FULL_ORDER, 3)
        if wave is None:
            return None
        return self._judged(model.with_lines(wave.lines, model.loss), wave, enough=_ALL_EXPLAINED)

    def settle(self, model: Model) -> Generator[None, None, Found | None]:
        """Refine by the waveform, then drop and add edges as long as the waveform's likelihood asks for it.

        Where the waveform is worth far less than power alone is, even after walls that lie half a cycle off were
        put right, the echoes do not agree in phase (positions that are off by a quarter of a wavelength do that): then
        power has the last word.
        """
        model, score = self.power.refine(model, FULL_ORDER, 6)
        wave = self._aligned(model) if self.coherent else None
        for _ in model.lines:
            if wave is None or wave.value >= _COHERENT * score:
                break
            wave = yield from self._slipped(wave, np.arange(len(wave.lines)))
        found = None
        if wave is not None and wave.value >= _COHERENT * score:
            found = yield from self._settled(model, wave)
        if found is None or found.value < _IN_PHASE * score:
            model = yield from self.improve(model, FULL_ORDER, residual=True)
            return self._judged(model, None)
        return found

    def _settled(self, model: Model, wave: Wave) -> Generator[None, None, Found | None]:
        """Single changes of the waveform while they are worth it."""
        for _ in range(ROUNDS):
            yield
            changed, explained = None, self._explained(wave)
            doubtful = self._short_edges(wave)
            if explained < _ALL_EXPLAINED + self.uncertainty:  # before a wall goes that is only half a cycle off
                doubtful = np.arange(len(wave.lines))
            if len(doubtful):
                changed = yield from self._slipped(wave, doubtful)
            if changed is None:
                changed = yield from self._dropped(wave)
            if changed is None and explained < _ALL_EXPLAINED:
                changed = yield from self._added(model, wave)
            if changed is None and explained < _WHOLE:
                changed = yield from self._shortened(model, wave)
            if changed is None:
                break
            wave = changed
        return self._judged(model.with_lines(wave.lines, wave.loss), wave)

    def judge(self, model: Model) -> Found | None:
        """A model as it stands, by its waveform."""
        return self._judged(model, self._aligned(model) if self.coherent else None)

    def _judged(self, model: Model, wave: Wave | None, enough: float = np.inf) -> Found | None:
        """What a polygon explains of the echoes' power, and what it is worth."""
        price = PRICE * len(model.lines)
        if wave is not None:
            return Found(model, wave, self._explained(wave, enough), wave.value - price)
        first = self.data.first_cell
        excess = self.data.power[:, first:] - 1.0
        value = self.power.fit_nuisances(model, FULL_ORDER)
        if not np.isfinite(value):
            return None
        predicted = model.strength * self.power.explained[:, first:]
        # Of the excess, what follows the prediction from cell to cell (a regression's share).
        explained = float(np.sum(predicted * excess)) / max(float(np.sum(predicted**2)), 1e-300)
        explained *= float(np.sum(predicted)) / max(float(excess.sum()), 1e-300)
        return Found(model, None, min(explained, 1.0), value - price)

    def _explained(self, wave: Wave, enough: float = np.inf) -> float:
        """Share of the echoes' power that the waveform takes away, by a part of the pings where that is `enough`."""
        if enough < np.inf:
            of_few = dataclasses.replace(wave, amplitudes=wave.amplitudes[::self._share])
            share = _taken_away(self.few_wave, of_few)
            if share > enough:
                return share
        return _taken_away(self.wave, wave)

    def _aligned(self, model: Model) -> Wave | None:
        """The waveform's maximum near a refined power model, from the first order up."""
        reflection, phase = self.wave.signs(model.lines, model.loss)
        wave = self.wave.refine(model.lines, reflection, phase, 1)
        if wave is None:
            return None
        both = (wave.reflection, wave.phase), (-wave.reflection, wave.phase + np.pi)  # echoes of even order tell which
        turned = [self.wave.evaluate(wave.lines, *signs, SEARCH_ORDER, derive=False) for signs in both]
        wave = max((each for each in turned if each is not None), key=lambda each: each.value, default=None)
        wave = wave and self.wave.refine(wave.lines, wave.reflection, wave.phase, SEARCH_ORDER)
        return wave and self.wave.refine(wave.lines, wave.reflection, wave.phase, FULL_ORDER)

    def _dropped(self, wave: Wave) -> Generator[None, None, Wave | None]:
        """The best waveform with one edge fewer, if it is worth more."""
        best = None
        for wall in range(len(wave.lines)):
            fewer = without_wall(self.wave, wave, wall)
            if fewer is None or fewer.value + PRICE < wave.value - OBVIOUS:
                continue
            yield
            fewer = self.wave.refine(fewer.lines, fewer.reflection, fewer.phase, FULL_ORDER)
            if fewer is not None and (best is None or fewer.value > best.value):
                best = fewer
        return best if best is not None and self._worth(best) > self._worth(wave) else None

    def _worth(self, wave: Wave) -> float:
        """Log likelihood less the edges' price; of two that are one wall, the second has to bring enough to be sure."""
        twins = sum(self.one_of(line, wave.lines[:wall]) for wall, line in enumerate(wave.lines))
        return wave.value - PRICE * (len(wave.lines) - twins) - least_gain(wave.value) * twins

    def _short_edges(self, wave: Wave) -> NDArray[np.intp]:
        """Walls so short that their few echoes leave open, at all that is explained, which cycle they are of."""
        _, corners = corners_of(wave.lines)
        lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        return np.flatnonzero(lengths < _SHORT[-1] * self.data.pulse.width_m)

    def _slipped(self, wave: Wave, walls: NDArray[np.intp]) -> Generator[None, None, Wave | None]:
        """The best waveform with one of these walls half a cycle of range off, its sign turned, or a whole cycle off.

        A part of the pings tells which of these may be worth more once all walls are refined.
        """
        cycle, trials = np.pi / self.data.pulse.carrier, []
        as_is = self.few_wave.evaluate(wave.lines, wave.reflection, wave.phase, SEARCH_ORDER, derive=False)
        least = -np.inf if as_is is None else as_is.value - OBVIOUS
        for wall in walls:
            yield
            for slip, sign in ((-0.5, -1.0), (0.5, -1.0), (-1.0, 1.0), (1.0, 1.0)):
                lines, reflection = wave.lines.copy(), wave.reflection.copy()
                lines[wall, 0] += slip * cycle
                reflection[wall] *= sign
                moved = self.few_wave.evaluate(lines, reflection, wave.phase, SEARCH_ORDER, derive=False)
                if moved is not None and moved.value > least:
                    trials.append(moved)
        for trial in sorted(trials, key=lambda moved: -moved.value)[:2]:
            yield
            refined = self.wave.refine(trial.lines, trial.reflection, trial.phase, FULL_ORDER)
            if refined is not None and refined.value > wave.value + 1.0:
                return refined
        return None

    def _added(self, model: Model, wave: Wave) -> Generator[None, None, Wave | None]:
        """The best waveform with one edge more, proposed by what the waveform leaves unexplained."""
        if len(wave.lines) >= self.max_edges:
            return None
        left = dataclasses.replace(self.data, power=self.wave.residual_power(wave, FULL_ORDER))
        expected = np.maximum(np.mean(left.power, axis=0, keepdims=True), 1.0)
        base = self._base(model, wave)
        _, corners = corners_of(wave.lines)
        lines = strongest_chords(left, expected, base.strength, corners, CHORDS)
        return (yield from self._with_another(base, lines, self._worth(wave)))

    def _shortened(self, model: Model, wave: Wave) -> Generator[None, None, Wave | None]:
        """The best waveform with a corner cut off by an edge too short for its feet to propose it.

        Power tells roughly where, and the waveform, by a part of the pings, which of these and how far from the corner.
        """
        if len(wave.lines) >= self.max_edges:
            return None
        base = self._base(model, wave)
        _, corners = corners_of(wave.lines)
        trials = []
        for line in corner_cuts(wave.lines[:, 1], corners, [share * self.data.pulse.width_m for share in _SHORT]):
            trial = self._with_line(base, line)
            if trial is not None and len(trial.lines) > len(wave.lines):
                trials.append((self.few(trial, SEARCH_ORDER), *line))
        yield
        cuts = [self._slid(wave, np.array(line)) for _, *line in sorted(trials, reverse=True)[:_CUTS]]
        yield
        more = None
        for cut in sorted((cut for cut in cuts if cut is not None), key=lambda cut: -cut.value)[:2]:
            refined = self.wave.refine(cut.lines, cut.reflection, cut.phase, FULL_ORDER)
            yield
            if refined is not None and refined.value > (more.value if more else wave.value + least_gain(wave.value)):
                more = refined
        return more

    def _slid(self, wave: Wave, line: NDArray[np.float64]) -> Wave | None:
        """The best waveform, by a part of the pings, with a line more that may be off by a cycle of range."""
        index = int(np.searchsorted(wave.lines[:, 1], line[1]))
        best = None
        for slip in np.arange(-1.0, 1.01, 0.2) * np.pi / self.data.pulse.carrier:
            lines = np.ascontiguousarray(np.insert(wave.lines, index, line - (slip, 0.0), axis=0))
            for sign in (1.0, -1.0):
                reflection = np.insert(wave.reflection, index, sign)
                trial = self.few_wave.evaluate(lines, reflection, wave.phase, SEARCH_ORDER, derive=False)
                if trial is not None and (best is None or trial.value > best.value):
                    best = trial
        return best

    def mended(self, found: Found) -> Generator[None, None, Found | None]:
        """Exchange one of the edges that are worth least, or add one, by trying every line in their place.

        The last resort: a wall that no ping hears directly is proposed by nothing else.
        """
        wave = found.wave
        if wave is None:
            return None
        bases = []
        for wall in range(len(wave.lines)):
            yield
            bases.append(self._taken_away(wave, wall))
        worth = sorted((base for base in bases if base is not None), key=lambda base: -base.value)
        for other in (*worth[:_EXCHANGED], wave):
            base = self._base(found.model, other)
            lines = yield from self._scan(base)
            changed = yield from self._with_another(base, lines, found.value)
            if changed is not None:
                return (yield from self._settled(found.model, changed))
        return None

    def _base(self, model: Model, wave: Wave) -> Model:
        """The walls of a waveform as a model of power."""
        base = model.with_lines(wave.lines, wave.loss)
        self.power.fit_nuisances(base, SEARCH_ORDER)
        return base

    def _scan(self, base: Model) -> Generator[None, None, NDArray[np.float64]]:
        """Lines that cut the polygon, a bit more than a pulse's width apart: those with the most power."""
        width = _SCAN_WIDTHS * self.data.pulse.width_m
        _, corners = corners_of(base.lines)
        theta = np.arange(-np.pi, np.pi, 2.0 * width / self.data.extent_m)
        trials = []
        for angle in theta:
            yield
            normal = np.array([np.cos(angle), np.sin(angle)])
            low = float(np.max(self.data.positions @ normal))
            high = min(float(np.max(corners @ normal)), low + self.data.range_max_m / 2.0)
            for r in np.arange(low + width / 2.0, high, width):
                trial = self._with_line(base, np.array([r, angle]))
                if trial is not None:
                    trials.append((self.few(trial, 2), float(r), float(angle), trial))
        trials.sort(key=lambda entry: entry[:3], reverse=True)
        rows = [(self.power(trial, 2), r, angle) for _, r, angle, trial in trials[:_RESCORED]]
        best: list[tuple[float, float, float]] = []
        for value, r, angle in sorted(rows, reverse=True):
            if len(best) == CHORDS:
                break
            turn = theta[1] - theta[0]
            if all(abs(r - other) > 2.5 * width or abs(np.angle(np.exp(1j * (angle - at)))) > 2.5 * turn
                   for _, other, at in best):
                best.append((value, r, angle))
        return np.array([(r, angle) for _, r, angle in best]).reshape(-1, 2)

    def _taken_away(self, wave: Wave, wall: int) -> Wave | None:
        """The waveform without a wall; where nothing closes without it, it is moved beyond hearing and silent."""
        fewer = without_wall(self.wave, wave, wall)
        if fewer is not None:
            return fewer
        lines, reflection = wave.lines.copy(), wave.reflection.copy()
        lines[wall, 0] += self.data.range_max_m
        reflection[wall] = 0.0
        return self.wave.evaluate(lines, reflection, wave.phase, FULL_ORDER, derive=False)

    def _with_another(
        self, base: Model, lines: NDArray[np.float64], value: float
    ) -> Generator[None, None, Wave | None]:
        """The best waveform with one of `lines` added to a base, if it is worth more than `value`."""
        score = self.power(base, SEARCH_ORDER)
        refined = []
        for line in lines:
            trial = self._with_line(base, line)
            if trial is None or len(trial.lines) > self.max_edges or not np.isfinite(self.power(trial, SEARCH_ORDER)):
                continue
            yield
            trial, _ = self.power.refine(trial, 2, 3)
            refined.append(self.power.refine(trial, SEARCH_ORDER, 4))
        for trial, power in sorted(refined, key=lambda entry: -entry[1])[:2]:
            if power < score + PRICE:
                break
            yield
            more = self._aligned(self.power.refine(trial, FULL_ORDER, 6)[0])
            if more is not None and self._worth(more) > value + 1.0:
                return more
        return None


def _taken_away(likelihood: WaveformLikelihood, wave: Wave) -> float:
    data = likelihood.data
    left = likelihood.residual_power(wave, FULL_ORDER)[:, data.first_cell:]
    return 1.0 - float(np.sum(left - 1.0)) / data.excess


def least_gain(value: float) -> float:
    """Nats that an edge has to bring to be sure, where all are worth so many."""
    return max(PRICE, _MISFIT * value)


def without_wall(likelihood: WaveformLikelihood, wave: Wave, wall: int) -> Wave | None:
    """The waveform with one wall left out, neither refined nor derived; None where the others bound no polygon."""
    lines, reflection = np.delete(wave.lines, wall, 0), np.delete(wave.reflection, wall)
    return likelihood.evaluate(np.ascontiguousarray(lines), reflection, wave.phase, FULL_ORDER, derive=False)
