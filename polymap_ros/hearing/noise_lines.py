"""Lines and impulses of other machines that were taken out of the pings: which ones, and of how many."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import Caution
from polymap_ros.errors import StateError

_OF_PINGS = 0.1
"""Of the pings: a line in fewer of them was chance, or passed by, and need not be told."""

_CHANCE_PINGS = 2.0
"""Pings in which echoes may have looked like one."""

_SAME_MACHINE = 0.02
"""Relative difference of frequencies up to which they are of one machine, whose speed is not a standard."""

_MOST_KEPT = 32
"""Lines that are kept, the commonest ones."""


@dataclass(frozen=True, eq=False)
class NoiseLines:
    """What is known of them so far.

    Parameters
    ----------
    pings : int
        How many were looked at.
    frequency_hz, counts : ndarray, shape (k,)
        Mean frequency of each line, and of how many pings it was taken out.
    struck_pings : int
        How many held impulses.
    struck : float
        Sum over these of the share of samples that was interpolated.
    """

    pings: int = 0
    frequency_hz: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    counts: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    struck_pings: int = 0
    struck: float = 0.0

    def taken(self, lines_hz: tuple[float, ...], struck: float = 0.0) -> 'NoiseLines':
        """With one ping more, out of which these lines were taken, and impulses on that share of its samples."""
        frequency, counts = self.frequency_hz.copy(), self.counts.copy()
        for line_hz in lines_hz:
            same = np.flatnonzero(np.abs(frequency - line_hz) < _SAME_MACHINE * line_hz)
            if len(same):
                counts[same[0]] += 1.0
                frequency[same[0]] += (line_hz - frequency[same[0]]) / counts[same[0]]
            else:
                frequency, counts = np.append(frequency, line_hz), np.append(counts, 1.0)
        order = np.argsort(-counts, kind='stable')[:_MOST_KEPT]
        return NoiseLines(self.pings + 1, frequency[order], counts[order],
                          self.struck_pings + (struck > 0.0), self.struck + struck)

    @property
    def known_hz(self) -> list[float]:
        """Lines that are no chance."""
        return [float(hz) for hz in self.frequency_hz[self.counts > max(_OF_PINGS * self.pings, _CHANCE_PINGS)]]

    @property
    def cautions(self) -> tuple[Caution, ...]:
        """What the user should know of it."""
        known = set(self.known_hz)
        told = sorted((hz, int(count)) for hz, count in zip(self.frequency_hz.tolist(), self.counts, strict=True)
                      if hz in known)
        found = []
        if told:
            lines = ', '.join(f'{hz:.4g} Hz in {count}' for hz, count in told)
            found.append(Caution('noise_line', f'beside the echoes {self.pings} pings hold {lines} of them, from '
                                 'another machine, which is taken out'))
        if self.struck_pings > max(_OF_PINGS * self.pings, _CHANCE_PINGS):
            found.append(Caution('impulses', f'{self.struck_pings} of {self.pings} pings hold impulses, on '
                                 f'{self.struck / self.struck_pings:.2%} of their samples, which are interpolated'))
        return tuple(found)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {'pings': np.array(self.pings), 'frequency_hz': self.frequency_hz, 'counts': self.counts,
                'struck': np.array((self.struck_pings, self.struck), dtype=float)}

    @classmethod
    def restored(cls, state: dict[str, NDArray[np.generic]]) -> 'NoiseLines':
        """Return what `state` was made of."""
        frequency, counts, struck = (np.asarray(state[name], float) for name in ('frequency_hz', 'counts', 'struck'))
        if struck.shape != (2,) or not (np.all(struck >= 0.0) and np.all(struck < 2.0**53)):
            raise StateError('the impulses of the state are not those of pings')
        found = cls(int(state['pings']), frequency, counts, int(struck[0]), float(struck[1]))
        rows = frequency.ndim == 1 and frequency.shape == counts.shape and len(counts) <= _MOST_KEPT
        if not (found.pings >= 0 and rows and np.all(
                (frequency > 0.0) & np.isfinite(frequency) & (counts >= 1.0) & (counts < 2.0**53))):
            raise StateError('the lines of the state are not those of pings')
        return found
