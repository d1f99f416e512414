"""The search: from candidate lines to the polygon, by the power likelihood first and the waveform's last."""

import dataclasses
from collections.abc import Generator, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.evidence.data import EchoData
from polymap_ros.mapping.evidence.paths import corners_of
from polymap_ros.mapping.evidence.power import Model, PowerLikelihood
from polymap_ros.mapping.evidence.proposals import (
    Candidates,
    annealed_subset,
    chord_evidence,
    first_strength,
    foot_evidence,
    run_evidence,
    strongest_chords,
    strongest_lines,
)
from polymap_ros.mapping.evidence.waveform import Wave, WaveformLikelihood
from polymap_ros.mapping.lines import edges_of

PRICE = 17.0
"""Nats that one more edge has to bring: its Occam factor, the prior range over the posterior width in r and theta,
ln(3 m / 0.1 mm) + ln(360 deg / 0.05 deg) less ln(2 pi). A false-alarm rate of 1e-3 over the map's cells gives 18."""

POOL = 100
_CHORDS = 12
"""Lines proposed at a time to cut the polygon."""

_LEAST_CHORD = -2.0
"""Evidence from which a cut is tried: at -10 dB a short edge's own feet bring as little, its higher orders the rest."""

_ANNEALING = 20_000
_SEARCH_ORDER = 3
"""Orders 1 and 2 hold a third of the truth's log likelihood in a lossless plate; 3 is what the search can afford."""

_COHERENT = 0.2
"""Share of the power's log likelihood below which the waveform's says that phases are not to be trusted; with them the
waveform is worth more than the power, and with a wrong edge in it still more than half."""

_ALL_EXPLAINED = 0.98
"""Share of the echoes' power from which nothing is looked for in the rest: the tail of higher orders."""

FULL_ORDER = 5
_CUTS = (0.15, 0.3, 0.6)
"""Shares of the shorter edge that a silent wall is tried to take away at a corner."""

_EXCHANGED = 3
"""Edges, those worth least, for which others are tried."""

_LEAST_REFLECTION = 1e-3
"""Reflection coefficient of a wall that is silent, where a logarithm is needed."""

_ROUNDS = 20
_CERTAIN_ODDS = 2.2
"""Log odds of a likelihood of 0.9."""


Steps = Generator[None, None, Model]


class Found(NamedTuple):
    """A polygon as a model of power and, where the echoes agree in phase, as a waveform.

    `explained` is the share of the echoes' power that it explains, `value` its log likelihood less the edges' price;
    `unheard` says that a wall without any echo cuts off a corner.
    """

    model: Model
    wave: Wave | None
    explained: float
    value: float
    unheard: bool = False

    @property
    def lines(self) -> NDArray[np.float64]:
        """r [m] and theta [rad] of the edges, sorted by theta."""
        return self.model.lines if self.wave is None else self.wave.lines


class Search:
    """One search over the pings of `data`; its methods are generators that yield often, so that it can be sliced."""

    def __init__(self, data: EchoData, max_edges: int, generator: np.random.Generator, coherent: bool = True) -> None:
        self.data = data
        self._coherent = coherent
        self.power = PowerLikelihood(data)
        self.wave = WaveformLikelihood(data)
        self._max_edges = max_edges
        self._generator = generator
        self._start = self.power.initial(0.0)
        self._expected = 1.0 + self._start.background[None, :]
        self.pool = np.empty((0, 2))
        self.heard = Candidates(self.pool, np.empty(0))

    def starts(self) -> Iterator[Model | None]:
        """Closed polygons to start from, each found by annealing at another assumed strength; None: none closes."""
        strength = first_strength(self.data, self._expected)
        for factor in (1.0, 2.0, 4.0, 0.5):
            yield self.start(factor * strength)

    def start(self, strength: float) -> Model | None:
        """Anneal over subsets of the strongest lines; None where all lines together bound no polygon."""
        candidates = strongest_lines(self.data, self._expected, strength, POOL)
        self.pool = candidates.lines
        chosen = self.choose(candidates, strength)
        self.heard = Candidates(candidates.lines[chosen], candidates.evidence[chosen])
        subset = self.heard.lines
        for line in (None, *candidates.lines):
            subset = subset if line is None else np.vstack((subset, line))
            lines = active(subset, self.data.shortest_m)
            if len(lines):
                self._start.strength = strength
                return self._start.with_lines(lines)
        return None

    def choose(
        self, candidates: Candidates, strength: float, iterations: int = _ANNEALING
    ) -> NDArray[np.int64]:
        """The subset of candidates with the most first-order evidence at an assumed strength."""
        evidence = foot_evidence(self.data, self._expected, strength)
        return annealed_subset(
            self.data, candidates, evidence, PRICE, self._max_edges, iterations, self._generator)

    def polygon(self, start: Model) -> Generator[None, None, Found | None]:
        """Improve a start by single changes: power of two orders, then of three, then the waveform of five."""
        model = yield from self.improve(start, 2, residual=False)
        model = yield from self.improve(model, _SEARCH_ORDER, residual=True)
        return (yield from self.settle(model))

    def improve(self, model: Model, order: int, residual: bool) -> Steps:
        """Add, drop and exchange edges while the power likelihood less its price grows."""
        model, score = self.power.refine(model, order, 6)
        score -= PRICE * len(model.lines)
        for _ in range(_ROUNDS):
            yield
            trials = self._changes(model, order, residual)
            best = None
            for trial, quick in trials[:4]:
                yield
                refined, value = self.power.refine(trial, order, 4)
                value -= PRICE * len(refined.lines)
                if value > score + 1.0 and (best is None or value > best[1]):
                    best = refined, value
                    if quick > score + 20.0:
                        break
            if best is None:
                break
            model, score = best
        return model

    def _changes(self, model: Model, order: int, residual: bool) -> list[tuple[Model, float]]:
        """Single changes of a model with their unrefined scores, best first."""
        self.power.fit_nuisances(model, order)
        expected = self.power.expected(model)
        pool = self.pool
        if residual:
            _, corners = corners_of(model.lines)
            pool = np.vstack((strongest_chords(self.data, expected, model.strength, corners, _CHORDS), pool))
        trials = [self._with_line(model, line) for line in self._promising(model, expected, pool, _CHORDS)]
        for wall in range(len(model.lines)):
            fewer = model.without(wall)
            if np.isfinite(self.power(fewer, order)):
                trials.append(fewer)
                trials += [self._with_line(fewer, line)
                           for line in self._promising(fewer, self.power.expected(fewer), pool, 2)]
            else:  # nothing closes without it: exchange it for lines that face the same way
                turn = np.abs(np.angle(np.exp(1j * (pool[:, 1] - model.lines[wall, 1]))))
                trials += [self._with_line(fewer, line) for line in pool[turn < 1.0][:12]]
        scored = [(trial, self.power(trial, order) - PRICE * len(trial.lines))
                  for trial in trials if trial is not None and len(trial.lines) <= self._max_edges]
        return sorted((entry for entry in scored if np.isfinite(entry[1])), key=lambda entry: -entry[1])

    def _promising(
        self, model: Model, expected: NDArray[np.float64], pool: NDArray[np.float64], most: int
    ) -> NDArray[np.float64]:
        """Lines of the pool with the most unexplained first-order evidence where they cut the polygon."""
        _, corners = corners_of(model.lines)
        evidence = foot_evidence(self.data, expected, model.strength)
        gains = chord_evidence(pool, corners, self.data.positions, evidence, self.data.cell_m)
        best = np.argsort(-gains, kind='stable')[:most]
        return pool[best[gains[best] > _LEAST_CHORD]]

    def _with_line(self, model: Model, line: NDArray[np.float64]) -> Model | None:
        lines = active(np.vstack((model.lines, line)), self.data.shortest_m)
        if len(lines) == 0:
            return None
        kept = {tuple(known): loss for known, loss in zip(model.lines.tolist(), model.loss, strict=True)}
        return model.with_lines(lines, np.array([kept.get(tuple(entry), 0.0) for entry in lines.tolist()]))

    def certain_walls(self) -> list[tuple[NDArray[np.float64], float]]:
        """Lines heard at first order with their evidence, each echo counted for the strongest of them only."""
        data = self.data
        expected = np.broadcast_to(self._expected, data.power.shape).copy()
        cells = data.cell_m * np.arange(data.power.shape[1])
        walls = []
        for line in self.heard.lines[np.argsort(-self.heard.evidence, kind='stable')]:
            evidence = run_evidence(data, expected, self._start.strength, line)
            if evidence < PRICE + _CERTAIN_ODDS:
                continue
            walls.append((line, evidence))
            distance = line[0] - data.positions @ np.array([np.cos(line[1]), np.sin(line[1])])
            near = np.abs(cells - distance[:, None]) < 2.0 * data.pulse.width_m
            expected = np.where(near, np.maximum(expected, data.power), expected)
        return walls

    @property
    def uncertainty(self) -> float:
        """Three standard deviations of the share explained, which noise alone makes uncertain."""
        cells = self.data.power[:, self.data.first_cell:]
        excess = max(float(np.sum(cells - 1.0)), 1e-300)
        return 3.0 * float(np.sqrt(2.0 * cells.size / self.data.weight)) / excess

    def again(self, last: Found) -> Generator[None, None, Found | None]:
        """The last answer, refined on the pings of today."""
        yield
        model = self._start.with_lines(last.lines, last.model.loss)
        model.strength = last.model.strength
        if last.wave is None or not self._coherent:
            model, _ = self.power.refine(model, FULL_ORDER, 3)
            return self._judged(model, None)
        wave = self.wave.refine(last.wave.lines, last.wave.reflection, last.wave.phase, FULL_ORDER, 3)
        found = None if wave is None else self._judged(model.with_lines(wave.lines, model.loss), wave)
        return None if found is None else found._replace(unheard=last.unheard)

    def settle(self, model: Model) -> Generator[None, None, Found | None]:
        """Refine by the waveform, then drop and add edges as long as the waveform's likelihood asks for it.

        Where the waveform is worth far less than power alone is, the echoes do not agree in phase (positions that are
        off by a quarter of a wavelength do that): then power has the last word.
        """
        model, score = self.power.refine(model, FULL_ORDER, 6)
        wave = self._aligned(model) if self._coherent else None
        if wave is None or wave.value < _COHERENT * score:
            model = yield from self.improve(model, FULL_ORDER, residual=True)
            return self._judged(model, None)
        return (yield from self._settled(model, wave))

    def _settled(self, model: Model, wave: Wave) -> Generator[None, None, Found | None]:
        """Single changes of the waveform while they are worth it."""
        for _ in range(_ROUNDS):
            yield
            changed = yield from self._dropped(wave)
            explained = self._explained(wave)
            if changed is None and explained < _ALL_EXPLAINED + self.uncertainty:
                changed = yield from self._slipped(wave)
            if changed is None and explained < _ALL_EXPLAINED:
                changed = yield from self._added(model, wave)
            if changed is None:
                break
            wave = changed
        found = self._judged(model.with_lines(wave.lines, 2.0 * np.log(np.abs(wave.reflection))), wave)
        unheard = yield from self._cut_off(wave)
        return None if found is None else found._replace(unheard=unheard)

    def _cut_off(self, wave: Wave) -> Generator[None, None, bool]:
        """Whether a silent wall across a corner, which takes echoes away that were not heard, is worth its price."""
        _, corners = corners_of(wave.lines)
        lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        for corner in range(len(corners)):
            yield
            before, after = wave.lines[corner - 1, 1], wave.lines[corner, 1]
            theta = before + 0.5 * np.mod(after - before, 2.0 * np.pi)
            normal = np.array([np.cos(theta), np.sin(theta)])
            # Depth of a cut that takes a share of the shorter edge away from the corner.
            depth = min(lengths[corner - 1], lengths[corner]) * np.sin(0.5 * np.mod(after - before, 2.0 * np.pi))
            furthest = float(np.max(self.data.positions @ normal))
            for share in _CUTS:
                r = float(corners[corner] @ normal) - share * depth
                lines = np.vstack((wave.lines, (r, np.angle(np.exp(1j * theta)))))
                order = np.argsort(lines[:, 1], kind='stable')
                reflection = np.append(wave.reflection, 0.0)[order]
                if r <= furthest:
                    break
                cut = self.wave.evaluate(np.ascontiguousarray(lines[order]), reflection, wave.phase, FULL_ORDER, False)
                if cut is not None and cut.value - PRICE > wave.value:
                    return True
        return False

    def judge(self, model: Model) -> Found | None:
        """A model as it stands, by its waveform."""
        return self._judged(model, self._aligned(model) if self._coherent else None)

    def _judged(self, model: Model, wave: Wave | None) -> Found | None:
        """What a polygon explains of the echoes' power, and what it is worth."""
        first = self.data.first_cell
        excess = self.data.power[:, first:] - 1.0
        price = PRICE * len(model.lines)
        if wave is not None:
            return Found(model, wave, self._explained(wave), wave.value - price)
        value = self.power.fit_nuisances(model, FULL_ORDER)
        if not np.isfinite(value):
            return None
        predicted = model.strength * self.power.explained[:, first:]
        # Of the excess, what follows the prediction from cell to cell (a regression's share).
        explained = float(np.sum(predicted * excess)) / max(float(np.sum(predicted**2)), 1e-300)
        explained *= float(np.sum(predicted)) / max(float(excess.sum()), 1e-300)
        return Found(model, None, min(explained, 1.0), value - price)

    def _explained(self, wave: Wave) -> float:
        """Share of the echoes' power that the waveform takes away."""
        first = self.data.first_cell
        left = self.wave.residual_power(wave, FULL_ORDER)[:, first:] - 1.0
        excess = self.data.power[:, first:] - 1.0
        return 1.0 - float(left.sum()) / max(float(excess.sum()), 1e-300)

    def _aligned(self, model: Model) -> Wave | None:
        """The waveform's maximum near a refined power model, from the first order up."""
        reflection, phase = self.wave.signs(model.lines, model.loss)
        wave = self.wave.refine(model.lines, reflection, phase, 1)
        if wave is None:
            return None
        turned = (self.wave.refine(wave.lines, sign * wave.reflection, wave.phase + turn, _SEARCH_ORDER)
                  for sign, turn in ((1.0, 0.0), (-1.0, np.pi)))  # echoes of even order tell these apart
        wave = max((each for each in turned if each is not None), key=lambda each: each.value, default=None)
        return wave and self.wave.refine(wave.lines, wave.reflection, wave.phase, FULL_ORDER)

    def _dropped(self, wave: Wave) -> Generator[None, None, Wave | None]:
        """The best waveform with one edge fewer, if it is worth more."""
        best = None
        for wall in range(len(wave.lines)):
            fewer = without_wall(self.wave, wave, wall)
            if fewer is None or fewer.value + PRICE < wave.value - 400.0:
                continue
            yield
            fewer = self.wave.refine(fewer.lines, fewer.reflection, fewer.phase, FULL_ORDER)
            if fewer is not None and (best is None or fewer.value > best.value):
                best = fewer
        return best if best is not None and best.value + PRICE > wave.value else None

    def _slipped(self, wave: Wave) -> Generator[None, None, Wave | None]:
        """The best waveform with one wall half a cycle of range off and its sign turned, or a whole cycle off."""
        cycle = np.pi / self.data.pulse.carrier
        trials = []
        for wall in range(len(wave.lines)):
            yield
            for slip, sign in ((-0.5, -1.0), (0.5, -1.0), (-1.0, 1.0), (1.0, 1.0)):
                lines, reflection = wave.lines.copy(), wave.reflection.copy()
                lines[wall, 0] += slip * cycle
                reflection[wall] *= sign
                moved = self.wave.evaluate(lines, reflection, wave.phase, FULL_ORDER, derive=False)
                if moved is not None:
                    trials.append(moved)
        for trial in sorted(trials, key=lambda moved: -moved.value)[:2]:
            yield
            moved = self.wave.refine(trial.lines, trial.reflection, trial.phase, FULL_ORDER)
            if moved is not None and moved.value > wave.value + 1.0:
                return moved
        return None

    def _added(self, model: Model, wave: Wave) -> Generator[None, None, Wave | None]:
        """The best waveform with one edge more, proposed by what the waveform leaves unexplained."""
        if len(wave.lines) >= self._max_edges:
            return None
        left = dataclasses.replace(self.data, power=self.wave.residual_power(wave, FULL_ORDER))
        expected = np.maximum(np.mean(left.power, axis=0, keepdims=True), 1.0)
        base = self._base(model, wave)
        _, corners = corners_of(wave.lines)
        lines = strongest_chords(left, expected, base.strength, corners, _CHORDS)
        return (yield from self._with_another(base, lines, wave.value - PRICE * len(wave.lines)))

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
        base = model.with_lines(wave.lines, 2.0 * np.log(np.maximum(np.abs(wave.reflection), _LEAST_REFLECTION)))
        self.power.fit_nuisances(base, _SEARCH_ORDER)
        return base

    def _scan(self, base: Model) -> Generator[None, None, NDArray[np.float64]]:
        """Lines that cut the polygon, a pulse's width apart in r and over the path: those with the most power."""
        width = self.data.pulse.width_m
        _, corners = corners_of(base.lines)
        theta = np.arange(-np.pi, np.pi, 2.0 * width / self.data.extent_m)
        rows = []
        for angle in theta:
            yield
            normal = np.array([np.cos(angle), np.sin(angle)])
            low = float(np.max(self.data.positions @ normal))
            high = min(float(np.max(corners @ normal)), low + self.data.range_max_m / 2.0)
            trials = ((r, self._with_line(base, np.array([r, angle]))) for r in np.arange(low + width / 2.0, high, width))
            rows += [(self.power(trial, 2), r, angle) for r, trial in trials if trial is not None]
        best: list[tuple[float, float, float]] = []
        for value, r, angle in sorted(rows, reverse=True):
            if len(best) == _CHORDS:
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
        score = self.power(base, _SEARCH_ORDER)
        refined = []
        for line in lines:
            trial = self._with_line(base, line)
            if trial is None or len(trial.lines) > self._max_edges or not np.isfinite(self.power(trial, _SEARCH_ORDER)):
                continue
            yield
            trial, _ = self.power.refine(trial, 2, 3)
            refined.append(self.power.refine(trial, _SEARCH_ORDER, 4))
        for trial, power in sorted(refined, key=lambda entry: -entry[1])[:2]:
            if power < score + PRICE:
                break
            yield
            more = self._aligned(self.power.refine(trial, FULL_ORDER, 6)[0])
            if more is not None and more.value - PRICE * len(more.lines) > value + 1.0:
                return more
        return None


def active(lines: NDArray[np.float64], shortest_m: float) -> NDArray[np.float64]:
    """The lines that make an edge of their polygon, sorted by theta; none where they bound none.

    Of edges no longer than `shortest_m`, the shortest is taken away first.
    """
    while True:
        _, along, which = edges_of(np.ascontiguousarray(lines))
        lines = lines[which]
        if len(lines) == 0:
            return lines
        lengths = np.linalg.norm(along, axis=1)
        if lengths.min() > shortest_m:
            return lines[np.argsort(lines[:, 1], kind='stable')]
        lines = np.delete(lines, np.argmin(lengths), 0)


def without_wall(likelihood: WaveformLikelihood, wave: Wave, wall: int) -> Wave | None:
    """The waveform with one wall left out, neither refined nor derived; None where the others bound no polygon."""
    lines, reflection = np.delete(wave.lines, wall, 0), np.delete(wave.reflection, wall)
    return likelihood.evaluate(np.ascontiguousarray(lines), reflection, wave.phase, FULL_ORDER, derive=False)
