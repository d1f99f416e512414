"""What every solver is given, and what it offers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import Caution
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.pulse_shape import PulseShape
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.maps.free_area import FreeArea
from polymap_ros.maps.visited import Places
from polymap_ros.solvers.checkpoint import Checkpoint, unwatched
from polymap_ros.solvers.estimate import Estimate


class Outline(NamedTuple):
    """An outline that is known before: vertices (n, 2) [m], and where the start frame is in its frame."""

    vertices: NDArray[np.float64]
    start: Pose


class Expected(NamedTuple):
    """What somebody says of the place: what corrects the odometry in the start frame, and how well that is known [m],
    [rad] (standard deviations)."""

    correction: Pose
    place_m: float
    heading_rad: float


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that a solver may look at, in the start frame.

    Parameters
    ----------
    soundings : sequence of Sounding
        The pings whose echoes are kept.
    beam_map, free_area
        Of all pings.
    pulse : PulseShape, optional
        What an echo looks like.
    places : Places, optional
        Where all pings were used; where not given, those of the soundings are all.
    outline : Outline, optional
        The outline in which the robot is, where that is known and only the poses are looked for.
    cautions : tuple of Caution
        What the samples tell by themselves.
    """

    soundings: Sequence[Sounding]
    beam_map: BeamformingMap
    free_area: FreeArea
    pulse: PulseShape | None = None
    places: Places | None = None
    outline: Outline | None = None
    cautions: tuple[Caution, ...] = ()

    @property
    def heard(self) -> list[Sounding]:
        """The soundings that have echoes."""
        return [sounding for sounding in self.soundings if sounding.echo.size]

    @property
    def all_places(self) -> Places:
        """Where all pings were used."""
        if self.places is not None:
            return self.places
        places = Places()
        for sounding in self.soundings:
            places.add(sounding.stamp_ns, sounding.x, sounding.y)
        return places


class Solver(Protocol):
    """A way from the evidence to an estimate. A solver may keep its last answer to start the next solve from."""

    def solve(self, evidence: Evidence, checkpoint: Checkpoint = unwatched) -> Estimate:
        """Return the answer in the start frame; later changes of the evidence do not touch it.

        The checkpoint is called between the steps of the work.
        """
