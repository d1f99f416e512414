"""Lines of other machines that were taken out of the pings: which ones, and of how many."""

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
    """

    pings: int = 0
    frequency_hz: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    counts: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def taken(self, lines_hz: tuple[float, ...]) -> 'NoiseLines':
        """With one ping more, out of which these lines were taken."""
        frequency, counts = self.frequency_hz.copy(), self.counts.copy()
        for line_hz in lines_hz:
            same = np.flatnonzero(np.abs(frequency - line_hz) < _SAME_MACHINE * line_hz)
            if len(same):
                counts[same[0]] += 1.0
                frequency[same[0]] += (line_hz - frequency[same[0]]) / counts[same[0]]
            else:
                frequency, counts = np.append(frequency, line_hz), np.append(counts, 1.0)
        order = np.argsort(-counts, kind='stable')[:_MOST_KEPT]
        return NoiseLines(self.pings + 1, frequency[order], counts[order])

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
        if not told:
            return ()
        lines = ', '.join(f'{hz:.4g} Hz in {count}' for hz, count in told)
        return (Caution('noise_line', f'beside the echoes {self.pings} pings hold {lines} of them, from another '
                        'machine, which is taken out'),)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        return {'pings': np.array(self.pings), 'frequency_hz': self.frequency_hz, 'counts': self.counts}

    @classmethod
    def restored(cls, state: dict[str, NDArray[np.generic]]) -> 'NoiseLines':
        """Return what `state` was made of."""
        found = cls(int(state['pings']), *(np.asarray(state[name], float) for name in ('frequency_hz', 'counts')))
        frequency, counts = found.frequency_hz, found.counts
        rows = frequency.ndim == 1 and frequency.shape == counts.shape and len(counts) <= _MOST_KEPT
        if not (found.pings >= 0 and rows and np.all(
                (frequency > 0.0) & np.isfinite(frequency) & (counts >= 1.0) & (counts < 2.0**53))):
            raise StateError('the lines of the state are not those of pings')
        return found
