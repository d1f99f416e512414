"""The pulse that echoes have in truth under odometry that drifts: from a window of pings, in which it errs by little.

Sharpened by a pulse of minimum phase (`echo_spectrum`) a window is explained by power as ever, and its pings are locked
in phase to a fraction of a cycle, though orders do not agree yet: the pulse's delay is a millimetre or two off. From
there the pulse is fitted with the walls (`pulse_search`), and walls and poses climb by it. One window is enough: by its
pulse all others are found, and in the end it is fitted to all pings where they were found to be.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from polymap_ros.solvers.evidence.drift import begun
from polymap_ros.solvers.evidence.echo_spectrum import RINGS_LONG, spectral_misfit
from polymap_ros.solvers.evidence.heard_pulse import HeardPulse
from polymap_ros.solvers.evidence.phase_lock import locked
from polymap_ros.solvers.evidence.pulse_search import Adapted, FirstGuess, adapted, may_be_told, pulse_of_walls
from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.evidence.tracking import Chain, Track, anchored, mended, refined
from polymap_ros.solvers.evidence.windows import SETTLED, by_all_orders, if_settled, windows_by_power

_LOCKED, _FITS = 0.45, 0.65
"""Share of the power that a locked window explains from which a pulse is fitted to it, and the score of its best guess
from which walls are settled by it. Of 22 windows of six plates with everything mild at the level `typical` (even seeds)
14 were solved, which had 0.52 to 0.93 and 0.76 to 0.87; the others 0.26 to 0.62 and up to 0.69."""

_GIVEN_UP_AFTER = 6
"""Windows that are explained by power from which no pulse comes, after which no other is asked: of five of those plates
it came from the third of them at the latest, of the sixth none was explained."""


class _PulseOfTrack(NamedTuple):
    """A pulse, and the track of the pings that told it."""

    pulse: HeardPulse
    track: Track


def own_pulse(search: Search, chain: Chain, rings: bool, may_drift: bool) -> Adapted | None:
    """Return the pulse that the echoes have, and what is found by it, where the search has the nominal one.

    From the reported poses, or where they `may_drift` from those that windows tell, which are asked first where the
    reported ones fit badly. `rings` says whether outlines that need not be convex are looked for.
    """
    if not may_be_told(search):
        return None
    first = FirstGuess.of(search)
    ways: list[Callable[[], Adapted | None]] = [partial(adapted, search, first, rings)]
    if may_drift and spectral_misfit(search.data) < RINGS_LONG:
        ways.insert(0 if first.hopeless else 1, partial(track_by_pulse, search, first.sharp, chain, rings))
    return next((own for way in ways if (own := way()) is not None), None)


def track_by_pulse(search: Search, sharp: Search, chain: Chain, rings: bool) -> Adapted | None:
    """Return walls and poses by a pulse that a window of the pings tells, which are `sharp`; None where no window does.
    """
    own = _of_windows(search, sharp, chain)
    track = own and begun(own.pulse.over(search), chain, None, rings, (own.track,))
    if own is None or track is None:
        return None
    pulse, whole = own.pulse, _fitted_to(search, chain, track)
    if whole is not None and whole.track.found.explained >= track.found.explained:
        pulse, track = whole.pulse, anchored(whole.track, chain)
    return Adapted(pulse, track.search, track.found, track)


def _of_windows(search: Search, sharp: Search, chain: Chain) -> _PulseOfTrack | None:
    """Return the pulse of the first window whose walls explain its echoes by it; None where there is none."""
    in_vain = 0
    for rough, _ in windows_by_power(sharp, chain):
        if rough is None:
            continue
        track = locked(sharp, chain, by_all_orders(sharp, chain, rough), SETTLED)
        own = None if track is None or track.found.explained < _LOCKED else _fitted_to(search, chain, track)
        if own is not None:
            return own
        in_vain += 1
        if in_vain == _GIVEN_UP_AFTER:
            break
    return None


def _fitted_to(search: Search, chain: Chain, track: Track) -> _PulseOfTrack | None:
    """Return the pulse that fits the pings of a track, with that by it; None where its walls do not explain enough."""
    own = pulse_of_walls(search.over(search.data.chosen(track.pings).at(track.poses)), track.found, _FITS)
    if own is None:
        return None
    heard = own.pulse.over(search)
    better = refined(heard, chain, own.found, track.pings, track.poses)
    settled = if_settled(better and mended(heard, chain, better))
    return settled and _PulseOfTrack(own.pulse, settled)
