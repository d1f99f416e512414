r"""Medium, or scale and drift of the odometry, from the echoes themselves.

Four stages, each of which leads into the reach of the next:

1. the focus without phase over a coarse row of a family (within some per cent of scale);
2. a rough polygon there, by the power of the echoes;
3. the focus with phase of that polygon's walls over a fine grid (within a tenth of a per cent);
4. the maximum of the waveform's likelihood over family and walls together. Its curvature gives the deviations.

An answer that does not explain the echoes is none.
"""

from collections.abc import Generator, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import ParameterError
from polymap_ros.mapping.evidence.search import FULL_ORDER, Found, Search
from polymap_ros.mapping.evidence.solver import EXPLAINED
from polymap_ros.mapping.evidence.waveform import Wave, WaveformLikelihood
from polymap_ros.mapping.families import Family, Odometry, Plate, Speed, Thickness, TimeZero
from polymap_ros.mapping.focus import echo_strength, feet_of, line_focus, wave_focus
from polymap_ros.mapping.peak import Peak, ascend, climb
from polymap_ros.mapping.session import Session
from polymap_ros.mapping.snapshot import Snapshot
from polymap_ros.mapping.straightness import path_half_width
from polymap_ros.parameters import Parameters

MIN_PINGS = 8
"""Fewer pings tell too little of a path."""

_STARTS, _TRIED = 4, 2
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

_OUT_OF_PHASE = 'the echoes agree in phase with none of them'

Work = Generator[None, None, 'Fit | Refusal']


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


def calibrated_medium(session: Session, elsewhere: bool = False) -> Work:
    """The medium that makes the echoes agree: the constant speed, or the thickness, with the shear speed if need be.

    With `elsewhere` the answer is a refusal as soon as the medium that was given turns out the sharpest.
    """
    parameters = session.parameters
    if reason := _hopeless(session):
        return Refusal(reason)
    if parameters.medium.model == 'constant':
        return (yield from _fit(session, Speed(parameters), elsewhere))
    thickness = Thickness(parameters)
    sharpest = yield from _sharpest(session, thickness)
    first = yield from _settle(session, thickness, sharpest[0], elsewhere)
    if first.as_given if isinstance(first, Refusal) else first.explained > _ALL_EXPLAINED:
        return first
    start = _assumed(session, thickness, sharpest[0])
    plate = Plate(parameters.replaced(first.values) if isinstance(first, Fit) else start or parameters)
    both = yield from _settle(session, plate, plate.given, False)
    if isinstance(first, Refusal):
        return both
    return both if isinstance(both, Fit) and both.value > first.value + needed(first.value) else first


def needed(value: float) -> float:
    """Nats that an explanation with more numbers has to bring over one of this log likelihood."""
    return max(_NATS, _WORTH * value)


def calibrated_odometry(session: Session, elsewhere: bool = False) -> Work:
    """Scale and yaw drift of the odometry that make the echoes agree; `elsewhere` as above."""
    if reason := _hopeless(session):
        return Refusal(reason)
    return (yield from _fit(session, Odometry(session.parameters), elsewhere))


def calibrated_time_zero(session: Session) -> Work:
    """The time zero that makes the echoes of all orders agree, first by their power, then by their waveform."""
    if reason := _hopeless(session):
        return Refusal(reason)
    family = TimeZero(session.parameters)
    width_m = session.search(session.parameters).data.pulse.width_m
    return (yield from _first_fit(_time_zero_near(session, family, family.given + pulses * width_m, width_m)
                                  for pulses in _BEGUN_AT))


def _time_zero_near(session: Session, family: TimeZero, at: NDArray[np.float64], width_m: float) -> Work:
    for reach in _PULSES_OFF:  # a rough polygon that is made with a wrong time zero shows the way to a better one
        search = _search(session, family, at)
        rough = None if search is None else (yield from _rough(search))
        if rough is None:
            return Refusal('no polygon closes, not even roughly')
        points = family.row(at, reach * width_m)
        score = np.full(len(points), -np.inf)
        for index, p in enumerate(points):
            yield
            lines = rough + (family.view(at, p).shift_m, 0.0)
            if np.all(lines[:, 0] > 0.0) and (search := _search(session, family, p)):
                score[index] = search.power.refine(search.power.initial(1.0).with_lines(lines), FULL_ORDER)[1]
        at = _top(points, score)
    return (yield from _settled(session, family, [at + width_m * share for share in _NEARBY]))


def _hopeless(session: Session) -> str:
    """Why there is no use in trying; empty if there may be."""
    if session.parameters.echo.kind != 'rf':
        return 'the echoes are envelopes, and without phase scales cannot be told well enough'
    evidence = session.evidence(session.parameters)
    if (heard := len(evidence.soundings)) < MIN_PINGS:
        return f'{heard} pings can be used; at least {MIN_PINGS} are needed'
    width = path_half_width(Snapshot.of(evidence))
    if width is not None:
        return (f'the sensor stayed within {width:.3g} m of one straight line, on which a wrong scale looks like walls '
                'in other directions; drive a turn')
    return ''


def _fit(session: Session, family: Family, elsewhere: bool) -> Work:
    """The first fit from the sharpest points without phase, the best first, and from what was given."""
    points = [*(yield from _sharpest(session, family)), family.given]
    return (yield from _first_fit(_settle(session, family, p, elsewhere) for p in points))


def _first_fit(works: Iterable[Work]) -> Work:
    """The first that finds something, or that what was given is the sharpest; else why the first did not."""
    first: Refusal | None = None
    for work in works:
        result = yield from work
        if isinstance(result, Fit) or result.as_given:
            return result
        first = first or result
    assert first is not None, 'what was given is tried'
    return first


def _search(session: Session, family: Family, p: NDArray[np.float64]) -> Search | None:
    assumed = _assumed(session, family, p)
    try:
        return None if assumed is None else session.search(assumed)
    except ParameterError:  # together they are too much
        return None


def _assumed(session: Session, family: Family, p: NDArray[np.float64]) -> Parameters | None:
    """The parameters at p; None where there are none, or none that are allowed."""
    try:
        values = family.values(p)
        return None if values is None else session.parameters.replaced(values)
    except ParameterError:
        return None


def _sharpest(session: Session, family: Family) -> Generator[None, None, list[NDArray[np.float64]]]:
    """The points of the family's coarse row with the best focus without phase, between its points, the best first."""
    points = family.coarse()
    focus = np.full(len(points), -np.inf)
    strength = echo_strength(session.search(session.parameters).data)
    for index, p in enumerate(points):
        yield
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


def _settle(session: Session, family: Family, p: NDArray[np.float64], elsewhere: bool) -> Work:
    """From the focus without phase to the waveform's maximum."""
    search = _search(session, family, p)
    if search is None:
        return Refusal('no medium has such speeds')
    rough = yield from _rough(search)
    if rough is None:
        return Refusal('no polygon closes, not even roughly, with any of them')
    points = yield from _in_phase(session, family, p, search, rough)
    if elsewhere and np.all(np.abs(points[0] - family.given) < _APART * family.grid):
        return Refusal('what was given is the sharpest', as_given=True)
    return (yield from _settled(session, family, points))


def _settled(session: Session, family: Family, points: list[NDArray[np.float64]]) -> Work:
    """From points near enough to the waveform's maximum."""
    best: tuple[float, NDArray[np.float64], Found] | None = None
    for q in points:
        found = yield from _polygon(session, family, q)
        if found is not None and found.wave is not None and (best is None or found.value > best[0]):
            best = found.value, q, found
            if found.explained > EXPLAINED:
                break
    if best is None or best[2].wave is None:
        return Refusal(_OUT_OF_PHASE)
    peak = yield from _climbed(session, family, best[1], best[2].wave)
    found = yield from _put_right(session, family, peak)
    if found is not None and found.wave is not None and found.wave.value > peak.value + _NATS:
        # The polygon of the sharpest point was not yet the right one.
        peak = yield from _climbed(session, family, peak.at, found.wave)
        found = yield from _put_right(session, family, peak)
    return _concluded(session, family, peak, found)


def _rough(search: Search) -> Generator[None, None, NDArray[np.float64] | None]:
    """Lines of a polygon by the power of the echoes."""
    for start in search.starts():
        yield
        if start is not None:
            model = yield from search.improve(start, 2, residual=False)
            model = yield from search.improve(model, 3, residual=True)
            return model.lines
    return None


def _in_phase(
    session: Session, family: Family, p: NDArray[np.float64], search: Search, lines: NDArray[np.float64]
) -> Generator[None, None, list[NDArray[np.float64]]]:
    """The sharpest points with phase about p, the best first."""
    data = search.data
    feet = feet_of(lines, data.positions)

    def focus(q: NDArray[np.float64]) -> float:
        try:
            view = family.view(p, q)
        except ParameterError:  # beyond what is allowed
            return -np.inf
        positions = session.positions(view.parameters) / view.zoom
        return wave_focus(data, lines, feet, positions, data.pulse.carrier + view.carrier)

    points = np.array(family.near(p))
    sharpness = np.empty(len(points))
    for index, q in enumerate(points):
        yield
        sharpness[index] = focus(q)
    chosen = []
    for _ in range(_TRIED):
        best = points[int(np.argmax(sharpness))]
        sharpness[np.all(np.abs(points - best) < _APART * family.grid, axis=1)] = -np.inf
        chosen.append((yield from ascend(focus, best, family.grid / 2.0, family.fine)))
    return chosen


def _polygon(
    session: Session, family: Family, q: NDArray[np.float64]
) -> Generator[None, None, Found | None]:
    """The polygon under one assumption, as the solver finds it; not searched for further where no phase agrees."""
    search = _search(session, family, q)
    if search is None:
        return None
    best = None
    for start in search.starts():
        yield
        found = None if start is None else (yield from search.polygon(start))
        best = max((each for each in (best, found) if each is not None), key=_worth, default=None)
        if best is not None and (best.wave is None or best.explained > EXPLAINED):
            break
    return best


def _worth(found: Found) -> tuple[bool, float]:
    """What agrees in phase first: the log likelihoods with phase and without it do not compare."""
    return found.wave is not None, found.value


def _put_right(
    session: Session, family: Family, peak: Peak[tuple[NDArray[np.float64], Wave]]
) -> Generator[None, None, Found | None]:
    """The polygon that a climb ended with, edges dropped and added; where it does not explain the echoes, another."""
    search, wave = _search(session, family, peak.at), peak.found[1]
    assert search is not None, 'the climb has been there'
    found = yield from search.settle(search.power.initial(1.0).with_lines(wave.lines, wave.loss))
    if found is not None and found.explained > EXPLAINED:
        return found
    other = yield from _polygon(session, family, peak.at)
    return max((each for each in (found, other) if each is not None), key=_worth, default=None)


def _climbed(
    session: Session, family: Family, q: NDArray[np.float64], wave: Wave
) -> Generator[None, None, Peak[tuple[NDArray[np.float64], Wave]]]:
    """The waveform's maximum over family and walls."""
    def function(
        at: NDArray[np.float64], near: tuple[NDArray[np.float64], Wave]
    ) -> tuple[float, tuple[NDArray[np.float64], Wave]]:
        search = _search(session, family, at)
        if search is None:
            return -np.inf, near
        view = family.view(near[0], at)
        lines = near[1].lines * (view.zoom, 1.0) + (view.shift_m, 0.0)
        refined = WaveformLikelihood(search.data).refine(lines, near[1].reflection, near[1].phase, FULL_ORDER)
        return (-np.inf, near) if refined is None else (refined.value, (at, refined))

    return (yield from climb(function, q, (q, wave), family.fine))


def _concluded(
    session: Session, family: Family, peak: Peak[tuple[NDArray[np.float64], Wave]], found: Found | None
) -> 'Fit | Refusal':
    values = family.values(peak.at)
    search = _search(session, family, peak.at)
    if found is None or found.wave is None:
        return Refusal(_OUT_OF_PHASE)
    explained = max(found.explained, 0.0)
    if values is None or search is None or explained < EXPLAINED - search.uncertainty:
        return Refusal(f'the best of them explains {explained:.0%} of the echoes\' power')
    covariance = peak.covariance
    if covariance is None or np.sqrt(np.max(np.diag(covariance) / (family.fine / family.fine[0]) ** 2)) > _SHARP:
        return Refusal('the echoes are alike with many of them; drive turns, and closer to the walls')
    covariance = covariance + np.diag((_FLOOR * family.fine / family.fine[0]) ** 2)
    centre = np.array(list(values.values()))
    slopes = np.column_stack([
        (np.array(list((family.values(peak.at + step) or values).values())) - centre) / np.max(step)
        for step in np.diag(0.1 * family.fine)])
    deviations = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    return Fit(values, dict(zip(values, deviations.tolist(), strict=True)), explained, peak.value)
