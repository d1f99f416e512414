"""The search by power: from candidate lines to a polygon, by annealing over subsets and by single changes."""

from collections.abc import Callable, Generator, Iterable, Iterator

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
    strongest_chords,
    strongest_lines,
)
from polymap_ros.mapping.lines import edges_of

PRICE = 17.0
"""Nats that one more edge has to bring: its Occam factor, the prior range over the posterior width in r and theta,
ln(3 m / 0.1 mm) + ln(360 deg / 0.05 deg) less ln(2 pi). A false-alarm rate of 1e-3 over a map of
600 x 360 cells gives 19."""

SEARCH_ORDER = 3
"""Orders 1 and 2 hold a third of the truth's log likelihood in a lossless plate; 3 is what the search can afford."""

ROUNDS = 20
"""Single changes in a row, at most."""

CHORDS = 12
"""Lines proposed at a time to cut the polygon."""

_LEAST_CHORD = -2.0
"""Evidence from which a cut is tried: at -10 dB a short edge's own feet bring as little, its higher orders the rest."""

_WORTH = 5.0
"""Nats from which a change is another polygon, and not the same one refined again: under a third of an edge's price."""

_FEW, _ENOUGH, _SCORED = 3, 20, 12
"""One ping of so many scores all changes first, but so many at least; the best of these are scored by all pings."""

_POOL = 100
_ANNEALING = 20_000

Steps = Generator[None, None, Model]


class PowerSearch:
    """One search over the pings of `data`; its methods are generators that yield often, so that it can be sliced."""

    def __init__(self, data: EchoData, max_edges: int, generator: np.random.Generator) -> None:
        self.data = data
        self.power = PowerLikelihood(data)
        self._share = max(min(len(data.positions) // _ENOUGH, _FEW), 1)
        self.few = PowerLikelihood(data.every(self._share))
        self.max_edges = max_edges
        self._generator = generator
        self._start = self.power.initial(0.0)
        self._expected = 1.0 + self._start.background[None, :]
        self.pool = np.empty((0, 2))

    def starts(self) -> Iterator[Model | None]:
        """Closed polygons to start from, each found by annealing at another assumed strength; None: none closes."""
        strength = first_strength(self.data, self._expected)
        for factor in (1.0, 2.0, 4.0, 0.5):
            yield self.start(factor * strength)

    def start(self, strength: float) -> Model | None:
        """Anneal over subsets of the strongest lines; None where all lines together bound no polygon."""
        candidates = strongest_lines(self.data, self._expected, strength, _POOL)
        self.pool = candidates.lines
        chosen = self.choose(candidates, strength)
        subset = candidates.lines[chosen]
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
            self.data, candidates, evidence, PRICE, self.max_edges, iterations, self._generator)

    def improve(self, model: Model, order: int, residual: bool) -> Steps:
        """Add, drop and exchange edges while the power likelihood less its price grows.

        With lines from the `residual`, too, and down to small gains; without, only what is better as it stands.
        """
        model, score = self.power.refine(model, order, 6)
        score -= PRICE * len(model.lines)
        for _ in range(ROUNDS):
            yield
            trials = self._changes(model, order, residual)
            best = None
            for trial, quick in trials[:4]:
                if quick <= score and not residual:  # left for the next order
                    break
                yield
                refined, value = self.power.refine(trial, order, 4)
                value -= PRICE * len(refined.lines)
                if value > score + (1.0 if residual else _WORTH) and (best is None or value > best[1]):
                    best = refined, value
                    if value > score + PRICE:
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
            pool = np.vstack((strongest_chords(self.data, expected, model.strength, corners, CHORDS), pool))
        trials = [self._with_line(model, line) for line in self._promising(model, expected, pool, CHORDS, model.lines)]
        for wall in range(len(model.lines)):
            fewer = model.without(wall)
            if np.isfinite(self.power(fewer, order)):
                trials.append(fewer)
                trials += [self._with_line(fewer, line)
                           for line in self._promising(fewer, self.power.expected(fewer), pool, 2, model.lines)]
            else:  # nothing closes without it: exchange it for lines that face the same way
                turn = np.abs(np.angle(np.exp(1j * (pool[:, 1] - model.lines[wall, 1]))))
                trials += [self._with_line(fewer, line) for line in pool[turn < 1.0][:12]]
        allowed = [trial for trial in trials if trial is not None and len(trial.lines) <= self.max_edges]
        few = [trial for trial, _ in _best_first(allowed, lambda trial: self._share * self.few(trial, order))]
        return _best_first(few[:_SCORED], lambda trial: self.power(trial, order))

    def _promising(
        self, model: Model, expected: NDArray[np.float64], pool: NDArray[np.float64], most: int,
        other_than: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Lines of the pool with the most unexplained first-order evidence where they cut the polygon.

        Those that are no other wall than a better one, or than `other_than`, are left out: refined, they would be it.
        """
        _, corners = corners_of(model.lines)
        evidence = foot_evidence(self.data, expected, model.strength)
        gains = chord_evidence(pool, corners, self.data.positions, evidence, self.data.cell_m)
        chosen = list(other_than)
        for index in np.argsort(-gains, kind='stable'):
            if len(chosen) == most + len(other_than) or gains[index] <= _LEAST_CHORD:
                break
            if not self.one_of(pool[index], chosen):
                chosen.append(pool[index])
        return np.array(chosen[len(other_than):]).reshape(-1, 2)

    def one_of(self, line: NDArray[np.float64], known: Iterable[NDArray[np.float64]]) -> bool:
        """Whether no ping's distance from a line is a pulse's width other than from one that is known."""
        return any(np.abs(self._distances(line) - self._distances(wall)).max() < self.data.pulse.width_m
                   for wall in known)

    def _distances(self, line: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of a line from every ping [m]."""
        away: NDArray[np.float64] = line[0] - self.data.positions @ np.array([np.cos(line[1]), np.sin(line[1])])
        return away

    def _with_line(self, model: Model, line: NDArray[np.float64]) -> Model | None:
        lines = active(np.vstack((model.lines, line)), self.data.shortest_m)
        if not len(lines):
            return None
        kept = {tuple(known): loss for known, loss in zip(model.lines.tolist(), model.loss, strict=True)}
        return model.with_lines(lines, np.array([kept.get(tuple(entry), 0.0) for entry in lines.tolist()]))

    @property
    def uncertainty(self) -> float:
        """Three standard deviations of the share explained, which noise alone makes uncertain."""
        cells = self.data.power[:, self.data.first_cell:].size
        return 3.0 * float(np.sqrt(2.0 * cells / self.data.weight)) / self.data.excess


def _best_first(trials: list[Model], value: Callable[[Model], float]) -> list[tuple[Model, float]]:
    """The models that bound a polygon, with their value less the price of their edges, best first."""
    scored = [(trial, value(trial) - PRICE * len(trial.lines)) for trial in trials]
    return sorted((entry for entry in scored if np.isfinite(entry[1])), key=lambda entry: -entry[1])


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
