"""Medium, odometry or time zero from the echoes themselves: what is asked for, by the stages of `stages`."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from polymap_ros.calibration.families import Family, Odometry, Plate, Speed, Thickness, TimeZero
from polymap_ros.calibration.session import Session
from polymap_ros.calibration.stages import (
    CERTAIN_NATS,
    Fit,
    Refusal,
    assumed_at,
    rough_lines,
    search_at,
    settle,
    settled,
    sharpest,
    top_of,
)
from polymap_ros.cautions import CAUTIONS, in_metres
from polymap_ros.solvers.evidence.tuning import FULL_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.straightness import path_half_width

LEAST_PINGS = 8
"""Fewer pings tell too little of a path."""

_ALL_EXPLAINED = 0.95
"""Share of the echoes' power from which thickness alone is enough."""

_WORTH = 0.002
"""Share of the log likelihood that a second parameter has to bring, beside `CERTAIN_NATS`."""

_BEGUN_AT = 0.0, -1.5, 1.5
"""Pulse widths from the time zero given at which a search for another begins, until one explains the echoes."""

_PULSES_OFF = 3.0, 1.5, 0.8, 0.3
"""Widths of the pulse that a time zero may be off, round by round."""

_NEARBY = 0.0, 0.1, -0.1, 0.2, -0.2
"""Widths of the pulse from where power has led to, within a tenth of which the waveform agrees."""


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
    tops = sharpest(session, thickness)
    first = settle(session, thickness, tops[0], elsewhere)
    if first.as_given if isinstance(first, Refusal) else first.explained > _ALL_EXPLAINED:
        return first
    start = assumed_at(session, thickness, tops[0])
    plate = Plate(parameters.replaced(first.values) if isinstance(first, Fit) else start or parameters)
    both = settle(session, plate, plate.given, False)
    if isinstance(first, Refusal):
        return both
    return both if isinstance(both, Fit) and both.value > first.value + needed(first.value) else first


def needed(value: float) -> float:
    """Nats that an explanation with more numbers has to bring over one of this log likelihood."""
    return max(CERTAIN_NATS, _WORTH * value)


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
        search = search_at(session, family, at)
        rough = None if search is None else rough_lines(search)
        if rough is None:
            return Refusal('no polygon closes, not even roughly')
        points = family.row(at, reach * width_m)
        score = np.full(len(points), -np.inf)
        for index, p in enumerate(points):
            session.checkpoint()
            lines = rough + (family.view(at, p).shift_m, 0.0)
            if np.all(lines[:, 0] > 0.0) and (search := search_at(session, family, p)):
                refined = search.power.refine(Walls.convex(lines), search.nothing.with_strength(1.0), FULL_ORDER)
                score[index] = -np.inf if refined is None else refined.value
        at = top_of(points, score)
    return settled(session, family, [at + width_m * share for share in _NEARBY])


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
    points = [*sharpest(session, family), family.given]
    return _first_fit(settle(session, family, p, elsewhere) for p in points)


def _first_fit(results: Iterable[Fit | Refusal]) -> Fit | Refusal:
    """The first that finds something, or that what was given is the sharpest; else why the first did not."""
    first: Refusal | None = None
    for result in results:
        if isinstance(result, Fit) or result.as_given:
            return result
        first = first or result
    assert first is not None, 'what was given is tried'
    return first
