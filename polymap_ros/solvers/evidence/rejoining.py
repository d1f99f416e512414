"""Pings that are lost at the end of a track, found elsewhere between its walls: after a restart, or carried away.

The odometry tells nothing of the way there: the step is a slip, by which nothing else is bent.
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.evidence.tracking import Chain, Track, followed, improved_track, judged_track, mended
from polymap_ros.solvers.evidence.walls import KnownWalls
from polymap_ros.solvers.evidence.whereabouts import FEWEST, LOOKED_AT, whereabouts


def rejoined(search: Search, chain: Chain, track: Track) -> Track:
    """Return a track with the pings before and behind it that fit one place between its walls."""
    for pings in (behind(track, chain)[-LOOKED_AT:], np.arange(track.pings[0])[:LOOKED_AT]):
        if len(pings) >= FEWEST:
            found = track.found.walls
            walls = KnownWalls(found.lines, found.reflection, bend=found.bend, round=found.round)
            tracks = whereabouts(search, chain, walls, pings)
            if len(tracks) == 1:
                track = improved_track(search, chain, onward_from(search, chain, joined(search, track, tracks[0])))
    return track


def behind(track: Track, chain: Chain) -> NDArray[np.int64]:
    """Return the pings after the last of a track."""
    return np.arange(track.pings[-1] + 1, len(chain.poses))


def joined(search: Search, track: Track, other: Track) -> Track:
    """Return a track with the pings of another one, between the same walls."""
    pings = np.concatenate((track.pings, other.pings))
    order = np.argsort(pings)
    return judged_track(search, track.found, pings[order], np.vstack((track.poses, other.poses))[order])


def onward_from(search: Search, chain: Chain, track: Track) -> Track:
    """Return a track with all pings that can be placed before and behind it, those that are lost looked for again."""
    *_, whole = (track, *followed(search, chain, track))
    return mended(search, chain, whole, np.setdiff1d(np.arange(whole.pings[0], whole.pings[-1]), whole.pings))
