"""How well a wall is known in the frame of the first pose where nothing but the odometry says where it was heard."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polymap_ros.hearing.sounding import Sounding
from polymap_ros.solvers.estimate import Edge
from polymap_ros.solvers.evidence.odometry import turns
from polymap_ros.solvers.evidence.tracking import Chain


def as_dead_reckoned(wall: Edge, heard: Sequence[Sounding], chain: Chain, width_m: float) -> Edge:
    """Return a wall with the deviations of the pose from which its echo was first heard added to its own.

    Parameters
    ----------
    wall : Edge
        Proven by first echoes.
    heard : sequence of Sounding
        The pings, in the order of time.
    chain : Chain
        What the odometry says of them.
    width_m : float
        Width of the pulse [m], to half of which a first echo is the wall's.
    """
    normal = np.array([np.cos(wall.theta), np.sin(wall.theta)])
    away = np.array([wall.r - normal @ (each.x, each.y) - each.rho for each in heard])
    touched = np.flatnonzero(np.abs(away) < 0.5 * width_m)
    first = int(touched[0]) if len(touched) else int(np.nanargmin(np.abs(away)))
    covariance = dead_reckoned(chain, first)
    x, y, _ = chain.poses[first]
    # A pose that is off takes the wall with it: r by the shift along its normal and by the turn about the pose.
    by_pose = np.array([[*normal, normal[0] * y - normal[1] * x], [0.0, 0.0, 1.0]])
    added = by_pose @ covariance @ by_pose.T
    r_std, theta_std = (float(np.hypot(own or 0.0, np.sqrt(more)))
                        for own, more in zip((wall.r_std, wall.theta_std), np.diag(added), strict=True))
    return dataclasses.replace(
        wall, r_std=r_std, theta_std=theta_std, r_theta_covariance=wall.r_theta_covariance + float(added[0, 1]))


def dead_reckoned(chain: Chain, ping: int) -> NDArray[np.float64]:
    """Return the covariance (3, 3) of a ping's pose by the odometry from the first one on."""
    turn, = turns(chain.poses[:1, 2])
    return np.asarray(turn @ chain.between(np.array([0, ping])).covariance[0] @ turn.T)
