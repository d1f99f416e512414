"""How much longer one thing takes than another: both measured in turn, in one run, in time of this process's CPU."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Clock = Callable[[], float]


@dataclass(frozen=True)
class Paired:
    """An operation beside its reference.

    Parameters
    ----------
    operation, reference : str
        What was measured.
    seconds, reference_seconds : float
        Median of one call [s].
    ratio, ratio_low, ratio_high : float
        Median and quartiles of the ratio within a repetition.
    target : str
        What the ratio should be.
    note : str
        What else is to be known.
    """

    operation: str
    reference: str
    seconds: float
    reference_seconds: float
    ratio: float
    ratio_low: float
    ratio_high: float
    target: str = ''
    note: str = ''

    def row(self) -> dict[str, object]:
        """Cells of results.csv."""
        return dict(vars(self))


def paired(
    operation: tuple[str, Callable[[], object]], reference: tuple[str, Callable[[], object] | float],
    repetitions: int, target: str, least_s: float = 0.0, clock: Clock = time.process_time,
) -> Paired:
    """Measure both in turn, so that what slows the machine down slows both.

    Parameters
    ----------
    operation, reference
        Name and function; a number in the place of a function is its time [s].
    repetitions : int
        Pairs.
    target : str
        As in `Paired`.
    least_s : float
        A function is called so often that a measurement takes at least so long; 0: once [s].
    clock : callable
        Gives the time that is counted [s].
    """
    functions = [operation[1], reference[1]]
    calls = [1 if isinstance(each, float) else _calls(each, least_s, clock) for each in functions]
    pairs = np.array([[each if isinstance(each, float) else _seconds(each, count, clock)
                       for each, count in zip(functions, calls, strict=True)] for _ in range(repetitions)])
    ratios = pairs[:, 0] / pairs[:, 1]
    low, middle, high = np.percentile(ratios, (25, 50, 75)).tolist()
    seconds, reference_seconds = np.median(pairs, axis=0).tolist()
    return Paired(operation[0], reference[0], seconds, reference_seconds, middle, low, high, target)


def _calls(function: Callable[[], object], least_s: float, clock: Clock) -> int:
    """How many calls take at least so long, without what is loaded on first use."""
    if not least_s:
        return 1
    function()
    count = 1
    while _seconds(function, count, clock) * count < least_s:
        count *= 2
    return count


def _seconds(function: Callable[[], object], count: int, clock: Clock) -> float:
    begun_s = clock()
    for _ in range(count):
        function()
    return (clock() - begun_s) / count


def paired_table(rows: list[Paired]) -> str:
    """Markdown."""
    lines = ['| operation | against | takes | that takes | ratio (quartiles) | target | |',
             '| --- | --- | --- | --- | --- | --- | --- |']
    lines += [f'| {row.operation} | {row.reference} | {_shown(row.seconds)} | {_shown(row.reference_seconds)} | '
              f'{row.ratio:.3g} ({row.ratio_low:.3g} to {row.ratio_high:.3g}) | {row.target} | {row.note} |'
              for row in rows]
    return '\n'.join(lines)


def _shown(seconds: float) -> str:
    for unit, size in (('s', 1.0), ('ms', 1e-3)):
        if abs(seconds) >= size:
            return f'{seconds / size:.3g} {unit}'
    return f'{seconds * 1e6:.3g} us'
