"""Pings without what all of them have in common, while the robot drives."""

import dataclasses
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.common_part import common_part, without_common
from polymap_ros.acoustics.ping import Ping
from polymap_ros.cautions import Caution, in_metres
from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.packed_pings import packed_pings, unpacked_pings

PlacedPing: TypeAlias = tuple[Ping, Pose]

LEAST_PINGS = 8
"""From fewer pings nothing is known to be in common."""

_PATIENCE = 4
"""Pings wait until there are this many times as many as asked for, and are then taken as they are."""


class CommonRemoval:
    """Finds what is in common from pings at places far enough apart, and takes it out of all.

    A wall that the robot drives along is in common, too, as long as it does. So nothing is taken out until the places
    spread by more than the pulse's length in every direction; until then, and until there are as many pings as asked
    for, pings wait. Of more pings than asked for, one of the two that are closest to each other gives way.

    Parameters
    ----------
    pings : int
        So many are compared; 0: all pings pass at once, as they are.
    pulse_s : float
        Duration of the pulse [s].
    pulse_m : float
        The range that it takes up [m].
    """

    def __init__(self, pings: int, pulse_s: float, pulse_m: float) -> None:
        self._size, self._pulse_s, self._pulse_m = pings, pulse_s, pulse_m
        self._waiting: list[PlacedPing] = []
        self._compared: list[PlacedPing] = []
        self._open = pings == 0
        self._common: NDArray[np.float64] | None = None

    def copy(self) -> 'CommonRemoval':
        """One of its own in the same state."""
        twin = CommonRemoval(self._size, self._pulse_s, self._pulse_m)
        twin._waiting, twin._compared = list(self._waiting), list(self._compared)
        twin._open, twin._common = self._open, self._common
        return twin

    @property
    def cautions(self) -> tuple[Caution, ...]:
        """What is to be said as long as it is not known what the pings have in common."""
        if self._size == 0 or (self._known and not self._waiting):
            return ()
        return (Caution('common_unknown', f'{len(self._compared)} pings at different places do not tell yet what all '
                        f'have in common, and {len(self._waiting)} wait for it: front_end.common_pings asks for '
                        f'{self._size}, spread by more than {in_metres(self._pulse_m)} in every direction'),)

    def take(self, ping: Ping, place: Pose) -> list[PlacedPing]:
        """Take one ping at the sensor's place; pings come out in the order in which they went in."""
        if self._size == 0:
            return [(ping, place)]
        self._compare(ping, place)
        self._waiting.append((ping, place))
        self._open = self._open or len(self._waiting) > _PATIENCE * self._size or (
            len(self._compared) == self._size and self._known)
        return self.finish() if self._open else []

    def finish(self) -> list[PlacedPing]:
        """No more pings will come: what waits comes out."""
        waiting, self._waiting = self._waiting, []
        return [(self.cleaned(ping), place) for ping, place in waiting]

    def cleaned(self, ping: Ping) -> Ping:
        """The ping less what is known to be in common; the ping itself where nothing is."""
        if not self._known or _shape(ping) != _shape(self._compared[0][0]):
            return ping
        if self._common is None:
            window = max(round(self._pulse_s / ping.period_s), 1)
            self._common = common_part(np.array([each.samples for each, _ in self._compared]), window)
        samples = without_common(ping.samples, self._common).astype(ping.samples.dtype, copy=False)
        return dataclasses.replace(ping, samples=samples)

    @property
    def _known(self) -> bool:
        """Whether there are pings enough, and they spread in every direction."""
        if self._size == 0 or len(self._compared) < LEAST_PINGS:
            return False
        places = _places(self._compared)
        return bool(np.linalg.eigvalsh(np.cov(places.T))[0] > self._pulse_m**2)

    def _compare(self, ping: Ping, place: Pose) -> None:
        """Take a ping among those that are compared, if it has their shape and a place of its own."""
        if self._compared:
            away = np.hypot(*(_places(self._compared) - (place.x, place.y)).T)
            if _shape(ping) != _shape(self._compared[0][0]) or away.min() < 0.25 * self._pulse_m:
                return
        self._compared.append((ping, place))
        self._common = None
        if len(self._compared) > self._size:
            places = _places(self._compared)
            gaps = np.linalg.norm(places[:, None] - places[None], axis=2) + np.diag(np.full(len(places), np.inf))
            del self._compared[int(gaps.min(axis=1).argmin())]

    @property
    def pings(self) -> list[Ping]:
        """Those that wait or are compared."""
        return [ping for ping, _ in (*self._waiting, *self._compared)]

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that is needed to go on, as arrays."""
        flat: dict[str, NDArray[np.generic]] = {'open': np.array(self._open)}
        for name, placed in (('waiting', self._waiting), ('compared', self._compared)):
            flat |= {f'{name}_{key}': array for key, array in packed_pings([ping for ping, _ in placed]).items()}
            flat[f'{name}_places'] = np.array([(place.x, place.y, place.yaw) for _, place in placed]).reshape(-1, 3)
        return flat

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Take over what `state` gave."""
        self._open, self._common = bool(state['open']), None
        self._waiting, self._compared = (_unpacked(state, name) for name in ('waiting', 'compared'))


def _shape(ping: Ping) -> tuple[int, float, float]:
    return ping.samples.size, float(f'{ping.period_s:.6e}'), round(ping.t0_s, 10)


def _places(placed: list[PlacedPing]) -> NDArray[np.float64]:
    return np.array([(place.x, place.y) for _, place in placed])


def _unpacked(state: dict[str, NDArray[np.generic]], name: str) -> list[PlacedPing]:
    pings, places = unpacked_pings(state, f'{name}_'), np.asarray(state[f'{name}_places'], float)
    if places.shape != (len(pings), 3) or not np.all(np.isfinite(places)):
        raise StateError(f'{len(pings)} {name} pings do not match {places.shape} places')
    return list(zip(pings, (Pose(*row) for row in places.tolist()), strict=True))
