"""Floor and ceiling as all pings hear them: echoes at the same range wherever the robot is.

In the mean over the pings of their signals the echoes of walls, which are elsewhere from ping to ping, add up at random
and those of floor and ceiling do not. With heights a and b these are at a, b, a + b, 2 a + b and so on, each as
strong as its coefficients make it; of all pairs, and of all heights alone, the one whose echoes explain the mean best
by the likelihood of `power` is taken.
"""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.storey import Storey
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.power_sums import more_power
from polymap_ros.solvers.evidence.tuning import PRICE, SEARCH_ORDER

_AGREED = 8
"""Ranges at which all pings hear something, the strongest, that are tried as heights."""

_COMMON = 12.0
"""Times the mean power of the pings, over their number, that the power of their mean has to have: where nothing is
common it is exponential with mean 1, and beyond this in one of 160,000 cells."""

_STRENGTHS = 1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0
"""Strengths of a first-order echo that are tried, over what the stronger plane's would be if it reflected all: its
coefficient is 0.5 to 1."""

_FEWEST = 8
"""Pings from which what they have in common is looked for."""


def storey_heard(data: EchoData) -> tuple[Storey, float]:
    """Return floor and ceiling, or none, and the strength of the echoes at which they have these coefficients."""
    if len(data.positions) < _FEWEST:
        return Storey(), 0.0
    common, quiet = _common_power(data)
    best, strength, least = Storey(), 0.0, 0.0
    peaks = _peaks(data, common, quiet)
    for ranges in (*((peak,) for peak in peaks), *combinations(sorted(peaks), 2)):
        heights = _heights(data, np.array(ranges))
        if not np.all(heights > 0.0):
            continue
        alone = _at_one_metre(data, common - quiet, np.array(ranges))
        for factor in _STRENGTHS:
            most = factor * float(alone.max())
            storey = Storey(heights, np.sqrt(alone / most))
            more = _predicted(data, storey, most)
            linear, ratio = more_power(common, quiet, more)
            value = data.weight * float(np.sum((linear - np.log(ratio))[data.first_cell:]))
            if value > least + PRICE * len(ranges):
                best, strength, least = storey, most / len(data.positions), value
    return best, strength


def _common_power(data: EchoData) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the power (n_cells,) of the pings' mean, times their number, and their mean power."""
    stride = round(data.cell_m / data.pulse.step_m)
    mean = data.signal[:, ::stride][:, :data.power.shape[1]].mean(axis=0)
    return 0.5 * len(data.positions) * np.abs(mean) ** 2, data.mean_power


def _peaks(data: EchoData, common: NDArray[np.float64], quiet: NDArray[np.float64]) -> list[float]:
    """Return the ranges [m] at which the pings agree most, the strongest first."""
    reach = max(1, round(data.pulse.width_m / data.cell_m))
    found: list[int] = []
    for cell in np.argsort(-common, kind='stable'):
        if len(found) == _AGREED:
            break
        if cell < data.first_cell or cell in (0, len(common) - 1) or common[cell] < _COMMON * quiet[cell]:
            continue
        if common[cell] >= max(common[cell - 1], common[cell + 1]) and all(abs(cell - each) > reach for each in found):
            found.append(int(cell))
    return [float(data.cell_m * (cell + _vertex(common[cell - 1:cell + 2]))) for cell in found]


def _vertex(three: NDArray[np.float64]) -> float:
    """Return where the parabola through three values has its top, from the middle one."""
    bend = three[0] - 2.0 * three[1] + three[2]
    return 0.0 if bend >= 0.0 else 0.5 * float((three[0] - three[2]) / bend)


def _at_one_metre(data: EchoData, power: NDArray[np.float64], range_m: NDArray[np.float64]) -> NDArray[np.float64]:
    at = np.maximum(np.interp(range_m / data.cell_m, np.arange(len(power)), power), 1e-9)
    return np.asarray(at * range_m ** (2.0 * data.spreading))


def _heights(data: EchoData, range_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far from the emitter planes are that are heard at one or two ranges, the nearer taken for the floor.

    A receiver above the emitter by b hears a floor at a as from a + b / 2, a ceiling at c as from c - b / 2.
    """
    aside, up = _apart(data)
    from_middle = np.sqrt(np.maximum(range_m**2 - 0.25 * aside**2, 0.0))
    return np.asarray(from_middle + 0.5 * up * np.array([-1.0, 1.0])[:len(range_m)])


def _apart(data: EchoData) -> tuple[float, float]:
    """Return how far the receiver is from the emitter along the floor, and above it [m]: so for all pings."""
    x, y, up = data.baselines[0]
    return float(np.hypot(x, y)), float(up)


def _predicted(data: EchoData, storey: Storey, strength: float) -> NDArray[np.float64]:
    """Return the power (n_cells,) of the echoes of floor and ceiling alone."""
    ranges = data.cell_m * np.arange(len(data.mean_power))
    total = np.zeros(len(ranges))
    shape_m = data.pulse.step_m * np.arange(len(data.pulse.power))
    aside, up = _apart(data)
    for z, coefficient, _ in storey.images(SEARCH_ORDER, up == 0.0)[1:]:
        half = 0.5 * np.hypot(aside, up - z)
        total += strength * coefficient**2 * half ** (-2.0 * data.spreading) * np.interp(
            np.abs(ranges - half), shape_m, data.pulse.power, right=0.0)
    return total
