r"""What every reflection does to the phase: a delay by the angle of incidence, common to all walls, and each's own.

A wall's coefficient is rho exp(-j D), rho real and signed, and

    D_w(s) = D_0(s) + p_0 + p_1 s^2 + p_2 s^4 + q_w,   s the sine of the angle of incidence,

D_0 a law that is known, such as that of a plate's free edge, and p and q what is found, q with the walls (`Walls`). A
phase that is constant is not a free edge's, which goes from 90 deg to 35 deg at s = 0.8; with its law, p mends what is
not known of the plate.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.plate_edge import free_edge_delay, poisson_ratio
from polymap_ros.parameters import MediumParameters

COMMON = 3
"""Numbers p."""

_ROWS = 129
"""Cosines at which a law is tabulated: linear between them it is right to 1e-4 rad."""

_COMMON_DEVIATIONS = 1.0, 0.5, 0.5
"""Prior standard deviations of p [rad]."""

_PINNED_DEVIATION = 1e-3
"""That of p_0 where it is known."""

_OWN_DEVIATION = 0.5
"""That of q [rad]: coatings and mixed edges, within 60 deg."""


@dataclass(frozen=True, eq=False)
class EdgePhase:
    """What is common to all walls of D, as a function of the cosine of the angle of incidence.

    Parameters
    ----------
    law : ndarray, shape (m,)
        D_0 at cosines from 0 to 1, evenly spaced [rad]; empty where nothing turns the phase.
    found : ndarray, shape (3,)
        p [rad].
    free, by_wall : bool
        Whether p is looked for, and with it q.
    pinned : bool
        Whether p_0 is known to be 0. Where the pulse is found with the walls it has to be: a degree more and a pulse
        that is as much earlier move all walls by 0.025 mm (100 kHz, 6 mm aluminium), and leave hardly anything.
    """

    law: NDArray[np.float64]
    found: NDArray[np.float64]
    free: bool = False
    by_wall: bool = False
    pinned: bool = False

    @classmethod
    def of(cls, law: NDArray[np.float64] | float) -> 'EdgePhase':
        """Return a law (m,), or one delay [rad] at all angles, of which nothing is looked for."""
        return cls(np.broadcast_to(np.asarray(law, float), (_ROWS,)), np.zeros(COMMON))

    @cached_property
    def table(self) -> NDArray[np.float64]:
        """D_0 and p's part of D at the cosines of the law; empty where there is none."""
        if not len(self.law):
            return self.law
        s2 = 1.0 - cosines() ** 2
        return np.asarray(self.law + self.found[0] + self.found[1] * s2 + self.found[2] * s2**2)

    @property
    def head_on(self) -> float:
        """D at normal incidence, but for q."""
        return float(self.table[-1]) if len(self.law) else 0.0

    def freed(self, by_wall: bool = False) -> 'EdgePhase':
        """Return the same with p, or p and q, to be found."""
        law = self if len(self.law) else EdgePhase.of(0.0)
        return replace(law, free=True, by_wall=by_wall, pinned=self.pinned)

    def as_pinned(self) -> 'EdgePhase':
        """Return the same with p_0 known."""
        return replace(self, pinned=True)

    def held(self) -> 'EdgePhase':
        """Return the same with nothing to be found."""
        return replace(self, free=False, by_wall=False)

    def own(self, delay: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the part (n,) of the walls' `delay` that counts: all of it, or nothing."""
        return delay if self.by_wall else delay[:0]

    def sought(self, delay: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what is looked for [rad]: p, and q where that is."""
        return np.concatenate((self.found, self.own(delay))) if self.free else np.empty(0)

    def precision(self, walls: int) -> NDArray[np.float64]:
        """Return the prior precision of that [1 / rad^2]."""
        head_on = _PINNED_DEVIATION if self.pinned else _COMMON_DEVIATIONS[0]
        own = np.full(walls if self.by_wall else 0, _OWN_DEVIATION)
        deviations = np.concatenate(((head_on,), _COMMON_DEVIATIONS[1:], own))
        return np.asarray(deviations ** -2.0) if self.free else np.empty(0)

    def log_prior(self, delay: NDArray[np.float64]) -> float:
        """Return the log prior of what is looked for."""
        return -0.5 * float(self.precision(len(delay)) @ self.sought(delay) ** 2)


def cosines() -> NDArray[np.float64]:
    """Cosines (m,) at which laws are tabulated."""
    return np.linspace(0.0, 1.0, _ROWS)


REAL = EdgePhase(np.empty(0), np.zeros(COMMON))
"""No delay: coefficients are real, as in the paper."""


def laws(medium: MediumParameters) -> tuple[EdgePhase, ...]:
    """Return the laws that are tried, in this order, the next ones where the first leaves much unexplained."""
    if medium.edge == 'real':
        return REAL,
    quarters = EdgePhase.of(0.5 * np.pi), EdgePhase.of(-0.5 * np.pi)
    if medium.model != 'lamb_a0':
        return REAL, *quarters
    free = EdgePhase.of(free_edge_delay(cosines(), poisson_ratio(medium)))
    return (free,) if medium.edge == 'free' else (REAL, free, *quarters)
