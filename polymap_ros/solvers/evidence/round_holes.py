"""Round holes in a convex outline: found by first echoes, then with all that they give and take away.

A circle's first echoes come from the distance of its middle less its radius: three numbers, looked for on a grid. With
those echoes taken out the outline stands out, and with both all that a hole changes can be worked out and taken out in
turn, each time as outline and circle then stand.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import ring_corners
from polymap_ros.solvers.evidence.corner_echoes import add_echoes
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.rings import ring_feet
from polymap_ros.solvers.evidence.round_echoes import (
    RoundHoles,
    best_circle,
    first_echoes_in_phase,
    of_outline,
    over_circles,
)
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tuning import HOLES, SEARCH_ORDER
from polymap_ros.solvers.evidence.waveform import Wave

_HOLE_RADII_M = 0.04, 0.3
"""Radii that are looked for, from and to."""

_BEND_STRENGTH = 0.5
"""Share of a straight wall's first echo that a circle's has: the root of a / (a + s) at 0.3 m from one of 0.1 m."""

_MIDDLE_WIDTHS = 0.6
"""Pulse widths between the middles that are tried."""

_ROUND_FROM, _ROUND_LEFT = 120.0, 60.0
"""Evidence [nats] of its first echoes from which a circle is looked into, and the most that may be left for another:
in eight plates with one or two round holes it was 147 to 373, and 30 at most of what is left without them; in plates
with a rectangular one, and in L, 80 to 150, and no less of what is left (all of even seeds)."""

_PLACE_AROUND_M, _PLACE_STEPS_M = 0.008, (0.002, 0.001, 0.0005, 0.00025)
"""How far from there, and in which steps, the place is sought by the sum of the first echoes."""

_ROUND_REFITS, _ROUND_GAINED = 12, 2e-3
"""How often, at most, all that a hole changes is taken out, and outline and hole are fitted to what is left; and the
share of the echoes that such a round explains more, at least, or it was the last but for the outline's own changes."""

_ROUND_PROMISING = 0.1
"""Share of the echoes that an outline has to explain more once all that a hole changes is taken out, and not just its
first echoes, for it to be looked into further."""

_CIRCLE_STILL_M = 2e-5
"""Circles that moved by less [m] stay: a hundred and fiftieth of what they may be off."""

_CIRCLE_NUDGE_M, _REFLECTION_NUDGE = 1e-5, 1e-3
"""By how much middle and radius, and the reflection, are moved for derivatives."""


def with_round_holes(search: Search, found: Found, enough: float) -> tuple[Search, Found]:
    """Return the search over what round holes do not change, and the outline there; both as they are without a hole.

    Where edges turn the phase, none is looked for.
    """
    turned = found.wave is not None and len(found.wave.edge.table) > 0
    if turned or len(found.storey):
        return search, found
    circles, cleared = _by_first_echoes(search, found)
    if not len(circles):
        return search, found
    outline = cleared.settle(found.power)
    if outline is not None and outline.wave is None:  # in phase by the pings that a large hole is not in the way of
        outline = cleared.judged(outline.power, cleared.aligned(outline.power))
    if outline is None or outline.wave is None:
        return search, found
    fitted = fitted_round(search, outline, np.column_stack((circles, np.ones(len(circles)))))
    if fitted is None or fitted[1].explained < enough - _ROUND_PROMISING:
        return search, found
    return fitted


def _by_first_echoes(search: Search, found: Found) -> tuple[NDArray[np.float64], Search]:
    """Centres and radii (c, 3) of circles that first echoes speak for, beside an outline, and the search without."""
    fitted, circles = search.power.fitted(found.walls, found.power, SEARCH_ORDER), list[NDArray[np.float64]]()
    _, corners = ring_corners(found.lines, 0.0, 1.0)
    none, evidence = (np.empty((0, 3)), search), 0.0
    while fitted is not None:
        search.checkpoint()
        feet = ring_feet(search.data, fitted.expected, _BEND_STRENGTH * fitted.strength)
        evidence, *circle = best_circle(feet, corners, _MIDDLE_WIDTHS * search.width_m, *_HOLE_RADII_M)
        if evidence < _ROUND_FROM:
            break
        if len(circles) == HOLES:
            return none
        circles.append(_placed(search.data, np.array(circle)))
        search = search.over(_without_first_echoes(search.data, circles[-1]))
    return none if evidence > _ROUND_LEFT else (np.reshape(circles, (-1, 3)), search)


def _placed(data: EchoData, circle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The place near by whose first echoes add up to most, whatever phase they share."""
    signal, pulse = data.signal.astype(complex), data.pulse

    def value(place: NDArray[np.float64]) -> float:
        total, square = first_echoes_in_phase(
            signal, data.ends, data.gain, pulse.carrier, pulse.step_m, data.spreading, *place)
        return abs(total) ** 2 / max(square, 1e-300)

    best, most = circle, value(circle)
    offsets = np.arange(-_PLACE_AROUND_M, _PLACE_AROUND_M + 1e-9, _PLACE_STEPS_M[0])
    for offset in itertools.product(offsets, repeat=3):
        if (trial := value(circle + offset)) > most:
            best, most = circle + offset, trial
    for step in _PLACE_STEPS_M[1:]:
        improved = True
        while improved:
            improved = False
            for number, sign in itertools.product(range(3), (-1.0, 1.0)):
                place = best.copy()
                place[number] += sign * step
                if (trial := value(place)) > most:
                    best, most, improved = place, trial, True
    return best


def _without_first_echoes(data: EchoData, circle: NDArray[np.float64]) -> EchoData:
    """The pings without the first echoes of a circle (3,), as strong as they are heard together."""
    pulse = data.pulse
    total, square = first_echoes_in_phase(data.signal.astype(complex), data.ends, data.gain, pulse.carrier,
                                          pulse.step_m, data.spreading, *circle)
    near, far = (np.hypot(*(data.ends[:, k:k + 2] - circle[:2]).T) for k in (0, 2))
    flat = near + far - 2.0 * circle[2]
    half = 0.5 * np.hypot(flat, data.ends[:, 4])
    b = total / max(square, 1e-300) * np.sqrt(data.gain * circle[2] / (circle[2] + 0.5 * flat)) * (
        half**-data.spreading * np.exp(-2j * pulse.carrier * half))
    echo = np.zeros(data.signal.shape, complex)
    add_echoes(np.arange(len(half)), half, b, pulse.baseband, pulse.step_m, echo)
    return data.with_signal((data.signal - echo).astype(np.complex64))


def fitted_round(search: Search, outline: Found, circles: NDArray[np.float64]) -> tuple[Search, Found] | None:
    """Return what outline and circles (c, 4) explain together; None where that does not promise enough."""
    other, better, changed, again = search, outline, False, None
    fit = RoundHoles(circles, np.zeros((circles.size, circles.size)))
    still = False
    for round_ in range(_ROUND_REFITS):
        search.checkpoint()
        assert better.wave is not None, 'is refined by the waveform'
        data, wave = search.data, better.wave
        (own, hidden), over = of_outline(data, wave, fit.circles), over_circles(data, wave, fit.circles)
        cleared = data.signal - over + hidden
        other = search.over(data.with_signal(cleared.astype(np.complex64)))
        other.approximate, other.round_holes = True, fit
        again = other.again(better)
        if again is None or again.wave is None or (
                round_ == 1 and again.explained < outline.explained + _ROUND_PROMISING):
            return None
        settled = again.explained < better.explained + _ROUND_GAINED and round_ > 1
        if settled and changed:
            break
        if settled:
            changed, again = True, other.changed(again.power, again.wave)
            if again is None or again.wave is None:
                return None
        if not still:
            nearer = _nearer(data, wave, fit.circles, cleared - own)
            still = round_ > 0 and float(np.abs(nearer.circles - fit.circles)[:, :3].max()) < _CIRCLE_STILL_M
            fit = nearer
        better = again
    return (other, again) if again is not None and again.walls.convex_outline else None


def _nearer(
    data: EchoData, wave: Wave, circles: NDArray[np.float64], left: NDArray[np.complex128]
) -> RoundHoles:
    """Circles after a step of Gauss and Newton towards what they and the outline leave, with their covariance."""
    heard = slice(round(data.first_cell * data.cell_m / data.pulse.step_m), round(
        data.range_max_m / data.pulse.step_m))
    still, slopes = over_circles(data, wave, circles, SEARCH_ORDER)[:, heard].ravel(), []
    for number in range(circles.size):
        moved, by = circles.copy(), _REFLECTION_NUDGE if number % 4 == 3 else _CIRCLE_NUDGE_M
        moved.flat[number] += by
        slopes.append((over_circles(data, wave, moved, SEARCH_ORDER)[:, heard].ravel() - still) / by)
    table = np.array(slopes)
    information = np.real(table.conj() @ table.T)
    step = np.linalg.lstsq(information, np.real(table.conj() @ left[:, heard].ravel()), rcond=1e-12)[0].reshape(-1, 4)
    limits = np.array((*[0.5 * data.pulse.width_m] * 3, 0.5))
    circles = circles + np.clip(step, -limits, limits)
    circles[:, 3] = np.clip(circles[:, 3], -1.0, 1.0)
    independent = data.pulse.step_m / data.pulse.width_m
    return RoundHoles(circles, np.asarray(np.linalg.pinv(independent * information), dtype=float))


def rehearse_round_holes(search: Search, outline: Found) -> None:
    """Use the kernels once, on an outline and whatever the pings heard."""
    _, corners = ring_corners(outline.lines, 0.0, 1.0)
    middle = search.data.positions.mean(axis=0)
    best_circle(ring_feet(search.data, search.nothing.expected, 1.0), corners, 1.0, *_HOLE_RADII_M)
    _without_first_echoes(search.data, np.array((*middle, _HOLE_RADII_M[0])))
    if outline.wave is not None:
        circles = np.array([[*middle, _HOLE_RADII_M[0], 1.0]])
        _nearer(search.data, outline.wave, circles, of_outline(search.data, outline.wave, circles)[0])
