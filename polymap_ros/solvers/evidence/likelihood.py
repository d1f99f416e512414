"""What a likelihood of the echoes offers to the search: its value at given walls, and its derivatives ping by ping.

A likelihood is a function of walls, of what it takes for known of the device (a strength, a phase), and of nothing
else: it returns what it found and leaves nothing behind. `power` and `waveform` are two; another needs this much.
"""

from dataclasses import dataclass, field
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.data import EchoData

_LEAST_KNOWN = 1e-3
"""Share of the information about the walls that the device's phase leaves at least."""

_RIDGE = 1e-9
"""Relative ridge of the information, so that what nothing tells does not move. With 1e-6 walls and all positions of a
path, which echoes hold together a million times better than odometry tells how they lie about the first pose, would
seem to be known a tenth as badly to turn, and hardly turn."""

_PHASE_RIDGE = 1e-6
"""Relative ridge of the information about phases."""


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of a log likelihood by the block of the walls, ping by ping, without the prior.

    Parameters
    ----------
    scores : ndarray, shape (N, 3 n)
        Gradient of each ping's share.
    information : ndarray, shape (N, 3 n, 3 n)
        Its Fisher information, what a ping has of its own (such as an amplitude) marginalised.
    by_phase : ndarray, shape (N, 3 n, q)
        Its information between the walls and the phases, the device's and those of `edge_phase`; q = 0 without phase.
    phase : ndarray, shape (N, q, q)
        Its information about those.
    by_edge : ndarray, shape (N, q - 1)
        Its gradient by those of `edge_phase`; the device's is at its best.
    """

    scores: NDArray[np.float64]
    information: NDArray[np.float64]
    by_phase: NDArray[np.float64]
    phase: NDArray[np.float64]
    by_edge: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 0)))


class Unknowns(Protocol):
    """What a climb is about: numbers (k,) in blocks, with what is known of them before.

    `Walls` are one, `World` another, of walls and poses.
    """

    @property
    def quiet(self) -> NDArray[np.bool_]:
        """Which numbers (k,) nothing is heard of."""

    def moved(self, step: NDArray[np.float64]) -> Self:
        """Return the same after a step (k,)."""

    def limited(self, step: NDArray[np.float64], r_m: float, theta_rad: float) -> NDArray[np.float64]:
        """Return a step (k,) that moves no line by more than this."""

    def held(self, gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which numbers (k,) stay."""

    def gradient(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the gradient (k,) of a log likelihood with the prior."""

    def information(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the Fisher information (k, k) with the prior."""

    def by_phase(self, slopes: Slopes) -> NDArray[np.float64]:
        """Return the information (k, q) between the numbers and the phases."""


class Support(Protocol):
    """Unknowns, and what a likelihood says of them.

    Attributes
    ----------
    unknowns : Unknowns
        Where it was asked for.
    value : float
        Log likelihood ratio against noise alone, with the log prior of the unknowns.
    slopes : Slopes or None
        Its derivatives, if they were asked for.
    """

    @property
    def unknowns(self) -> Any: ...
    @property
    def value(self) -> float: ...
    @property
    def slopes(self) -> Slopes | None: ...

    def with_slopes(self, slopes: Slopes | None) -> Self:
        """Return the same with these derivatives."""


S = TypeVar('S', bound=Support)


class Likelihood(Protocol[S]):
    """A log likelihood of the echoes of `data`.

    Attributes
    ----------
    data : EchoData
        The pings.
    damping : float
        Share of the information's diagonal that is added to it for a step: 0 where the information is exact.
    derives_at_once : bool
        Whether derivatives cost little more than the value.
    """

    data: EchoData
    damping: float
    derives_at_once: bool

    def evaluate(self, unknowns: Any, like: S, order: int, derive: bool = False) -> S | None:
        """Return the value at `unknowns`, where echoes up to an order count; None where they are no outline.

        What is known of the device is taken from `like`, or begun there.
        """


def gradient_of(support: Support) -> NDArray[np.float64]:
    """Return the gradient (k,) of a log likelihood with the prior; what is not heard is held fast."""
    assert support.slopes is not None, 'derivatives were asked for'
    return np.where(support.unknowns.quiet, 0.0, support.unknowns.gradient(support.slopes))


def information_of(support: Support) -> NDArray[np.float64]:
    """Return the Fisher information (k, k) with the prior, the phases marginalised.

    Without that, walls that all move by the same r would seem to change little, and the steps be far too short.
    """
    slopes, unknowns = support.slopes, support.unknowns
    assert slopes is not None, 'derivatives were asked for'
    information = unknowns.information(slopes)
    diagonal = np.arange(len(information))
    quiet = unknowns.quiet | (information[diagonal, diagonal] <= 0.0)
    information[quiet], information[:, quiet] = 0.0, 0.0
    information[quiet, quiet] = 1.0
    information[diagonal, diagonal] *= 1.0 + _RIDGE
    phase = slopes.phase.sum(axis=0)
    if phase.size and phase[0, 0] > 0.0:
        cross = np.where(quiet[:, None], 0.0, unknowns.by_phase(slopes))
        own = _whitened(phase, cross.T)
        # Where the echoes fit badly, the cross term may claim more than the walls know; they keep a little of it.
        taken = float(np.linalg.eigvalsh(own @ np.linalg.solve(information, own.T))[-1])
        information -= own.T @ own / max(1.0, taken / (1.0 - _LEAST_KNOWN))
    return np.asarray(information)


def _whitened(phase: NDArray[np.float64], cross: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the phases (m, m) and the rest share (m, k), in directions of the phases that are known by 1 each.

    Where the echoes do not tell phases apart, as where all bounce alike, their information is singular. One that they
    do not tell at all shares nothing.
    """
    told = np.maximum(np.diag(phase), 0.0)
    scale = np.divide(1.0, np.sqrt(told), out=np.zeros(len(told)), where=told > _PHASE_RIDGE * told.max())
    known, directions = np.linalg.eigh(phase * np.outer(scale, scale))
    return np.asarray((directions / np.sqrt(np.maximum(known, 0.0) + _PHASE_RIDGE)).T @ (scale[:, None] * cross))


def covariance_of(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse (k, k) of an information.

    It is scaled to a diagonal of 1, so that the ridge is relative: what the pings cannot tell has a large error, not
    none.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    outer = np.outer(scale, scale)
    return np.asarray(np.linalg.inv(information * outer + 1e-9 * np.eye(len(scale))) * outer)
