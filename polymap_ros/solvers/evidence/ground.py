"""What every move stands on: the echoes, their likelihoods by all and by few pings, and what a waveform is worth."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.storey import Storey
from polymap_ros.solvers.checkpoint import Checkpoint, unwatched
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.edge_phase import REAL, EdgePhase
from polymap_ros.solvers.evidence.power import Power, PowerLikelihood
from polymap_ros.solvers.evidence.round_echoes import RoundHoles
from polymap_ros.solvers.evidence.tuning import (
    ALL_EXPLAINED,
    EDGE_WORTH,
    ENOUGH,
    EXPLAINED,
    FAR_AROUND_CORNERS,
    FAR_ORDER,
    FEW,
    FULL_ORDER,
    MISFIT,
    PRICE,
    ROUGHER,
    SEARCH_ORDER,
)
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood


class Ground:
    """The pings of `data` and their likelihoods.

    Parameters
    ----------
    data : EchoData
        The echoes.
    max_edges : int
        Most edges of a polygon.
    generator : numpy.random.Generator
        Source of all random numbers.
    coherent : bool
        Whether echoes have a phase that can agree.
    dispersed : bool
        Whether echoes are drawn out, the more the farther they come: their pulse is not the one looked for.
    checkpoint : callable
        Called between the steps of long work.
    edges : sequence of EdgePhase
        Laws by which walls may turn the phase, tried in this order.

    Attributes
    ----------
    power, wave
        The likelihoods of all pings.
    few, few_wave
        Those of one ping of `share`.
    nothing : Power
        No walls, but floor and ceiling where they are known.
    approximate : bool
        Whether a part of the echoes was taken out that follows from the walls but for a little: then an edge that is
        not there may put that right, and each has to bring enough to be sure.
    whole : EchoData or None
        The echoes with that part, where it has to be known for deviations.
    round_holes : RoundHoles or None
        The round holes of which all was taken out that they change.
    """

    def __init__(
        self, data: EchoData, max_edges: int, generator: np.random.Generator, coherent: bool = True,
        dispersed: bool = False, checkpoint: Checkpoint = unwatched, edges: Sequence[EdgePhase] = (REAL,),
    ) -> None:
        self.edges = edges
        self.data, self.max_edges, self.generator = data, max_edges, generator
        self.coherent, self.dispersed, self.checkpoint = coherent, dispersed, checkpoint
        self.share = max(min(len(data.positions) // ENOUGH, FEW), 1)
        few = data.every(self.share)
        self.power, self.few = PowerLikelihood(data), PowerLikelihood(few)
        self.wave, self.few_wave = WaveformLikelihood(data), WaveformLikelihood(few)
        self.nothing = self.power.initial(0.0)
        self.approximate = False
        self.whole: EchoData | None = None
        self.round_holes: RoundHoles | None = None

    def between(self, storey: Storey, strength: float) -> Self:
        """Return the same between floor and ceiling, at a strength of the echoes that was found with them."""
        inside = copy.copy(self)
        inside.nothing = self.power.initial(strength, storey)
        return inside

    def explained(self, wave: Wave, enough: float = np.inf) -> float:
        """Return the share of the echoes' power that a waveform takes away, by few pings where that is `enough`.

        Where that is not all, the echoes of higher orders may be more, or weaker, than walls of one coefficient each
        make them: then each order counts with the strength that fits it, far orders, too.
        """
        if enough < np.inf:
            few = self.few_wave.residual_power(wave.of_pings(slice(None, None, self.share)), FULL_ORDER)
            share = _taken_away(self.few_wave.data, few)
            if share > enough:
                return share
        share = self.as_modelled(wave)
        if share > ALL_EXPLAINED:
            return share
        far = FAR_ORDER if wave.walls.convex_outline else FAR_AROUND_CORNERS
        return max(share, _taken_away(self.data, self.wave.by_order(wave, far)[1]))

    def as_modelled(self, wave: Wave) -> float:
        """Return the same with each order as strong as the waveform has it, and none that it leaves out."""
        return _taken_away(self.data, self.wave.residual_power(wave, FULL_ORDER))

    def aligned(self, power: Power, edge: EdgePhase | None = None) -> Wave | None:
        """Return the waveform's maximum near refined walls of power, from the first order up.

        By the law of `edge`; where none is given by the first of `edges` or, where that leaves much unexplained, by
        another.
        """
        if edge is not None:
            return self._aligned(power, edge)
        best = self.by_first_law(power)
        explains = best is not None and self.explained(best, EXPLAINED) > EXPLAINED - self.uncertainty
        return best if explains else self.by_another_law(power, best)

    def by_first_law(self, power: Power) -> Wave | None:
        """Return the same by the first of `edges`."""
        first = self.edges[0]
        return self._aligned(power, first.freed() if len(first.law) else first)

    def by_another_law(self, power: Power, best: Wave | None) -> Wave | None:
        """Return what one of the other `edges` leads to that is worth far more than the best so far, or leaves nothing;
        that where none is.
        """
        least = -np.inf if best is None else EDGE_WORTH * best.value
        for law in self.edges[1:]:
            self.checkpoint()
            turned = self._aligned(power, law.freed())
            if turned is not None and (turned.value > least or self._is_all(turned, best)):
                best, least = turned, turned.value
        return best

    def _is_all(self, wave: Wave, other: Wave | None) -> bool:
        """Whether a waveform is worth more than another and leaves nothing to explain, by few pings if they say so."""
        better = other is None or wave.value > other.value
        return better and self.explained(wave, ALL_EXPLAINED) > ALL_EXPLAINED

    def _aligned(self, power: Power, edge: EdgePhase) -> Wave | None:
        wave = self.wave.refine(self.wave.begun(power.walls, edge.held(), power.storey), 1)
        if wave is None:
            return None
        # Echoes of even order tell the signs.
        both = [self.wave.evaluate(each.walls, each, SEARCH_ORDER) for each in (wave, wave.turned())]
        best = max((each for each in both if each is not None), key=lambda each: each.value, default=None)
        best = best and self.wave.refine(best, SEARCH_ORDER)
        best = best and replace(best, edge=edge, slopes=None)
        return best and self.wave.refine(best, FULL_ORDER)

    def least_gain(self, value: float) -> float:
        """Return the nats that an edge has to bring to be sure, where all are worth so many."""
        return max(PRICE, (ROUGHER if self.approximate else MISFIT) * value)

    def worth(self, wave: Wave) -> float:
        """Return the log likelihood less the edges' price; of two that are one wall, the second has to bring enough to
        be sure.
        """
        lines, price = wave.walls.lines, self.least_gain(wave.value)
        twins = sum(self.one_of(line, lines[:wall]) for wall, line in enumerate(lines))
        return wave.value - (price if self.approximate else PRICE) * (len(lines) - twins) - price * twins

    def one_of(self, line: NDArray[np.float64], known: NDArray[np.float64] | list[NDArray[np.float64]]) -> bool:
        """Return whether no ping's distance from a line is a pulse's width other than from one that is known."""
        r, theta = np.array([line, *known]).T
        away = r - self.data.positions @ np.array((np.cos(theta), np.sin(theta)))
        return bool(np.any(np.max(np.abs(away[:, 1:] - away[:, :1]), axis=0) < self.data.pulse.width_m))

    @property
    def uncertainty(self) -> float:
        """Three standard deviations of the share explained, which noise alone makes uncertain."""
        cells = self.data.power[:, self.data.first_cell:].size
        return 3.0 * float(np.sqrt(2.0 * cells / self.data.weight)) / self.data.excess

    @property
    def edges_are_real(self) -> bool:
        """Whether the only law is that no reflection turns the phase."""
        return len(self.edges) == 1 and not len(self.edges[0].law)

    @property
    def width_m(self) -> float:
        """Width of the pulse [m]."""
        return self.data.pulse.width_m

    @property
    def cycle_m(self) -> float:
        """A cycle of range [m]."""
        return float(np.pi / self.data.pulse.carrier)

    def few_value(self, walls: Walls, like: Power, order: int) -> float:
        """Return the likelihood of power by few pings, scaled to all."""
        return self.share * self.few.value(walls, like, order)


def _taken_away(data: EchoData, left: NDArray[np.float64]) -> float:
    return 1.0 - float(np.sum(left[:, data.first_cell:] - 1.0)) / data.excess
