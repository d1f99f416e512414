"""The search: from starts by power to a polygon that the waveform has settled, on one page.

`by_power` changes single edges while the likelihood of power grows, by echoes of two orders, then of three. `settle`
goes over to the waveform and lets the moves of `SCHEDULE` change it, the first that brings something each time.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.storey import Storey
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.checkpoint import Checkpoint, unwatched
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.edge_phase import EdgePhase, laws
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.curve import curve_wall, in_the_middle, straightened
from polymap_ros.solvers.evidence.moves.exchange import improved
from polymap_ros.solvers.evidence.moves.faint import look_for_faint
from polymap_ros.solvers.evidence.moves.first_echoes import in_step
from polymap_ros.solvers.evidence.moves.hole import with_hole
from polymap_ros.solvers.evidence.moves.inner_wall import add_inner_wall, as_edges
from polymap_ros.solvers.evidence.moves.late import delay_envelopes
from polymap_ros.solvers.evidence.moves.scan import replace_by_scan
from polymap_ros.solvers.evidence.moves.slip import slipped
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.moves.start import Start, starts
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.ring_search import improved_ring, ring_starts
from polymap_ros.solvers.evidence.schedule import INSIDE, RINGS, SCHEDULE
from polymap_ros.solvers.evidence.square_walls import free
from polymap_ros.solvers.evidence.tuning import (
    ALL_EXPLAINED,
    ANOTHER_POLYGON,
    COHERENT,
    CORNERS_FROM,
    EXPLAINED,
    FULL_ORDER,
    HOLE_WORTH,
    HOLES,
    IN_PHASE,
    IN_VAIN,
    PHASED,
    PRICE,
    RING_EXPLAINED,
    RING_WORTH,
    ROUNDS,
    SEARCH_ORDER,
    STILL_LEFT,
    WORTH_MOVING,
)
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave
from polymap_ros.solvers.solver import Evidence


class Found(NamedTuple):
    """A polygon under the likelihood of power and, where the echoes agree in phase, under that of the waveform.

    `explained` is the share of the echoes' power that it explains, `value` its log likelihood less the edges' price.
    """

    power: Power
    wave: Wave | None
    explained: float
    value: float

    @property
    def walls(self) -> Walls:
        """The walls, their coefficients signed where there is phase."""
        return self.power.walls if self.wave is None else self.wave.walls

    @property
    def storey(self) -> Storey:
        """Floor and ceiling."""
        return self.power.storey if self.wave is None else self.wave.storey

    @property
    def lines(self) -> NDArray[np.float64]:
        """r [m] and theta [rad] of the outline's edges, in their order."""
        return self.walls.outline

    def moved(self, frame: Pose) -> 'Found':
        """Return the same walls, seen from the frame in which `frame` is their own origin, not judged anew."""
        wave = self.wave and self.wave.with_walls(self.wave.walls.seen_from(frame))
        return self._replace(power=self.power.with_walls(self.power.walls.seen_from(frame)), wave=wave)


class Search(Ground):
    """A search: it ends with the waveform, if `coherent`, and with power alone otherwise.

    `other_cause` is asked once, with walls by power, before they are changed in vain, whether something else than
    walls explains the echoes.
    """

    other_cause: Callable[[Power], bool] | None = None

    def over(self, data: EchoData, edges: Sequence[EdgePhase] = ()) -> 'Search':
        """Return the same search over other data, and by other laws where these are given."""
        other = Search(data, self.max_edges, self.generator, self.coherent, self.dispersed, self.checkpoint,
                       edges or self.edges)
        other.approximate = self.approximate
        return other.between(self.nothing.storey, self.nothing.strength) if len(self.nothing.storey) else other

    def polygons(self, storey: Storey | None = None, strength: float = 0.0) -> Iterator[Found | None]:
        """Give what each start leads to, None where it leads to no polygon.

        First between floor and ceiling, where they were heard, at a strength of the echoes; where that does not explain
        them, without: between parallel walls an echo comes from one range everywhere, too.
        """
        searches = [self.between(storey, strength), self] if storey else [self]
        for begun in zip(*(starts(search) for search in searches), strict=True):
            best: Found | None = None
            for search, start in zip(searches, begun, strict=True):
                self.checkpoint()
                found = None if start is None else search.settle(search.by_power(start), start.pool)
                if found is not None and (best is None or found.value > best.value):
                    best = found
                if best is not None and best.explained > EXPLAINED:
                    break
            yield best

    def not_convex(self, convex: Found | None) -> Iterator[Found]:
        """Give outlines that need not be convex, and the convex one with holes, as long as they are worth clearly more
        than it is; holes first where they are worth far more.
        """
        fitted = convex and self.power.fitted(convex.walls, convex.power, SEARCH_ORDER)
        nothing = self.nothing.value
        hole = self.first_hole(convex) if convex else None
        starts, pool = ring_starts(self)
        worth = starts[0].value - nothing if starts else -np.inf
        if hole is not None and hole.value - nothing > HOLE_WORTH * worth:
            yield from self.settling(self.with_holes(hole))
            hole = None
        if worth > RING_WORTH * ((fitted.value if fitted else nothing) - nothing) and not self._hopeless(starts[0]):
            yield from self._rings(starts, pool)
        if hole is not None:
            yield from self.settling(self.with_holes(hole))

    def settling(self, power: Power) -> Iterator[Found]:
        """Give walls in phase before moves, which are in vain if corners return the rest, and as they are settled."""
        refined = self.power.refine(power.walls, power, FULL_ORDER, 6)
        aligned = None if refined is None else self.judge(refined)
        if aligned is not None and CORNERS_FROM < aligned.explained < EXPLAINED:
            yield aligned
        if (settled := self.settle(power)) is not None:
            yield settled

    def _rings(self, starts: Sequence[Power], pool: NDArray[np.float64]) -> Iterator[Found]:
        """Give what rings lead to with lines of a pool: as soon as one explains much, and in the end."""
        rings: list[Power] = []
        for start in starts:
            self.checkpoint()
            rings.append(improved_ring(self, start, pool))
            judged = self.judged(rings[-1], None)
            if start is not starts[-1] and (judged is None or judged.explained < RING_EXPLAINED):
                continue
            best = max(rings, key=lambda each: each.value - PRICE * len(each.walls))
            found = None
            for found in self.settling(best):
                yield found
            # What the waveform has moved and dropped, power may change further.
            if found and (again := self.settle(improved_ring(self, found.power, pool))) is not None:
                yield again

    def first_hole(self, found: Found) -> Power | None:
        """Return an outline with the hole that is worth most by power, where it is worth clearly more than without."""
        self.checkpoint()
        fitted = self.power.fitted(found.walls, found.power, SEARCH_ORDER)
        more = with_hole(self, found.power) if fitted else None
        if fitted is None or more is None:
            return None
        nothing = self.nothing.value
        return more if more.value - nothing > HOLE_WORTH * (fitted.value - nothing) else None

    def with_holes(self, power: Power) -> Power:
        """Return an outline with a hole and with further ones, as long as they are worth clearly more."""
        nothing = self.nothing.value
        for count in range(1, HOLES + 1):
            # Without a hole, its echoes may have bent the outline.
            changed = improved(self, power, 2, np.empty((0, 2)), residual=True)
            refined = self.power.refine(changed.walls, changed, SEARCH_ORDER, 4)
            if refined is not None and refined.value > power.value + ANOTHER_POLYGON:
                power = refined
            self.checkpoint()
            more = with_hole(self, power) if count < HOLES else None
            if more is None or more.value - nothing < RING_WORTH * (power.value - nothing):
                break
            power = more
        return power

    def by_power(self, start: Start) -> Power:
        """Improve a start by single changes, by echoes of two orders, then of three."""
        power = improved(self, start.power, 2, start.pool, residual=False)
        return improved(self, power, SEARCH_ORDER, start.pool, residual=True)

    def again(self, last: Found) -> Found | None:
        """Return the last answer, refined on the pings of today."""
        self.checkpoint()
        like = self.between(last.storey, last.power.strength).nothing
        if last.wave is None or not self.coherent:
            power = self.power.refine(last.walls, like, FULL_ORDER, 3)
            return None if power is None else self.judged(power, None)
        wave = self.wave.refine(last.wave, FULL_ORDER, 3)
        return None if wave is None else self.judged(like, wave, enough=ALL_EXPLAINED)

    def settle(self, start: Power, pool: NDArray[np.float64] | None = None) -> Found | None:
        """Refine by the waveform, then make its moves as long as its likelihood asks for them.

        Where the waveform is worth far less than power alone is, even after walls that lie half a cycle off were
        put right, the echoes do not agree in phase (positions that are off by a quarter of a wavelength do that): then
        power has the last word, with the lines of a `pool` to try.
        """
        power = self.power.refine(start.walls, start, FULL_ORDER, 6)
        if power is None:
            return None
        in_vain = not self.coherent or (not power.walls.convex_outline and self._hopeless(power))
        wave, share = (None, 0.0) if in_vain else self._without_slips(power)
        if share < IN_VAIN - self.uncertainty:
            standing = wave and Standing(power, wave, share)
            better = standing and (curve_wall(self, standing) or delay_envelopes(self, standing))
            if better is None and self.has_other_cause(power):
                return None
            wave = better or wave
        found = None
        if wave is not None and wave.value >= COHERENT * power.value:
            found = self.changed(power, wave)
        if not power.walls.convex_outline:
            return found or self.judged(power.with_walls(free(power.walls)), None)
        if found is None or found.value < IN_PHASE * power.value:
            pool = np.empty((0, 2)) if pool is None else pool
            return self.judged(improved(self, power, FULL_ORDER, pool, residual=True), None)
        return found

    def _without_slips(self, power: Power) -> tuple[Wave | None, float]:
        """Return walls in phase, put right where they lie half a cycle off, and what they explain; nothing where they
        do not agree in phase.
        """
        wave, share = in_step(self, self.by_first_law(power))
        if share < EXPLAINED - self.uncertainty:
            # Only now: it would make good for walls in wrong cycles.
            other = self.by_another_law(power, wave)
            wave, share = (wave, share) if other is wave else in_step(self, other)
        for _ in power.walls.lines:
            better = slipped(self, wave, np.arange(len(wave.walls))) if wave and share < IN_VAIN else None
            if better is None:
                break
            wave, share = better, self.explained(better, IN_VAIN)
        coherent = wave is not None and wave.value >= COHERENT * power.value
        return (wave, share) if coherent else (None, 0.0)

    def has_other_cause(self, power: Power) -> bool:
        """Ask for another cause, if that has not been asked for."""
        asked, self.other_cause = self.other_cause, None
        return asked is not None and asked(power)

    def _hopeless(self, power: Power) -> bool:
        """Whether walls that are not a convex outline explain too little, by power, to be worth more work."""
        judged = self.judged(power, None)
        return judged is None or judged.explained < WORTH_MOVING - self.uncertainty

    def changed(self, power: Power, wave: Wave) -> Found | None:
        """Make the moves of the schedule while one of them brings something."""
        for _ in range(ROUNDS):
            self.checkpoint()
            standing = Standing(power, wave, self.explained(wave))
            if standing.explained < WORTH_MOVING and not wave.walls.convex_outline:
                break
            convex = SCHEDULE if wave.walls.convex_outline else RINGS
            schedule = INSIDE if len(wave.walls) > wave.walls.ring else convex
            changed = (move(self, standing) for move, below in schedule if standing.explained < below)
            better = next((each for each in changed if each is not None), None)
            if better is None:
                break
            wave = better
        if free(wave.walls) is wave.walls:
            return self.judged(power, straightened(self, wave))
        loose = self.wave.refine(wave.with_walls(free(wave.walls)), FULL_ORDER)
        return None if loose is None else self.changed(power, loose)

    def with_inner_walls(self, found: Found) -> Found | None:
        """Return an outline with the walls that stand inside and let waves through; None where none is found."""
        if found.wave is None:
            return None
        self.checkpoint()
        wave = add_inner_wall(self, Standing(found.power, found.wave, found.explained))
        if wave is None or 1.0 - self.explained(wave) > STILL_LEFT * (1.0 - found.explained):
            return None
        settled = self.changed(found.power, wave)
        return settled and (self._with_edges(settled) or settled)

    def _with_edges(self, found: Found) -> Found | None:
        """Return inner walls as faint edges of the outline, where that is worth as much: they have no ends then."""
        edged = as_edges(found.walls, self.data.positions)
        if edged is None or found.wave is None:
            return None
        wave = self.wave.refine(found.wave.with_walls(edged).with_slopes(None), FULL_ORDER)
        settled = wave and self.changed(found.power.with_walls(edged), wave)
        return settled if settled and settled.value > found.value - PRICE else None

    def mended(self, found: Found) -> Found | None:
        """Exchange an edge, or add one, by trying all lines; None where none is worth more."""
        if found.wave is None or not found.walls.convex_outline:
            return None
        standing = Standing(found.power, found.wave, found.explained)
        wave = look_for_faint(self, standing, PHASED) or replace_by_scan(self, standing)
        return None if wave is None else self.changed(found.power, wave)

    def judge(self, power: Power) -> Found | None:
        """Return walls as they stand, judged by their waveform."""
        return self.judged(power, self.aligned(power) if self.coherent else None)

    def judged(self, power: Power, wave: Wave | None, enough: float = np.inf) -> Found | None:
        """Return what a polygon explains of the echoes' power, and what it is worth."""
        if wave is not None:
            wave = in_the_middle(self, wave)
            value = wave.value - PRICE * len(wave.walls)
            return Found(power.with_walls(wave.walls, wave.storey), wave, self.explained(wave, enough), value)
        fitted = self.power.fitted(power.walls, power, FULL_ORDER)
        if fitted is None:
            return None
        heard = slice(self.data.first_cell, None)
        excess, predicted = self.data.power[:, heard] - 1.0, fitted.strength * fitted.explained[:, heard]
        # Of the excess, what follows the prediction from cell to cell (a regression's share).
        explained = float(np.sum(predicted * excess)) / max(float(np.sum(predicted**2)), 1e-300)
        explained *= float(np.sum(predicted)) / max(float(excess.sum()), 1e-300)
        return Found(fitted, None, min(explained, 1.0), fitted.value - PRICE * len(fitted.walls))


def search_of(
    evidence: Evidence, parameters: Parameters, checkpoint: Checkpoint = unwatched, louder: float | None = None
) -> Search:
    """A search over the pings whose echoes are kept; `louder` as in `EchoData.of`."""
    assert evidence.pulse is not None, 'the mapper knows its pulse'
    sensor = parameters.sensor
    data = EchoData.of(evidence.heard, evidence.pulse, parameters.medium.spreading, parameters.echo.blanking_m,
                       (sensor.baseline_x_m, sensor.baseline_y_m, sensor.baseline_z_m), louder)
    generator = np.random.default_rng(parameters.solver.seed)
    coherent = parameters.echo.kind == 'rf'
    dispersed = not coherent and parameters.medium.model == 'lamb_a0'
    return Search(data, parameters.solver.max_edges, generator, coherent, dispersed, checkpoint,
                  laws(parameters.medium))
