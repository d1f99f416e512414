"""What the solvers on the beamforming map look at: a copy of the evidence at the moment a solve begins."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.overlap import Region
from polymap_ros.solvers.solver import Evidence


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Map, free area and path, in the start frame.

    Parameters
    ----------
    likelihood : ndarray, shape (n_theta, n_r), float32
        The map of eq. (4) divided by its maximum.
    r_m : ndarray, shape (n_r,)
        Range axis [m].
    theta_rad : ndarray, shape (n_theta,)
        Angle axis [rad].
    full_circle : bool
        Whether the angle axis closes upon itself.
    region : Region
        The free area A_T.
    positions : ndarray, shape (T, 2)
        The sensor's positions [m].
    stamp_ns : int
        Stamp of the last ping [ns].
    pings : ndarray, shape (T,)
        How many pings each of the positions stands for.
    """

    likelihood: NDArray[np.float32]
    r_m: NDArray[np.float64]
    theta_rad: NDArray[np.float64]
    full_circle: bool
    region: Region
    positions: NDArray[np.float64]
    stamp_ns: int
    pings: NDArray[np.int64]

    @classmethod
    def of(cls, evidence: Evidence) -> 'Snapshot':
        """Copy what may still change."""
        places, beam_map = evidence.all_places, evidence.beam_map
        return cls(
            likelihood=beam_map.normalised(), r_m=beam_map.r_m, theta_rad=beam_map.theta_rad,
            full_circle=beam_map.full_circle, region=evidence.free_area.region,
            positions=places.positions, stamp_ns=places.last_ns, pings=places.pings,
        )
