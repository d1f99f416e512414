"""How far pings are from each other, and how far each of them hears."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from polymap_ros.hearing.pulse_shape import PulseShape
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.maps.visited import Places
from polymap_ros.solvers.solver import Evidence

_ALONE = 2.0
"""Times the range that is listened to which lie between a ping and the nearest other one: no place is heard by two."""


def apart_m(places: Places) -> float:
    """Median distance from a place to the nearest other one [m]; 0 where places are shared."""
    if len(places.positions) < 2 or np.any(places.pings > 1):
        return 0.0
    distance, _ = cKDTree(places.positions).query(places.positions, 2)
    return float(np.median(distance[:, 1]))


def reach_m(heard: Sequence[Sounding], pulse: PulseShape) -> float:
    """The farthest range that is listened to [m]."""
    return pulse.step_m * max((len(sounding.echo) for sounding in heard), default=0)


def too_far_apart(evidence: Evidence) -> bool:
    """Return whether most pings are so far from all others that they hear no place that another one hears."""
    assert evidence.pulse is not None, 'the mapper knows its pulse'
    return apart_m(evidence.all_places) > _ALONE * reach_m(evidence.heard, evidence.pulse)
