"""The parameters of the beamforming map and of the free area."""

from dataclasses import dataclass

from polymap_ros.errors import ParameterError
from polymap_ros.specification import Group, parameter

MOST_RANGES = 1 << 18
"""Ranges of an echo, of which a hundred are kept: 200 MB."""

MOST_CELLS = 2e7
"""Of the beamforming map, which takes 12 bytes for each, and again where a twin is solved or saved."""

MOST_FREE_CELLS = 5e7
"""Of the grid of the free area, 24 bytes each while a ping is drawn."""


@dataclass(frozen=True)
class GridParameters(Group):
    """The beamforming map's axes (r, theta) and the range axis of the envelopes."""

    PREFIX = 'grid.'
    range_max_m: float = parameter(3.0, 'end of the range axis', unit='m', minimum=1e-3, maximum=1e5)
    range_step_m: float = parameter(0.005, 'step of the range axis', unit='m', minimum=1e-6, maximum=1e4)
    angle_step_deg: float = parameter(1.0, 'step of the angle axis', unit='deg', minimum=1e-3, maximum=90.0)
    angle_min_deg: float = parameter(0.0, 'start of the angle axis', unit='deg', minimum=-360.0, maximum=360.0)
    angle_max_deg: float = parameter(360.0, 'end of the angle axis, exclusive', unit='deg',
                                     minimum=-360.0, maximum=720.0)

    def check(self) -> None:
        if self.range_step_m > self.range_max_m / 2:
            raise ParameterError('grid.range_step_m',
                                 f'{self.range_step_m!r} leaves fewer than three ranges up to grid.range_max_m '
                                 f'({self.range_max_m!r})')
        span = self.angle_max_deg - self.angle_min_deg
        if not 0.0 < span <= 360.0:
            raise ParameterError('grid.angle_max_deg', f'{self.angle_max_deg!r} is not above grid.angle_min_deg '
                                 f'({self.angle_min_deg!r}) by at most 360')
        ranges = self.range_max_m / self.range_step_m
        if ranges > MOST_RANGES:
            raise ParameterError('grid.range_step_m', f'{self.range_step_m!r} makes {ranges:.3g} ranges up to '
                                 f'grid.range_max_m ({self.range_max_m!r}); allowed: up to {MOST_RANGES}')
        if (cells := ranges * span / self.angle_step_deg) > MOST_CELLS:
            raise ParameterError('grid.angle_step_deg', f'{self.angle_step_deg!r} makes a map of {cells:.3g} cells; '
                                 f'allowed: up to {MOST_CELLS:.0e}')


@dataclass(frozen=True)
class FreeAreaParameters(Group):
    """The area that no wall crosses, from the closest range of every ping."""

    PREFIX = 'free_area.'
    model: str = parameter('discs', 'union of a disc per ping, or a grid of probabilities, which a few wrong ranges do '
                           'not spoil', choices=('discs', 'grid'))
    false_alarm: float = parameter(
        0.0, 'share of the pings without echoes in which noise may be taken for the first one; 0: an echo is a peak of '
        '0.3 of the strongest one', minimum=0.0, maximum=0.5)
    missed: float = parameter(0.2, "share of the first echoes that are not heard, which makes ranges too long (grid)",
                              minimum=1e-6, maximum=0.9)
    cell_m: float = parameter(0.0, 'size of a cell; 0: twice grid.range_step_m (grid)', unit='m', minimum=0.0,
                              maximum=1e4)

    def check(self) -> None:
        if 0.0 < self.false_alarm < 1e-12:
            raise ParameterError('free_area.false_alarm', f'{self.false_alarm!r} is never reached by noise; allowed: '
                                 '0, or at least 1e-12')
