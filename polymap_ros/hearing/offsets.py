"""Pings whose samples have an offset, as those of a converter without a sign, a floor, or a baseline that drifts."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.front_end import drifts, floor_of, has_offset
from polymap_ros.cautions import Caution
from polymap_ros.errors import StateError
from polymap_ros.parameters import Parameters

_SHARE = 0.1
"""Of the pings: fewer are glitches, of which the user need not know."""


@dataclass(frozen=True)
class Offsets:
    """What is known of the offsets so far.

    Parameters
    ----------
    pings, offset_pings : int
        How many were looked at, and how many had an offset, or as magnitudes a floor.
    mean, deviation : float
        Sums over the latter; of magnitudes the floor and the deviation above it.
    drifting_pings : int
        How many have a baseline that moves within the ping.
    """

    pings: int = 0
    offset_pings: int = 0
    mean: float = 0.0
    deviation: float = 0.0
    drifting_pings: int = 0

    def taken(self, samples: NDArray[np.floating], parameters: Parameters) -> 'Offsets':
        """With one ping more, unless what it may have is taken out anyway."""
        front_end, magnitudes = parameters.front_end, parameters.echo.kind == 'envelope'
        looked = dataclasses.replace(self, pings=self.pings + 1)
        if not magnitudes and not front_end.band_low_hz and drifts(samples):
            return dataclasses.replace(looked, drifting_pings=self.drifting_pings + 1)
        level = floor_of(samples) if magnitudes else float(samples.mean(dtype=float)) if has_offset(samples) else 0.0
        if front_end.remove_dc or not level:
            return looked
        return dataclasses.replace(looked, offset_pings=self.offset_pings + 1, mean=self.mean + level,
                                   deviation=self.deviation + float(samples.std(dtype=float)))

    @property
    def cautions(self) -> tuple[Caution, ...]:
        """What the user should know of it."""
        found = []
        if self.drifting_pings > _SHARE * self.pings:
            found.append(Caution('baseline_drift', f'the baseline of {self.drifting_pings} of {self.pings} pings moves '
                                 'within the ping by more than the echoes are strong'))
        if self.offset_pings > _SHARE * self.pings:
            mean, deviation = self.mean / self.offset_pings, self.deviation / self.offset_pings
            found.append(Caution('dc_offset', f'the samples of {self.offset_pings} of {self.pings} pings have an '
                                 f'offset, on average {mean:.4g} with a deviation of {deviation:.3g} about it, which '
                                 'is taken out'))
        return tuple(found)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {'sums': np.array(dataclasses.astuple(self), dtype=float)}

    @classmethod
    def restored(cls, state: dict[str, NDArray[np.generic]]) -> 'Offsets':
        """Return what `state` was made of."""
        sums = np.asarray(state['sums'], float)
        sums = np.append(sums, 0.0) if sums.shape == (4,) else sums  # of a version that did not look for drifts
        if sums.shape != (5,) or not np.all(np.isfinite(sums)) or not 0.0 <= max(sums[1], sums[4]) <= sums[0] < 2.0**53:
            raise StateError('the sums of the offsets are not those of pings')
        return cls(int(sums[0]), int(sums[1]), float(sums[2]), float(sums[3]), int(sums[4]))
