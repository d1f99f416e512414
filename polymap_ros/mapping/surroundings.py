"""What was heard, from where the pings are thought to have been heard: map, free area and path."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.maps.free_area import FreeArea
from polymap_ros.maps.free_grid import make_free_area
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.estimate import Trajectory


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Map, free area and the sensor's positions (n, 2) [m], all in the start frame."""

    beam_map: BeamformingMap
    free_area: FreeArea
    positions: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))

    @classmethod
    def empty(cls, parameters: Parameters) -> 'Surroundings':
        """Return those of which nothing was heard."""
        area, step_m = parameters.free_area, parameters.grid.range_step_m
        return cls(BeamformingMap(parameters.grid),
                   make_free_area(area.model, area.cell_m or 2.0 * step_m, area.missed))

    def copy(self) -> 'Surroundings':
        """Return the same, to go on from apart."""
        return Surroundings(self.beam_map.copy(), self.free_area.copy(), self.positions)

    def hear(
        self, place: Pose, envelope: NDArray[np.float32], rho: float, confidence: float, baseline_m: float
    ) -> None:
        """Add what a ping from a place of the sensor has heard."""
        self.beam_map.add(place.x, place.y, envelope)  # eq. (4)
        # A_T; no wall cuts the ellipse about emitter and receiver, whose smaller half axis this is.
        clear_m = sqrt(max(rho**2 - (0.5 * baseline_m) ** 2, 0.0))
        self.free_area.add(place.x, place.y, clear_m, confidence)


def redrawn(
    path: Trajectory, soundings: Iterable[Sounding], positions: NDArray[np.float64], parameters: Parameters
) -> Surroundings:
    """Return what soundings that are not lost tell from the places that were estimated, in the start frame."""
    around = Surroundings.empty(parameters)
    stamped = {each.stamp_ns: each for each in soundings}
    for stamp_ns, pose, lost in zip(path.stamps_ns, path.poses.tolist(), path.lost, strict=True):
        if not lost:
            sounding = stamped[stamp_ns]
            around.hear(Pose(*pose).compose(sounding.mount), sounding.envelope, sounding.rho, sounding.confidence,
                        parameters.sensor.baseline_m)
    return Surroundings(around.beam_map, around.free_area, positions)
