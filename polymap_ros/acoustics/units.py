"""In which unit a sample period or a range was given that cannot be one in seconds or metres."""

from math import isfinite, log10

_TOLERANCE = 0.05
"""Of a unit's factor: what a driver rounds."""

_FACTORS = {1e-3: 'milliseconds', 1e-6: 'microseconds', 1e-9: 'nanoseconds'}
_LENGTHS = {1e-3: 'millimetres', 1e-2: 'centimetres', 1e3: 'kilometres'}
_RATES = {1.0: 'a sample rate in Hz', 1e3: 'a sample rate in kHz', 1e6: 'a sample rate in MHz'}


def likely_unit(found_s: float, right_s: float) -> str:
    """Say how a period differs from the right one, by its unit or by a factor; empty where both are alike.

    Parameters
    ----------
    found_s : float
        The period as it was given, taken for seconds.
    right_s : float
        What is known, or believed, to be right [s].
    """
    if not (found_s > 0.0 and right_s > 0.0 and isfinite(found_s) and isfinite(right_s)):
        return ''
    for factor, unit in _FACTORS.items():
        if _alike(found_s * factor, right_s):
            return f': {found_s:g} looks like {unit}, the period is in seconds ({right_s:g})'
    for factor, unit in _RATES.items():
        if _alike(1.0 / (found_s * factor), right_s):
            return f': {found_s:g} looks like {unit}, the period is in seconds ({right_s:g})'
    ratio = found_s / right_s
    if _alike(ratio, 1.0):
        return ''
    much, size = (ratio, 'long') if ratio > 1.0 else (1.0 / ratio, 'short')
    return f': {found_s:g} s is {much:.4g} times too {size} for {right_s:g} s'


def likely_period(found_s: float, longest_s: float, shortest_s: float) -> float | None:
    """Guess the period [s] that was meant: in another unit, or off by a power of ten; None where none fits.

    Parameters
    ----------
    found_s : float
        The period as it was given, taken for seconds.
    longest_s, shortest_s : float
        Between these a period makes sense [s].
    """
    units = [*(found_s * factor for factor in _FACTORS), *(1.0 / (found_s * factor) for factor in _RATES),
             *(found_s * 10.0**power for power in (3, 6, 9, -1, 1, -2, 2, -4, 4, -5, 5))]
    return next((period_s for period_s in units if shortest_s <= period_s < longest_s), None)


def likely_length(found_m: float, shortest_m: float, longest_m: float) -> str:
    """Say in which unit a length may be that is out of bounds in metres; empty where none fits.

    Parameters
    ----------
    found_m : float
        The length as it was given, taken for metres.
    shortest_m, longest_m : float
        Between these it makes sense [m].
    """
    units = [f'{unit} ({found_m * factor:g} m)' for factor, unit in _LENGTHS.items()
             if shortest_m <= found_m * factor <= longest_m]
    return f': {found_m:g} looks like {" or ".join(units)}, ranges are in metres' if units else ''


def _alike(value: float, other: float) -> bool:
    return abs(log10(value / other)) < log10(1.0 + _TOLERANCE)
