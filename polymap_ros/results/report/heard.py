"""What a page shows beside the answer: the path, the start and the beamforming map."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper


@dataclass(frozen=True, eq=False)
class Survey:
    """What a mapper holds that polygon.json does not.

    Parameters
    ----------
    path : ndarray, shape (n, 2)
        Positions of the sensor at the pings [m], in the frame of the answer.
    start : Pose or None
        The start frame in that frame; None where no ping was used.
    likelihood : ndarray, shape (n_theta, n_r)
        The beamforming map of eq. (4) divided by its maximum, in the start frame.
    theta_rad, r_m : ndarray
        Its axes.
    truth : ndarray, shape (n, 2), optional
        Corners of the true polygon [m], in the frame of the answer.
    drop_texts : mapping, optional
        Last sentence of each reason for which pings were dropped.
    """

    path: NDArray[np.float64]
    start: Pose | None
    likelihood: NDArray[np.float32]
    theta_rad: NDArray[np.float64]
    r_m: NDArray[np.float64]
    truth: NDArray[np.float64] | None = None
    drop_texts: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, mapper: PolygonMapper, truth: NDArray[np.float64] | None = None) -> 'Survey':
        """Take what a mapper holds."""
        heard, start = mapper.surroundings, mapper.start_pose
        beam_map, path = heard.beam_map, start.apply(heard.positions) if start else np.zeros((0, 2))
        return cls(path, start, beam_map.normalised(), beam_map.theta_rad, beam_map.r_m, truth,
                   dict(mapper.intake.last_drop_texts))
