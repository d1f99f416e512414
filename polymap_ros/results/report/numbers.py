"""How measured numbers are shown: with as many digits as their deviations leave them."""

import math

UNKNOWN = '–'


def fixed(value: float | None, digits: int) -> str:
    """Return a number with so many digits after the point, and a zero without a sign."""
    return UNKNOWN if value is None or not math.isfinite(value) else f'{round(value, digits) + 0.0:.{digits}f}'


def digits_for(deviation: float | None, least: int, most: int, figures: int = 2) -> int:
    """Return how many digits after the point a value has: to the last of the figures of its deviation, or `most`."""
    if deviation is None or not math.isfinite(deviation) or deviation <= 0.0:
        return most
    return min(max(figures - 1 - math.floor(math.log10(deviation)), least), most)


def spread(deviation: float | None, factor: float, unit: str) -> str:
    """Return ``± 0.21 mm``, two figures; empty where it is not known."""
    if deviation is None or not math.isfinite(deviation):
        return ''
    scaled, space = factor * deviation, '' if unit == '°' else ' '
    digits = 0 if scaled >= 10.0 else 1 if scaled >= 1.0 else digits_for(scaled, 1, 4)
    shown = f'{scaled:.{digits}f}' if round(scaled, digits) else f'< {10.0**-digits:.{digits}f}'
    return f'± {shown}{space}{unit}'
