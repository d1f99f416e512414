"""The other polygon: what a path tells poorly from an answer is its mirror image about the path.

First-order echoes of a straight path are those of the mirror image, too, and so are all others. The further the path
winds, the more the two differ; whether by enough, only their likelihoods can tell.
"""

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import mirrored_lines
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, SEARCH_ORDER
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.straightness import path_axis

AS_LIKELY = 6.0
"""Nats that a second polygon may be worth less and still has to be reported: odds of 400."""

_ALIKE = 0.8
"""Share of the walls' part in the power's log likelihood that a mirror image has at least, before it is moved: power is
blind to a distance that is off by less than a pulse's width, and what only phase can tell apart differs by less."""

_SETTLED, _REACH = 4, 8
"""So many images are settled, the best by power, of axes so many steps aside and turned at the most: half a pulse's
width each, by which power changes little."""

Axis = tuple[NDArray[np.float64], NDArray[np.float64]]


def mirror_image(search: Search, found: Found, doubtful: bool) -> Found | None:
    """The best polygon near an answer's mirror image; None where it is the same, or explains far less.

    Of an outline that is not convex none is looked for: narrow paths do not find one.

    A wrong answer is an image of the true polygon about some line along the path, which need not be its axis: where the
    path is narrow, or the answer `doubtful`, others are tried until one is worth more and explains the echoes.
    """
    if not found.walls.convex_outline:
        return None
    own = search.power.fitted(found.walls, found.power, SEARCH_ORDER)
    assert own is not None, 'the walls bound a polygon'
    reflection, nothing = np.abs(own.walls.reflection), search.power.quiet(own.background)
    images = [Walls.convex(mirrored_lines(own.walls.lines, *axis), reflection) for axis in _axes(search, doubtful)]
    images.sort(key=lambda image: -search.few.value(image, own, SEARCH_ORDER))
    best = None
    for image in images[:_SETTLED]:
        search.checkpoint()
        alike = search.power.value(image, own, SEARCH_ORDER) >= nothing + _ALIKE * (own.value - nothing)
        other = search.settle(own.with_walls(image)) if alike and not _same(search, image.lines, found) else None
        if other is not None and not _same(search, other.lines, found) and (best is None or other.value > best.value):
            best = other
            if best.value > found.value and best.explained > ALL_EXPLAINED - search.uncertainty:
                break
    return best


def _axes(search: Search, doubtful: bool) -> Iterator[Axis]:
    """Lines along the path, a middle [m] and a direction each, half a pulse's width apart; of a wide path one."""
    positions, step = search.data.positions, 0.5 * search.data.pulse.width_m
    middle, along = path_axis(positions)
    across = np.array((-along[1], along[0]))
    offsets = positions - middle
    length, width = np.ptp(offsets @ along), np.ptp(offsets @ across)
    reach = np.arange(-_REACH, _REACH + 1) * step
    if width > 2.0 * reach[-1] and not doubtful:
        reach = np.zeros(1)
    reach = reach[np.abs(reach) <= max(0.5 * width, step)]
    for aside, turned in itertools.product(reach, reach):
        angle = 2.0 * turned / max(length, step)
        yield middle + aside * across, np.cos(angle) * along + np.sin(angle) * across


def _same(search: Search, lines: NDArray[np.float64], found: Found) -> bool:
    """Whether lines are those of an answer, to every ping."""
    return len(lines) == len(found.lines) and all(search.one_of(line, found.lines) for line in lines)
