"""How much the odometry errs, by the positions that the echoes tell: the errors of wheels, or of each place by itself.

Positions are known to a tenth of a millimetre, headings are free. Of some sizes of both kinds of errors those are taken
under which the increments are likeliest, with the headings integrated out about their best (Laplace's approximation).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.odometry import MEDIAN_OF_TWO, Increments, OdometryNoise

_TIMES = 1.0, 1.5, 2.0, 3.0, 4.5
"""Sizes of the wheels' errors that are tried, over those assumed: less is not believed."""

_PLACES_M = 0.0, 5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 16e-3
"""Errors of each place by itself that are tried [m], as of an optical system, or of a grid of positions."""

_ENOUGH = 8
"""Poses from which sizes are told."""

_STEPS = 4
"""Steps to the best headings."""

_LIKELIER = 3.0
"""Nats that another size has to bring."""


def odometry_found(
    reported: NDArray[np.float64], way: NDArray[np.float64], assumed: OdometryNoise, poses: NDArray[np.float64]
) -> OdometryNoise:
    """Return the noise of odometry that reports poses (N, 3) with the way (N, SUMS) up to each, given where they were.

    As assumed, where nothing is clearly likelier, or more than half of the increments are within that.
    """
    if len(poses) < _ENOUGH or np.median(Increments.of(reported, way, assumed).squares(poses)) < MEDIAN_OF_TWO:
        return assumed
    tried = [replace(assumed.times(times), place=place) for times in _TIMES for place in _PLACES_M]
    evidence = [evidence_of(Increments.of(reported, way, noise), poses) for noise in tried]
    best = int(np.argmax(evidence))
    return tried[best] if evidence[best] > evidence[0] + _LIKELIER else assumed


def evidence_of(odometry: Increments, poses: NDArray[np.float64]) -> float:
    """Return the log density of increments at positions, whatever the headings, but for a constant."""
    poses = poses.copy()
    for _ in range(_STEPS):
        gradient, information = odometry.derivatives(poses)
        turn = np.linalg.solve(information[2::3, 2::3], gradient[2::3])
        poses[:, 2] += np.clip(turn, -0.3, 0.3)
    _, spread = np.linalg.slogdet(odometry.derivatives(poses)[1][2::3, 2::3])
    _, sizes = np.linalg.slogdet(odometry.covariance)
    return odometry.log_prior(poses) - 0.5 * float(spread) - 0.5 * float(np.sum(sizes))
