"""The other polygon: what a path tells poorly from an answer is its mirror image about the path.

First-order echoes of a straight path are those of the mirror image, too, and so are all others. The further the path
winds, the more the two differ; whether by enough, only their likelihoods can tell.
"""

from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.evidence.power_search import SEARCH_ORDER
from polymap_ros.mapping.evidence.search import Found, Search
from polymap_ros.mapping.lines import mirrored_lines
from polymap_ros.mapping.straightness import path_axis

AS_LIKELY = 6.0
"""Nats that a second polygon may be worth less and still has to be reported: odds of 400."""

_ALIKE = 0.8
"""Share of the walls' part in the power's log likelihood that a mirror image has at least, before it is moved: power is
blind to a distance that is off by less than a pulse's width, and what only phase can tell apart differs by less."""


def mirror_image(search: Search, found: Found) -> Generator[None, None, Found | None]:
    """The best polygon near an answer's mirror image; None where it is the same, or explains far less."""
    lines = mirrored_lines(found.lines, *path_axis(search.data.positions))
    own = found.model.with_lines(found.lines, found.model.loss)
    value = search.power.fit_nuisances(own, SEARCH_ORDER)
    image, nothing = own.with_lines(lines, own.loss), search.power.quiet(own)
    if search.power(image, SEARCH_ORDER) < nothing + _ALIKE * (value - nothing) or _same(search, image.lines, found):
        return None
    yield
    other = yield from search.settle(image)
    return None if other is None or _same(search, other.lines, found) else other


def _same(search: Search, lines: NDArray[np.float64], found: Found) -> bool:
    """Whether lines are those of an answer, to every ping."""
    return len(lines) == len(found.lines) and all(search.one_of(line, found.lines) for line in lines)
