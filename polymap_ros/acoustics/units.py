"""In which unit a sample period or a range was given that cannot be one in seconds or metres."""

from math import isfinite, log10

_TOLERANCE = 0.05
"""Of a unit's factor: what a driver rounds."""

_FACTORS = {1e-3: 'milliseconds', 1e-6: 'microseconds', 1e-9: 'nanoseconds'}
_LENGTHS = {1e-3: 'millimetres', 1e-2: 'centimetres', 1e3: 'kilometres'}
_RATES = {1.0: 'a sample rate in Hz', 1e3: 'a sample rate in kHz', 1e6: 'a sample rate in MHz'}


def likely_unit(found_s: float, right_s: float, count: int = 0) -> str:
    """Say how a period differs from the right one, by its unit or by a factor; empty where both are alike.

    Parameters
    ----------
    found_s : float
        The period as it was given, taken for seconds.
    right_s : float
        What is known, or believed, to be right [s].
    count : int, optional
        Samples of the ping, whose whole time it may be.
    """
    if not (found_s > 0.0 and right_s > 0.0 and isfinite(found_s) and isfinite(right_s)):
        return ''
    if units := [unit for unit, period_s in _readings(found_s, count).items() if _alike(period_s, right_s)]:
        return f': {found_s:g} looks like {" or ".join(units)}, the period is in seconds ({right_s:g})'
    ratio = found_s / right_s
    if _alike(ratio, 1.0):
        return ''
    much, size = (ratio, 'long') if ratio > 1.0 else (1.0 / ratio, 'short')
    return f': {found_s:g} s is {much:.4g} times too {size} for {right_s:g} s'


def guessed_unit(found_s: float, expected_s: float, longest_s: float, shortest_s: float, count: int) -> str:
    """Say in which unit a period may be, or by which power of ten it may be off; empty where nothing fits.

    Parameters
    ----------
    found_s : float
        The period as it was given, taken for seconds.
    expected_s : float
        Of what fits, the nearest to this is believed [s].
    longest_s, shortest_s : float
        Between these a period makes sense [s].
    count : int
        Samples of the ping, whose whole time it may be.
    """
    fitting = {unit: period_s for unit, period_s in _readings(found_s, count).items()
               if shortest_s <= period_s < longest_s}
    if not fitting:
        powers = (found_s * 10.0**power for power in (3, 6, 9, -1, 1, -2, 2, -4, 4, -5, 5))
        return next((likely_unit(found_s, period_s) for period_s in powers if shortest_s <= period_s < longest_s), '')
    right_s = min(fitting.values(), key=lambda period_s: abs(log10(period_s / expected_s)))
    others = [f', or like {unit} ({period_s:g})' for unit, period_s in fitting.items()
              if not _alike(period_s, right_s)]
    return likely_unit(found_s, right_s, count) + ''.join(others)


def _readings(found_s: float, count: int) -> dict[str, float]:
    """What a period would be in seconds, by what it may have been given as."""
    return {
        **{unit: found_s * factor for factor, unit in _FACTORS.items()},
        **{unit: 1.0 / (found_s * factor) for factor, unit in _RATES.items()},
        **({f'the time of all {count} samples': found_s / count} if count > 1 else {}),
    }


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
