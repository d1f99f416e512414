"""What image sources can explain of the echoes: not what corners return, nor what comes after all the orders they have.

Where walls explain much of the echoes and not all, the rest may be what walls do beside reflecting. What their corners
return follows from the walls, and is taken out; paths of more reflections than the waveform has begin at a range which
follows from them, too, and what comes later is not listened to. Where that leaves clearly less, it is what was missing.
"""

import numpy as np

from polymap_ros.geometry.outline import ring_corners
from polymap_ros.solvers.evidence.corner_echoes import without_corner_echoes
from polymap_ros.solvers.evidence.horizon import up_to_horizon
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.square_walls import free
from polymap_ros.solvers.evidence.tracking import Chain, Track, improved_track
from polymap_ros.solvers.evidence.tuning import (
    CORNER_ROUNDS,
    CORNERS_FROM,
    FULL_ORDER,
    HORIZON_HOLDS,
    SHORT_EDGES,
    STILL_LEFT,
    WHOLE,
)
from polymap_ros.solvers.evidence.waveform import Wave

_EDGES_CHANGED = 2
"""How often that is done at most: once more with other edges, where those found before had other corners."""


def imaged(search: Search, found: Found, enough: float) -> tuple[Search, Found]:
    """Return the search over what images can explain, and the answer there; both as they are where that is no more.

    Nothing is done where the answer explains `enough`, or so little that its corners are not worth asking. Where it is
    not enough over the whole range, either, one is looked for up to the horizon, too, and the better of both is kept:
    by what they explain up to there, since of what comes later no walls explain much.
    """
    if found.wave is None or len(found.storey) or not CORNERS_FROM < found.explained < enough:
        return search, found
    over_all = _with_answer(*_without_corners(search, found))
    answers = [over_all]
    if over_all is None or over_all[1].explained < enough:
        near = search.over(up_to_horizon(search.data, found.walls))
        if near.data.excess > HORIZON_HOLDS * search.data.excess:
            sooner = _with_answer(*_without_corners(near, found))
            answers = [_better_near(near, sooner, over_all), over_all]
    for answer in answers:
        if answer is not None and _clearly_more(answer[1], found):
            return _without_corner_edges(*answer)
    return search, found


def _with_answer(search: Search, found: Found | None) -> tuple[Search, Found] | None:
    return None if found is None else (search, found)


def _better_near(
    near: Search, sooner: tuple[Search, Found] | None, over_all: tuple[Search, Found] | None
) -> tuple[Search, Found] | None:
    """Return the better of two answers up to the horizon: the one found there, and that over the whole range.

    Each is judged by what it leaves there without the echoes of its own corners.
    """
    if over_all is None or over_all[1].wave is None:
        return sooner
    judge = _over_without_corners(near, over_all[1].wave)
    judged = judge.again(over_all[1])
    if judged is None or judged.wave is None or (sooner is not None and sooner[1].explained >= judged.explained):
        return sooner
    return judge, judged


def _over_without_corners(search: Search, wave: Wave) -> Search:
    """The search over what the corners of a waveform's walls do not return."""
    other = search.over(without_corner_echoes(search.data, wave))
    other.approximate, other.whole = True, search.data
    return other


def imaged_track(search: Search, chain: Chain, track: Track, enough: float) -> Track:
    """Return a track of what corners do not return, walls and poses refined; as it is where that is no more.

    The search is over all pings, where they were reported.
    """
    if track.found.wave is None or len(track.found.storey) or not CORNERS_FROM < track.found.explained < enough:
        return track
    better = track
    for _ in range(CORNER_ROUNDS):
        assert better.found.wave is not None, 'is refined by the waveform'
        heard = without_corner_echoes(search.data.chosen(track.pings).at(better.poses), better.found.wave)
        signal = search.data.signal.copy()
        signal[track.pings] = heard.signal
        other = search.over(search.data.with_signal(signal))
        other.approximate = True
        again = improved_track(other, chain, better)
        if again is better or again.found.wave is None:
            return track
        better = again
    return better if _clearly_more(better.found, track.found) else track


def _without_corner_edges(search: Search, found: Found) -> tuple[Search, Found]:
    """Return the answer without a short edge in the place of a corner, where that explains more.

    No move finds that: what was taken out are the echoes of the corners that there are with the edge.
    """
    _, corners = ring_corners(found.lines, 0.0, 1.0)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    for wall in np.flatnonzero(lengths < SHORT_EDGES[-1] * search.width_m):
        if found.explained > WHOLE or found.wave is None or search.whole is None:
            break
        whole = search.over(search.whole)
        fewer = whole.wave.refine(found.wave.with_walls(free(found.wave.walls).without(int(wall))), FULL_ORDER)
        judged = None if fewer is None else whole.judged(found.power, fewer)
        other, better = (search, None) if judged is None else _without_corners(whole, judged)
        if better is not None and better.explained > found.explained:
            return _without_corner_edges(other, better)
    return search, found


def _clearly_more(found: Found, other: Found) -> bool:
    return 1.0 - found.explained < STILL_LEFT * (1.0 - other.explained)


def _without_corners(search: Search, found: Found) -> tuple[Search, Found | None]:
    """Return the search over what corners do not return, by the walls found and then by the better ones."""
    other, better, changed = search, found, None
    for _ in range(_EDGES_CHANGED):
        for _ in range(CORNER_ROUNDS):
            assert better.wave is not None, 'is refined by the waveform'
            other = _over_without_corners(search, better.wave)
            again = other.again(better)
            if again is None or again.wave is None:
                return other, None
            better = again
        assert better.wave is not None, 'is refined by the waveform'
        changed = other.changed(better.power, better.wave)
        if changed is None or changed.wave is None or len(changed.walls) == len(better.walls):
            break
        better = changed
    return other, changed
