"""A medium in which waves get faster while the robot drives, or are faster in one direction, and echoes heard in it.

With the wavenumber k (1 - e cos 2(phi - phi0)) of a way in the direction phi, a plane exists in which waves are as fast
in all directions, but for e^2: that in which all places are moved by the matrix 1 - E, E symmetric and without a trace.
There the law of reflection is the ordinary one. Walls are found there, and moved back. What is faster by a share at
one ping than at the first has an echo from nearer by that share: its range axis is drawn out.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.cautions import Caution
from polymap_ros.errors import StateError
from polymap_ros.geometry.lines import stretched_lines
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate
from polymap_ros.solvers.evidence import wording
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.snapshot import Snapshot

_MOST_ANISOTROPIC = 0.1
"""Share by which a saved state may say that waves differ in speed."""

_SECOND_NS = 1e9


@dataclass(frozen=True)
class UnevenMedium:
    """How a medium differs from the one that was given.

    Parameters
    ----------
    since_ns : int
        When it was the one that was given [ns]: at the first ping.
    per_s : float
        Share by which waves get faster in a second.
    along, across : float
        e cos 2 phi0 and e sin 2 phi0, phi0 from the x axis of the start frame.
    per_s_std, e_std : float
        Their deviations.
    """

    since_ns: int
    per_s: float = 0.0
    along: float = 0.0
    across: float = 0.0
    per_s_std: float = 0.0
    e_std: float = 0.0

    @property
    def stretch(self) -> NDArray[np.float64]:
        """Matrix (2, 2) to the plane in which waves are as fast in all directions."""
        return np.array([[1.0 - self.along, -self.across], [-self.across, 1.0 + self.along]])

    def faster(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the speed (N,) at pings over that of the medium that was given."""
        return np.asarray(1.0 + self.per_s * (stamps_ns - self.since_ns) / _SECOND_NS)

    def unevenness(self, stamps_ns: NDArray[np.int64]) -> float:
        """Return the greatest share by which waves are faster or slower than in an even medium."""
        return max(float(np.abs(self.faster(stamps_ns) - 1.0).max()), float(np.hypot(self.along, self.across)))

    def over(self, search: Search, stamps_ns: NDArray[np.int64]) -> Search:
        """Return the search over what is heard in this medium by pings at these times (N,) [ns]."""
        return search.over(self.heard(search.data, stamps_ns))

    def heard(self, data: EchoData, stamps_ns: NDArray[np.int64]) -> EchoData:
        """Return the same pings as they would be heard in an even medium, in its plane."""
        baselines = data.baselines.copy()
        baselines[:, :2] = baselines[:, :2] @ self.stretch
        other = dataclasses.replace(data, positions=np.ascontiguousarray(data.positions @ self.stretch),
                                    baselines=baselines)
        if self.per_s == 0.0:
            return other
        faster = self.faster(stamps_ns)
        ranges = data.pulse.step_m * np.arange(data.signal.shape[1])
        signal = np.array([np.interp(ranges / factor, ranges, ping.real) + 1j * np.interp(
            ranges / factor, ranges, ping.imag) for factor, ping in zip(faster, data.signal, strict=True)])
        # The carrier that was taken out was as drawn out.
        signal *= np.exp(2j * data.pulse.carrier * (1.0 / faster - 1.0)[:, None] * ranges)
        return dataclasses.replace(other, first_m=data.first_m * faster).with_signal(signal.astype(np.complex64))

    def seen(self, answer: Estimate, snapshot: Snapshot) -> Estimate:
        """Return an answer that was found in the even plane as it is in the true one."""
        back = np.asarray(np.linalg.inv(self.stretch), float)
        by_scale = float(np.hypot(self.e_std, self.per_s_std * (snapshot.stamp_ns - self.since_ns) / _SECOND_NS))
        polygon = answer.polygon and _moved(answer.polygon, back, by_scale)
        overlap = None if polygon is None else snapshot.region.iou(polygon.vertices, [])
        return dataclasses.replace(
            answer, polygon=polygon, cautions=(*answer.cautions, self._told(snapshot.stamp_ns, polygon)),
            iou_free_area=overlap, walls=tuple(_wall(edge, back, by_scale) for edge in answer.walls),
            alternatives=tuple(_moved(each, back, by_scale) for each in answer.alternatives))

    def _told(self, until_ns: int, polygon: Candidate | None) -> Caution:
        """What to know of a map in this medium."""
        seconds = (until_ns - self.since_ns) / _SECOND_NS
        fastest = 0.5 * float(np.arctan2(self.across, self.along))
        along_edge = polygon.edges[0].theta + 0.5 * np.pi if polygon else 0.0
        return wording.medium_uneven(
            (seconds * self.per_s, seconds * self.per_s_std), (float(np.hypot(self.along, self.across)), self.e_std),
            float(np.rad2deg(np.mod(fastest - along_edge, np.pi))))

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return all of it, as arrays."""
        return {'medium_since': np.array(self.since_ns),
                'medium_uneven': np.array(dataclasses.astuple(self)[1:])}

    @classmethod
    def restored(cls, state: Mapping[str, NDArray[np.generic]]) -> 'UnevenMedium | None':
        """Return what `state` was made of; None where there was none."""
        if 'medium_uneven' not in state:
            return None
        numbers = np.asarray(state['medium_uneven'], float)
        if numbers.shape != (5,) or not np.all(np.isfinite(numbers)) or np.hypot(*numbers[1:3]) > _MOST_ANISOTROPIC:
            raise StateError('the medium that was found is none')
        return cls(int(state['medium_since']), *numbers.tolist())


def _moved(polygon: Candidate, back: NDArray[np.float64], by_scale: float) -> Candidate:
    """Return a polygon whose places are moved by a matrix that is nearly 1, and are uncertain by a share, too."""
    covariance = polygon.covariance
    if covariance is not None:
        away = np.zeros(len(covariance))
        away[::2] = [edge.r for edge in polygon.edges]
        covariance = covariance + by_scale**2 * np.outer(away, away)
    edges = tuple(_wall(edge, back, by_scale) for edge in polygon.edges)
    return Candidate(polygon.vertices @ back.T, edges, covariance)


def _wall(edge: Edge, back: NDArray[np.float64], by_scale: float) -> Edge:
    """Return a wall whose places are moved so."""
    (r, theta), = stretched_lines(np.array([(edge.r, edge.theta)]), back).tolist()
    r_std = None if edge.r_std is None else float(np.hypot(edge.r_std, by_scale * edge.r))
    return dataclasses.replace(edge, r=r, theta=theta, r_std=r_std)
