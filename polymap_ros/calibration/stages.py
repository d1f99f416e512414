r"""Medium, or scale and drift of the odometry, from the echoes themselves.

Four stages, each of which leads into the reach of the next:

1. the focus without phase over a coarse row of a family (within some per cent of scale);
2. a rough polygon there, by the power of the echoes;
3. the focus with phase of that polygon's walls over a fine grid (within a tenth of a per cent);
4. the maximum of the waveform's likelihood over family and walls together. Its curvature gives the deviations.

An answer that does not explain the echoes is none.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.calibration.families import Family
from polymap_ros.calibration.focus import echo_strength, feet_heard, line_focus, wave_focus
from polymap_ros.calibration.hill_climb import Peak, ascend, highest
from polymap_ros.calibration.session import Session
from polymap_ros.errors import ParameterError
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.evidence.moves.start import starts
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tuning import EXPLAINED, FULL_ORDER
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

_STARTS, _IN_PHASE_TRIED = 4, 2
"""Sharpest points without phase, from each of which, the best first, is gone on until the echoes are explained, and
sharpest points with phase about each."""

_APART = 3.0
"""Steps of the grid that two of them are apart at least."""

_SHARP = 0.005
"""Deviation of the logarithm of a speed or scale beyond which the path does not tell it."""

_FLOOR = 1e-4
"""Relative deviation below which sampling, truncation and interpolation let nothing be known."""

CERTAIN_NATS = 17.0
"""By which one answer has to be better than another, whatever the recording."""

_NO_PHASE = 'with no value that was tried do the echoes agree in phase'


@dataclass(frozen=True)
class Fit:
    """What was found.

    Parameters
    ----------
    values, deviations : dict of str to float
        By parameter; one standard deviation each.
    explained : float
        Share of the echoes' power that the polygon explains then.
    value : float
        Log likelihood [nats].
    """

    values: dict[str, float]
    deviations: dict[str, float]
    explained: float
    value: float


@dataclass(frozen=True)
class Refusal:
    """Why nothing else can be said than what was given; `as_given`: that is the sharpest."""

    reason: str
    as_given: bool = False
    remedy: str = ''


def search_at(session: Session, family: Family, p: NDArray[np.float64]) -> Search | None:
    """Return a search under the parameters at p; None where there is none."""
    assumed = assumed_at(session, family, p)
    try:
        return None if assumed is None else session.search(assumed)
    except ParameterError:  # together they are too much, or nothing is left to listen to
        return None


def assumed_at(session: Session, family: Family, p: NDArray[np.float64]) -> Parameters | None:
    """Return the parameters at p; None where there are none, or none that are allowed."""
    try:
        values = family.values(p)
        return None if values is None else session.parameters.replaced(values)
    except ParameterError:
        return None


def sharpest(session: Session, family: Family) -> list[NDArray[np.float64]]:
    """Return where the focus without phase over the family's coarse row is best, between its points, best first."""
    points = family.coarse()
    focus = np.full(len(points), -np.inf)
    strength = echo_strength(session.search(session.parameters).data)
    for index, p in enumerate(points):
        session.checkpoint()
        if search := search_at(session, family, p):
            focus[index] = line_focus(search.data, strength)
    tops = []
    for _ in range(_STARTS):
        best = int(np.argmax(focus))
        tops.append(top_of(points, focus))
        focus[max(best - 2, 0):best + 3] = -np.inf
    return tops


def top_of(points: list[NDArray[np.float64]], focus: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a function known at evenly spaced points is largest, between them."""
    best = int(np.argmax(focus))
    if not 0 < best < len(points) - 1 or not np.all(np.isfinite(focus[best - 1:best + 2])):
        return points[best]
    before, top, after = focus[best - 1:best + 2]
    share = 0.5 * (before - after) / min(before - 2.0 * top + after, -1e-300)
    return np.asarray(points[best] + share * (points[best + 1] - points[best]))


def settle(session: Session, family: Family, p: NDArray[np.float64], elsewhere: bool) -> Fit | Refusal:
    """Go from the focus without phase to the waveform's maximum."""
    search = search_at(session, family, p)
    if search is None:
        return Refusal('no medium has such speeds')
    rough = rough_lines(search)
    if rough is None:
        return Refusal('no polygon closes, not even roughly, with any value that was tried')
    points = _in_phase(session, family, p, search, rough)
    if elsewhere and np.all(np.abs(points[0] - family.given) < _APART * family.grid):
        return Refusal('what was given is the sharpest', as_given=True)
    return settled(session, family, points)


def settled(session: Session, family: Family, points: list[NDArray[np.float64]]) -> Fit | Refusal:
    """Go from points near enough to the waveform's maximum."""
    best: tuple[float, NDArray[np.float64], Found] | None = None
    for q in points:
        found = _polygon(session, family, q)
        if found is not None and found.wave is not None and (best is None or found.value > best[0]):
            best = found.value, q, found
            if found.explained > EXPLAINED:
                break
    if best is None or best[2].wave is None:
        return Refusal(_NO_PHASE)
    peak = _climbed(session, family, best[1], best[2].wave)
    found = _put_right(session, family, peak)
    if found is not None and found.wave is not None and found.wave.value > peak.value + CERTAIN_NATS:
        # The polygon of the sharpest point was not yet the right one.
        peak = _climbed(session, family, peak.at, found.wave)
        found = _put_right(session, family, peak)
    return _concluded(session, family, peak, found)


def rough_lines(search: Search) -> NDArray[np.float64] | None:
    """Return lines of a polygon by the power of the echoes."""
    for start in starts(search):
        search.checkpoint()
        if start is not None:
            return search.by_power(start).walls.lines
    return None


def _in_phase(
    session: Session, family: Family, p: NDArray[np.float64], search: Search, lines: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """The sharpest points with phase about p, the best first."""
    data = search.data
    feet = feet_heard(lines, data.positions)

    def focus(q: NDArray[np.float64]) -> float:
        session.checkpoint()
        try:
            view = family.view(p, q)
        except ParameterError:  # beyond what is allowed
            return -np.inf
        positions = session.positions(view.parameters) / view.zoom
        return wave_focus(data, lines, feet, positions, data.pulse.carrier + view.carrier)

    points = np.array(family.near(p))
    sharpness = np.empty(len(points))
    for index, q in enumerate(points):
        sharpness[index] = focus(q)
    chosen = []
    for _ in range(_IN_PHASE_TRIED):
        best = points[int(np.argmax(sharpness))]
        sharpness[np.all(np.abs(points - best) < _APART * family.grid, axis=1)] = -np.inf
        chosen.append(ascend(focus, best, family.grid / 2.0, family.fine))
    return chosen


def _polygon(session: Session, family: Family, q: NDArray[np.float64]) -> Found | None:
    """The polygon under one assumption, as the solver finds it; not searched for further where no phase agrees."""
    search = search_at(session, family, q)
    if search is None:
        return None
    best = None
    for found in search.polygons():
        best = _better(best, found)
        if best is not None and (best.wave is None or best.explained > EXPLAINED):
            break
    return best


def _better(one: Found | None, other: Found | None) -> Found | None:
    """What agrees in phase first: the log likelihoods with phase and without it do not compare."""
    there = [each for each in (one, other) if each is not None]
    return max(there, key=lambda each: (each.wave is not None, each.value), default=None)


def _put_right(
    session: Session, family: Family, peak: Peak[tuple[NDArray[np.float64], Wave]]
) -> Found | None:
    """The polygon that a climb ended with, edges dropped and added; where it does not explain the echoes, another."""
    search, wave = search_at(session, family, peak.at), peak.found[1]
    assert search is not None, 'the climb has been there'
    found = search.settle(search.nothing.with_strength(1.0).with_walls(wave.walls))
    if found is not None and found.explained > EXPLAINED:
        return found
    other = _polygon(session, family, peak.at)
    return _better(found, other)


def _climbed(
    session: Session, family: Family, q: NDArray[np.float64], wave: Wave
) -> Peak[tuple[NDArray[np.float64], Wave]]:
    """The waveform's maximum over family and walls."""
    def function(
        at: NDArray[np.float64], near: tuple[NDArray[np.float64], Wave]
    ) -> tuple[float, tuple[NDArray[np.float64], Wave]]:
        session.checkpoint()
        search = search_at(session, family, at)
        if search is None:
            return -np.inf, near
        view = family.view(near[0], at)
        walls = near[1].walls.on(near[1].walls.lines * (view.zoom, 1.0) + (view.shift_m, 0.0))
        refined = WaveformLikelihood(search.data).refine(near[1].with_walls(walls), FULL_ORDER)
        return (-np.inf, near) if refined is None else (refined.value, (at, refined))

    return highest(function, q, (q, wave), family.fine)


def _concluded(
    session: Session, family: Family, peak: Peak[tuple[NDArray[np.float64], Wave]], found: Found | None
) -> Fit | Refusal:
    values = family.values(peak.at)
    search = search_at(session, family, peak.at)
    if found is None or found.wave is None:
        return Refusal(_NO_PHASE)
    explained = max(found.explained, 0.0)
    if values is None or search is None or explained < EXPLAINED - search.uncertainty:
        return Refusal(f"with the best value {explained:.0%} of the echoes' power is explained, which is too little")
    covariance = peak.covariance
    if covariance is None or np.sqrt(np.max(np.diag(covariance) / (family.fine / family.fine[0]) ** 2)) > _SHARP:
        return Refusal('the echoes fit many values alike', remedy='drive turns, and closer to the walls')
    covariance = covariance + np.diag((_FLOOR * family.fine / family.fine[0]) ** 2)
    centre = np.array(list(values.values()))
    slopes = np.column_stack([
        (np.array(list((family.values(peak.at + step) or values).values())) - centre) / np.max(step)
        for step in np.diag(0.1 * family.fine)])
    deviations = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    return Fit(values, dict(zip(values, deviations.tolist(), strict=True)), explained, peak.value)
