"""Time and memory over what may grow: pings, samples, cells of the grid, lines of the annealing."""

import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from polymap_ros.evaluation.speed_experiment import Drive
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters

SAMPLES = 1024, 2048, 4096, 8192, 16384, 32768
STEPS_M = 0.02, 0.01, 0.005, 0.0025
LINES = 5, 10, 20, 40
SIZES = [100 * 10**k for k in range(8)]
FEW, MANY = 10, 200
"""Pings that warm a mapper up, and that are measured."""


@dataclass(frozen=True)
class Growth:
    """What one more costs at one size.

    Parameters
    ----------
    over, per : str
        What grows, and what the time is of.
    size : int
        How much of it there is.
    seconds : float
        CPU time [s].
    memory_mb : float
        What the mapper holds [MB], as traced.
    """

    over: str
    size: int
    per: str
    seconds: float
    memory_mb: float

    def row(self) -> dict[str, object]:
        """Cells of results.csv."""
        return dict(vars(self))


def growth(parameters: Parameters, most_pings: int) -> Iterator[Growth]:
    """All tables, row by row; memory is traced meanwhile, which makes everything slower alike.

    Parameters
    ----------
    parameters : Parameters
        Of the mapper.
    most_pings : int
        The pings grow from 100 to so many, tenfold each time but the last.
    """
    tracemalloc.start()
    try:
        yield from _over_pings(parameters, most_pings)
        for n_samples in SAMPLES:
            yield _of_a_ping('samples', n_samples, parameters, n_samples)
        for step_m in STEPS_M:
            finer = parameters.replaced({'grid.range_step_m': step_m, 'grid.angle_step_deg': step_m / 0.005})
            cells = round(parameters.grid.range_max_m / step_m) * round(360.0 * 0.005 / step_m)
            yield _of_a_ping('cells of the grid', cells, finer, 4096)
        yield from _over_lines(parameters)
    finally:
        tracemalloc.stop()


def _over_pings(parameters: Parameters, most: int) -> Iterator[Growth]:
    drive, before = _drive(parameters, 4096), 0
    for size in [*(size for size in SIZES if size < most), most]:
        drive.go(size - before - MANY // 4)
        seconds = _seconds(drive, MANY // 4)
        yield Growth('pings', size, 'ping', seconds, _held_mb())
        drive.mapper.solve()  # from scratch at first, which the next one is not
        yield Growth('pings', size, 'solve, warm', _seconds_of(drive.mapper.solve), _held_mb())
        before = size


def _of_a_ping(over: str, size: int, parameters: Parameters, n_samples: int) -> Growth:
    drive = _drive(parameters, n_samples)
    drive.go(FEW)
    return Growth(over, size, 'ping', _seconds(drive, MANY), _held_mb())


def _over_lines(parameters: Parameters) -> Iterator[Growth]:
    for lines in LINES:
        drive = _drive(parameters.replaced({'solver.method': 'paper', 'solver.max_edges': lines}), 4096)
        drive.go(60)
        drive.mapper.solve()  # what is loaded on first use
        yield Growth('lines K', lines, 'solve, method paper', _seconds_of(drive.mapper.solve), _held_mb())


def _drive(parameters: Parameters, n_samples: int) -> Drive:
    """Ready to go, with what was simulated for it not counted."""
    drive = Drive(parameters, n_samples)
    tracemalloc.clear_traces()
    drive.mapper = PolygonMapper(parameters)
    return drive


def _seconds(drive: Drive, pings: int) -> float:
    return _seconds_of(lambda: drive.go(pings)) / pings


def _seconds_of(work: Callable[[], object]) -> float:
    begun_s = time.process_time()
    work()
    return time.process_time() - begun_s


def _held_mb() -> float:
    return tracemalloc.get_traced_memory()[0] / 1e6


def growth_table(rows: Sequence[Growth]) -> str:
    """Markdown."""
    lines = ['| over | | time | of a | memory held |', '| --- | --- | --- | --- | --- |']
    lines += [f'| {row.over} | {row.size} | {row.seconds * 1e3:.3g} ms | {row.per} | {row.memory_mb:.2f} MB |'
              for row in rows]
    return '\n'.join(lines)
