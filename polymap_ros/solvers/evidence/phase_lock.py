"""Pings locked in phase between walls that power has found.

By power walls are right to a millimetre or two, since many pings tell of each, and poses to half a cycle. The waveform
of walls alone, from such poses, and of walls and poses together, climbs to one of many wrong maxima. So each ping is
looked for by itself, within some cycles of where power has it, by a waveform in which all walls reflect alike: at its
right place all of its echoes agree. Which phase the device has, a few pings tell.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.localisation import Fix, Prior
from polymap_ros.solvers.evidence.search import Search
from polymap_ros.solvers.evidence.tracking import Chain, Track, localiser_of, mended, refined
from polymap_ros.solvers.evidence.tuning import DIFFERENT
from polymap_ros.solvers.evidence.waveform import Wave

_PHASES, _ASKED = 4, 5
"""Phases of the device that are tried, of a full turn, and pings that are asked for which is right: of eight
phases in five windows of an L the next best one was worth 0.58 to 0.89 of the best."""

_OFF_M, _OFF_RAD = 0.006, 0.02
"""Deviation of a pose by power: of five windows of an L at the level `typical` (even seeds) positions were up to 12 mm
off, mostly 1 to 5."""

_LEFT_M = 0.012
"""How much farther away pings are looked for that are left elsewhere."""

_LOCKING_STEPS, _LOCKING_ROUNDS = 8, 3
"""Steps of a climb from there, and rounds in which pings and walls that are in another cycle are looked for."""


def locked(search: Search, chain: Chain, track: Track, enough: float) -> Track | None:
    """Return the walls and poses of a track by power, settled in phase as far as that explains `enough`."""
    several = [_with_phase(track, 2.0 * np.pi * k / _PHASES) for k in range(_PHASES)]
    asked = np.unique(np.linspace(0, len(track.pings) - 1, _ASKED).astype(int))
    worths = [sum(fix.worth for fix in _placed(search, track, wave, asked)) for wave in several]
    wave = several[int(np.argmax(worths))]
    poses = np.array([fix.pose for fix in _placed(search, track, wave, np.arange(len(track.pings)))])
    best = refined(search, chain, track.found._replace(wave=wave), track.pings, poses, _LOCKING_STEPS)
    for _ in range(_LOCKING_ROUNDS):
        if best is None or best.found.explained > enough:
            break
        before = best.found.value
        best = mended(search, chain, best, best.pings, _LEFT_M)
        if best.found.value < before + DIFFERENT:
            break
    return best


def _with_phase(track: Track, phase: float) -> Wave:
    """Return a waveform of walls that reflect without turning the phase, heard by a device of a phase [rad]."""
    walls = replace(track.found.walls, reflection=np.abs(track.found.walls.reflection))
    begun = track.search.wave.begun(walls, track.search.edges[0].held(), track.found.storey)
    return replace(begun, walls=walls, phase=phase)


def _placed(search: Search, track: Track, wave: Wave, numbers: NDArray[np.int64]) -> list[Fix]:
    """Return where some pings of a track fit best, by a waveform."""
    localiser = localiser_of(search, track.with_found(track.found._replace(wave=wave)))
    known = np.diag((_OFF_M, _OFF_M, _OFF_RAD)) ** 2
    fixes = []
    for number in numbers:
        search.checkpoint()
        fixes.append(localiser.place_in_phase(int(track.pings[number]), Prior(track.poses[number], known)))
    return fixes
