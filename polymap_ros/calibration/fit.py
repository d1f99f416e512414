r"""Medium, or scale and drift of the odometry, from the echoes themselves.

Four stages, each of which leads into the reach of the next:

1. the focus without phase over a coarse row of a family (within some per cent of scale);
2. a rough polygon there, by the power of the echoes;
3. the focus with phase of that polygon's walls over a fine grid (within a tenth of a per cent);
4. the maximum of the waveform's likelihood over family and walls together. Its curvature gives the deviations.

An answer that does not explain the echoes is none.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.calibration.families import Family, Odometry, Plate, Speed, Thickness, TimeZero
from polymap_ros.calibration.focus import echo_strength, feet_of, line_focus, wave_focus
from polymap_ros.calibration.hill_climb import Peak, ascend, climb
from polymap_ros.calibration.session import Session
from polymap_ros.cautions import CAUTIONS, in_metres
from polymap_ros.errors import ParameterError
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.evidence.moves.start import starts
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tuning import EXPLAINED, FULL_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.straightness import path_half_width

LEAST_PINGS = 8
"""Fewer pings tell too little of a path."""

_STARTS, _IN_PHASE_TRIED = 4, 2
"""Sharpest points without phase, from each of which, the best first, is gone on until the echoes are explained, and
sharpest points with phase about each."""

_APART = 3.0
"""Steps of the grid that two of them are apart at least."""

_SHARP = 0.005
"""Deviation of the logarithm of a speed or scale beyond which the path does not tell it."""

_FLOOR = 1e-4
"""Relative deviation below which sampling, truncation and interpolation let nothing be known."""

_ALL_EXPLAINED = 0.95
"""Share of the echoes' power from which thickness alone is enough."""

_WORTH = 0.002
"""Share of the log likelihood that a second parameter has to bring, beside `_NATS`."""
_NATS = 17.0

_BEGUN_AT = 0.0, -1.5, 1.5
"""Pulse widths from the time zero given at which a search for another begins, until one explains the echoes."""

_PULSES_OFF = 3.0, 1.5, 0.8, 0.3
"""Widths of the pulse that a time zero may be off, round by round."""

_NEARBY = 0.0, 0.1, -0.1, 0.2, -0.2
"""Widths of the pulse from where power has led to, within a tenth of which the waveform agrees."""

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


def calibrated_medium(session: Session, elsewhere: bool = False) -> Fit | Refusal:
    """The medium that makes the echoes agree: the constant speed, or the thickness, with the shear speed if need be.

    With `elsewhere` the answer is a refusal as soon as the medium that was given turns out the sharpest.
    """
    parameters = session.parameters
    if hopeless := _hopeless(session):
        return hopeless
    if parameters.medium.model == 'constant':
        return _fit(session, Speed(parameters), elsewhere)
    thickness = Thickness(parameters)
    sharpest = _sharpest(session, thickness)
    first = _settle(session, thickness, sharpest[0], elsewhere)
    if first.as_given if isinstance(first, Refusal) else first.explained > _ALL_EXPLAINED:
        return first
    start = _assumed(session, thickness, sharpest[0])
    plate = Plate(parameters.replaced(first.values) if isinstance(first, Fit) else start or parameters)
    both = _settle(session, plate, plate.given, False)
    if isinstance(first, Refusal):
        return both
    return both if isinstance(both, Fit) and both.value > first.value + needed(first.value) else first


def needed(value: float) -> float:
    """Nats that an explanation with more numbers has to bring over one of this log likelihood."""
    return max(_NATS, _WORTH * value)


def calibrated_odometry(session: Session, elsewhere: bool = False) -> Fit | Refusal:
    """Scale and yaw drift of the odometry that make the echoes agree; `elsewhere` as above."""
    if hopeless := _hopeless(session):
        return hopeless
    return _fit(session, Odometry(session.parameters), elsewhere)


def calibrated_time_zero(session: Session) -> Fit | Refusal:
    """The time zero that makes the echoes of all orders agree, first by their power, then by their waveform."""
    if hopeless := _hopeless(session):
        return hopeless
    family = TimeZero(session.parameters)
    width_m = session.search(session.parameters).data.pulse.width_m
    return _first_fit(_time_zero_near(session, family, family.given + pulses * width_m, width_m)
                      for pulses in _BEGUN_AT)


def _time_zero_near(session: Session, family: TimeZero, at: NDArray[np.float64], width_m: float) -> Fit | Refusal:
    for reach in _PULSES_OFF:  # a rough polygon that is made with a wrong time zero shows the way to a better one
        search = _search(session, family, at)
        rough = None if search is None else _rough(search)
        if rough is None:
            return Refusal('no polygon closes, not even roughly')
        points = family.row(at, reach * width_m)
        score = np.full(len(points), -np.inf)
        for index, p in enumerate(points):
            session.checkpoint()
            lines = rough + (family.view(at, p).shift_m, 0.0)
            if np.all(lines[:, 0] > 0.0) and (search := _search(session, family, p)):
                refined = search.power.refine(Walls.convex(lines), search.nothing.with_strength(1.0), FULL_ORDER)
                score[index] = -np.inf if refined is None else refined.value
        at = _top(points, score)
    return _settled(session, family, [at + width_m * share for share in _NEARBY])


def _hopeless(session: Session) -> Refusal | None:
    """Why there is no use in trying; None if there may be."""
    if session.parameters.echo.kind != 'rf':
        return Refusal('the echoes are magnitudes (echo.kind: envelope), and without phase scales cannot be told',
                       remedy='record the signal itself (echo.kind: rf)')
    evidence = session.evidence(session.parameters)
    if (heard := len(evidence.soundings)) < LEAST_PINGS:
        return Refusal(f'{heard} pings could be used, and at least {LEAST_PINGS} are needed')
    if not any(np.isfinite(sounding.rho) for sounding in evidence.soundings):
        return Refusal(f'none of {heard} pings has an echo that stands out of its noise',
                       remedy=CAUTIONS['no_free_area'].remedy)
    width = path_half_width(Snapshot.of(evidence))
    if width is not None:
        return Refusal(f'the path keeps within {in_metres(width)} of one straight line, on which a wrong scale looks '
                       'like walls in other directions', remedy='drive a turn')
    return None


def _fit(session: Session, family: Family, elsewhere: bool) -> Fit | Refusal:
    """The first fit from the sharpest points without phase, the best first, and from what was given."""
    points = [*_sharpest(session, family), family.given]
    return _first_fit(_settle(session, family, p, elsewhere) for p in points)


def _first_fit(results: Iterable[Fit | Refusal]) -> Fit | Refusal:
    """The first that finds something, or that what was given is the sharpest; else why the first did not."""
    first: Refusal | None = None
    for result in results:
        if isinstance(result, Fit) or result.as_given:
            return result
        first = first or result
    assert first is not None, 'what was given is tried'
    return first


def _search(session: Session, family: Family, p: NDArray[np.float64]) -> Search | None:
    assumed = _assumed(session, family, p)
    try:
        return None if assumed is None else session.search(assumed)
    except ParameterError:  # together they are too much, or nothing is left to listen to
        return None


def _assumed(session: Session, family: Family, p: NDArray[np.float64]) -> Parameters | None:
    """The parameters at p; None where there are none, or none that are allowed."""
    try:
        values = family.values(p)
        return None if values is None else session.parameters.replaced(values)
    except ParameterError:
        return None


def _sharpest(session: Session, family: Family) -> list[NDArray[np.float64]]:
    """The points of the family's coarse row with the best focus without phase, between its points, the best first."""
    points = family.coarse()
    focus = np.full(len(points), -np.inf)
    strength = echo_strength(session.search(session.parameters).data)
    for index, p in enumerate(points):
        session.checkpoint()
        if search := _search(session, family, p):
            focus[index] = line_focus(search.data, strength)
    tops = []
    for _ in range(_STARTS):
        best = int(np.argmax(focus))
        tops.append(_top(points, focus))
        focus[max(best - 2, 0):best + 3] = -np.inf
    return tops


def _top(points: list[NDArray[np.float64]], focus: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where a function known at evenly spaced points is largest, between them."""
    best = int(np.argmax(focus))
    if not 0 < best < len(points) - 1 or not np.all(np.isfinite(focus[best - 1:best + 2])):
        return points[best]
    before, top, after = focus[best - 1:best + 2]
    share = 0.5 * (before - after) / min(before - 2.0 * top + after, -1e-300)
    return np.asarray(points[best] + share * (points[best + 1] - points[best]))


def _settle(session: Session, family: Family, p: NDArray[np.float64], elsewhere: bool) -> Fit | Refusal:
    """From the focus without phase to the waveform's maximum."""
    search = _search(session, family, p)
    if search is None:
        return Refusal('no medium has such speeds')
    rough = _rough(search)
    if rough is None:
        return Refusal('no polygon closes, not even roughly, with any value that was tried')
    points = _in_phase(session, family, p, search, rough)
    if elsewhere and np.all(np.abs(points[0] - family.given) < _APART * family.grid):
        return Refusal('what was given is the sharpest', as_given=True)
    return _settled(session, family, points)


def _settled(session: Session, family: Family, points: list[NDArray[np.float64]]) -> Fit | Refusal:
    """From points near enough to the waveform's maximum."""
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
    if found is not None and found.wave is not None and found.wave.value > peak.value + _NATS:
        # The polygon of the sharpest point was not yet the right one.
        peak = _climbed(session, family, peak.at, found.wave)
        found = _put_right(session, family, peak)
    return _concluded(session, family, peak, found)


def _rough(search: Search) -> NDArray[np.float64] | None:
    """Lines of a polygon by the power of the echoes."""
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
    feet = feet_of(lines, data.positions)

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
    search = _search(session, family, q)
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
    search, wave = _search(session, family, peak.at), peak.found[1]
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
        search = _search(session, family, at)
        if search is None:
            return -np.inf, near
        view = family.view(near[0], at)
        walls = near[1].walls.on(near[1].walls.lines * (view.zoom, 1.0) + (view.shift_m, 0.0))
        refined = WaveformLikelihood(search.data).refine(near[1].with_walls(walls), FULL_ORDER)
        return (-np.inf, near) if refined is None else (refined.value, (at, refined))

    return climb(function, q, (q, wave), family.fine)


def _concluded(
    session: Session, family: Family, peak: Peak[tuple[NDArray[np.float64], Wave]], found: Found | None
) -> Fit | Refusal:
    values = family.values(peak.at)
    search = _search(session, family, peak.at)
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
