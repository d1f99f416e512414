"""How a medium differs from the one that was given, found with the walls where no polygon explains the echoes.

Three numbers (`uneven_medium`): by how much waves get faster while the robot drives, by how much they are faster in one
direction, and in which. Power tells them but roughly, since walls that move make good for them: of a grid what it
likes best is tried in phase, and the best goes to the top of a parabola over all three, whose bend tells how well they
are known.
"""

from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import stretched_lines
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, FULL_ORDER, PHASED, SEARCH_ORDER, WHOLE, WORTH_MOVING
from polymap_ros.solvers.evidence.uneven_medium import UnevenMedium
from polymap_ros.solvers.evidence.waveform import Wave

_MEDIUM_FROM = 20
"""Pings from which a medium is told from a place."""

_DIRECTIONS_APART, _MOST_UNEVEN = 0.0035, 0.0246
"""Shares between the directions' numbers that are tried, and the most of them: 2 m of way are 7 mm longer by the first,
for which walls make good but for a little."""

_LEAST_UNEVEN = 1e-3
"""Share below which walls that are found so are those of an even medium: 2 m of way are 2 mm longer by it, and it is a
fifth of the least that has been simulated."""

_MEDIA_FASTER = np.arange(-0.015, 0.0151, 0.0025)
"""Shares that are tried of getting faster."""

_MEDIA_BY_POWER, _MEDIA_BY_PHASE = 90, 4
"""Media of several directions that are tried in phase by a part of the pings, and media that are by all of them."""

_MEDIA_IN_TURN = 3
"""Times that medium and walls are found in turn: a wall may be half a cycle off."""

_MEDIA_STEPS = 8e-4, 2e-4
"""Differences of the numbers between which a parabola is drawn: 2 m of way change by a fifth of a cycle and less."""

_MEDIA_CLIMBED = 8
"""Steps at most: to the top of a parabola or, where there is none, to the best of the numbers that it was drawn by."""

_MEDIA_AHEAD = 4.0
"""Of these differences, how far a step goes at most."""

_MEDIA_GAIN = 1.0
"""Nats that are not worth another one."""


class FoundMedium(NamedTuple):
    """A medium, None for one that is even, the search over what is heard in it, and the polygon there."""

    medium: UnevenMedium | None
    search: Search
    found: Found


class _Drive:
    """A search, and when its pings were heard."""

    def __init__(self, search: Search, stamps_ns: NDArray[np.int64]) -> None:
        self._search, self._stamps_ns, self._first_ns = search, stamps_ns, int(stamps_ns.min())
        self._seconds = max(float(np.ptp(stamps_ns)) / 1e9, 1e-9)
        self._few = search.over(search.data.every(search.share))

    def medium(
        self, numbers: NDArray[np.float64], deviations: NDArray[np.float64] | tuple[float, ...] = (0.0, 0.0, 0.0)
    ) -> UnevenMedium:
        """Return the medium of numbers (3,), the first of them over the whole drive, with deviations (3,)."""
        (drift, along, across), (drift_std, *others) = numbers.tolist(), deviations
        return UnevenMedium(self._first_ns, drift / self._seconds, along, across, float(drift_std) / self._seconds,
                            float(np.hypot(*others)))

    def over(self, numbers: NDArray[np.float64], few: bool = False) -> Search:
        """Return the search in a medium, by a part of the pings if asked for."""
        self._search.checkpoint()
        if few:
            return self.medium(numbers).over(self._few, self._stamps_ns[::self._search.share])
        return self.medium(numbers).over(self._search, self._stamps_ns)


class _Trial(NamedTuple):
    """Numbers (3,), the search in that medium, what walls there come to, and what they are worth."""

    numbers: NDArray[np.float64]
    search: Search
    power: Power
    wave: Wave | None
    value: float


def found_medium(search: Search, begun: Power, stamps_ns: NDArray[np.int64]) -> FoundMedium | None:
    """Return the medium in which walls that were begun by power explain all of the echoes; None where there is none.

    Where it is all but even, its walls have led to those of the even one.
    """
    if len(stamps_ns) < _MEDIUM_FROM or not (search.coherent and begun.walls.convex_outline):
        return None
    drive = _Drive(search, stamps_ns)
    tried = [each for numbers in _grid() if (each := _by_power(drive, numbers, begun)) is not None]
    tried.sort(key=lambda each: -each.value)
    directions, faster = ([each for each in tried if bool(each.numbers[0]) == drifting] for drifting in (False, True))
    even = _in_phase(still) if (still := _by_power(drive, np.zeros(3), begun)) else None
    aligned = (_in_phase(each) for each in (*directions[:_MEDIA_BY_POWER], *faster))
    better = (each for each in aligned if each is not None and (even is None or each.value > even.value))
    best = sorted(better, key=lambda each: -each.value)[:_MEDIA_BY_PHASE]
    found: FoundMedium | None = None
    for trial in best:
        other = _found(drive, trial)
        if other is not None and (found is None or other.found.value > found.found.value):
            found = other
        if found is not None and found.found.explained > WHOLE - search.uncertainty / 3.0:
            break
    enough = ALL_EXPLAINED - search.uncertainty / 3.0
    if found is not None and found.medium is not None and found.medium.unevenness(stamps_ns) < _LEAST_UNEVEN:
        found = _in_even(search, found.found)
    return found if found is not None and found.found.explained > enough else None


def _in_even(search: Search, found: Found) -> FoundMedium | None:
    """Return the same walls in an even medium."""
    wave = found.wave and search.wave.refine(found.wave, FULL_ORDER)
    settled = wave and _settled(search, wave, found.power.strength)
    return FoundMedium(None, search, settled) if settled else None


def _settled(search: Search, wave: Wave, strength: float) -> Found | None:
    """Return what the moves make of a waveform."""
    return search.changed(search.power.initial(strength).with_walls(wave.walls), wave)


def _grid() -> list[NDArray[np.float64]]:
    """Numbers (3,) that are tried: of directions, and of getting faster."""
    most = round(_MOST_UNEVEN / _DIRECTIONS_APART)
    axis = _DIRECTIONS_APART * np.arange(-most, most + 1)
    directions = [np.array((0.0, along, across)) for along in axis for across in axis
                  if 0.0 < np.hypot(along, across) <= _MOST_UNEVEN]
    return directions + [np.array((faster, 0.0, 0.0)) for faster in _MEDIA_FASTER if faster != 0.0]


def _by_power(drive: _Drive, numbers: NDArray[np.float64], begun: Power) -> _Trial | None:
    """Return walls by power in a medium, begun from others where that takes them."""
    few, faster = drive.over(numbers, few=True), 1.0 + 0.5 * float(numbers[0])
    lines = stretched_lines(begun.walls.lines, drive.medium(numbers).stretch * faster)
    nothing = few.power.initial(begun.strength)
    power = few.power.refine(begun.walls.on(lines), nothing, SEARCH_ORDER, 3)
    # By cells that are as many as were heard: an axis that is drawn out has more.
    return None if power is None else _Trial(numbers, few, power, None, power.value / faster)


def _in_phase(trial: _Trial) -> _Trial | None:
    """Return the same in phase."""
    wave = trial.search.aligned(trial.power, trial.search.edges[0])
    return None if wave is None else trial._replace(wave=wave, value=wave.value)


def _found(drive: _Drive, trial: _Trial) -> FoundMedium | None:
    """Return the medium near a trial's that fits best, by all pings, with its walls; again where these have changed."""
    numbers, ground, found = trial.numbers, drive.over(trial.numbers), None
    wave = trial.wave and ground.wave.refine(trial.wave, FULL_ORDER)

    def at(numbers: NDArray[np.float64], near: Wave) -> Wave | None:
        return drive.over(numbers).wave.refine(near, FULL_ORDER)

    for _ in range(_MEDIA_IN_TURN):
        if wave is None or ground.as_modelled(wave) < WORTH_MOVING:
            break
        numbers, wave, deviations = _climbed(at, numbers, wave)
        ground = drive.over(numbers)
        if ground.explained(wave, PHASED) < PHASED:
            break
        settled = _settled(ground, wave, trial.power.strength)
        if settled is None or (found is not None and settled.value < found.found.value + _MEDIA_GAIN):
            break
        medium = drive.medium(numbers, deviations)
        found, wave = FoundMedium(medium, ground, settled), settled.wave
    return found


def _climbed(
    at: Callable[[NDArray[np.float64], Wave], Wave | None], numbers: NDArray[np.float64], start: Wave
) -> tuple[NDArray[np.float64], Wave, NDArray[np.float64]]:
    """Return the numbers at the top of parabolas over all of them, the waveform there, and their deviations (3,)."""
    best, deviations = start, np.full(3, _MOST_UNEVEN)
    steps = list(_MEDIA_STEPS)
    for _ in range(_MEDIA_CLIMBED):
        tried = {move: (numbers + step, at(numbers + step, best)) for move, step in _moves(steps[0] * np.eye(3))}
        slope, bend = _parabola({move: _value(wave) for move, (_, wave) in tried.items()}, best.value)
        around = list(tried.values())
        if np.all(np.isfinite(bend)) and np.all(np.linalg.eigvalsh(bend) < 0.0):
            deviations = steps[0] * np.sqrt(np.diag(np.linalg.inv(-bend)))
            onward = numbers + steps[0] * np.clip(np.linalg.solve(-bend, slope), -_MEDIA_AHEAD, _MEDIA_AHEAD)
            around.append((onward, at(onward, best)))
        onward, top = max(around, key=lambda entry: _value(entry[1]))
        if top is not None and top.value > best.value + _MEDIA_GAIN:
            numbers, best = onward, top
        elif len(steps) > 1:
            steps.pop(0)
        else:
            break
    return numbers, best, deviations


def _parabola(
    values: dict[tuple[int, int], float], here: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return slope (3,) and bend (3, 3) of the parabola through the values at `_moves` and here, in steps."""
    slope = np.array([0.5 * (values[k, 1] - values[k, -1]) for k in range(3)])
    bend = np.diag([values[k, 1] + values[k, -1] - 2.0 * here for k in range(3)])
    for k, other in combinations(range(3), 2):
        bend[k, other] = bend[other, k] = values[k, other + 3] - values[k, 1] - values[other, 1] + here
    return slope, bend


def _moves(axes: NDArray[np.float64]) -> list[tuple[tuple[int, int], NDArray[np.float64]]]:
    """Steps along each axis, there (k, 1) and back (k, -1), and along two at once (k, other + 3)."""
    alone = [((k, sign), sign * axis) for k, axis in enumerate(axes) for sign in (1, -1)]
    return alone + [((k, other + 3), axes[k] + axes[other]) for k, other in combinations(range(3), 2)]


def _value(wave: Wave | None) -> float:
    return -np.inf if wave is None else wave.value
