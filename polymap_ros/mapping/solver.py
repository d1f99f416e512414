"""What every solver offers: a solve that is begun, advanced in slices and read."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from polymap_ros.mapping.beamforming import BeamformingMap
from polymap_ros.mapping.estimate import Estimate
from polymap_ros.mapping.free_area import FreeArea
from polymap_ros.mapping.places import Places
from polymap_ros.mapping.pulse_shape import PulseShape
from polymap_ros.mapping.sounding import Sounding


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
    """

    soundings: Sequence[Sounding]
    beam_map: BeamformingMap
    free_area: FreeArea
    pulse: PulseShape | None = None
    places: Places | None = None

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
    """One solve: `begin` on a snapshot of the evidence, `advance` until it answers True, then `estimate`.

    A solver may keep its last answer to start the next solve from; `reset` forgets it.
    """

    def begin(self, evidence: Evidence) -> None:
        """Start a solve; later changes of the evidence do not touch it."""

    def advance(self, iterations: int) -> bool:
        """Run up to `iterations` more iterations; True when the solve is finished."""

    def estimate(self) -> Estimate:
        """The answer so far, in the start frame."""

    def reset(self) -> None:
        """Forget everything kept from earlier solves."""
