"""What stands inside a convex outline, kept where it explains the echoes: inner walls, round holes, other holes.

Each function returns the search over what images can explain, and the answer there; both as they are where nothing more
is explained.
"""

from polymap_ros.solvers.evidence.imaged import imaged
from polymap_ros.solvers.evidence.round_echoes import RoundHoles
from polymap_ros.solvers.evidence.round_holes import fitted_round, with_round_holes
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, EXPLAINED


def explains(search: Search, found: Found | None, enough: float) -> bool:
    """Return whether an answer explains so much of the echoes, in phase where they have one."""
    return found is not None and found.explained > enough and found.walls.let_through and (
        found.wave is not None or not search.coherent)


def with_inside(
    reported: Search, plain: Found, search: Search, found: Found, enough: float
) -> tuple[Search, Found]:
    """Return the answer with inner walls, then with round holes, `plain` being the outline by all that was heard."""
    if found.explained <= ALL_EXPLAINED:
        search, found = _explaining(search, found, search, search.with_inner_walls(found), enough)
    if explains(search, found, enough):
        return search, found
    other, better = with_round_holes(reported, plain, enough)
    if other is not reported and explains(other, better, EXPLAINED - other.uncertainty):
        return other, better
    return search, found


def as_round_as_before(
    reported: Search, plain: Found, search: Search, found: Found, known: RoundHoles | None, enough: float
) -> tuple[Search, Found]:
    """Return the last answer with the round holes that it had, where these still explain the echoes."""
    if known is None or plain.wave is None or explains(search, found, enough):
        return search, found
    again = fitted_round(reported, plain, known.circles)
    if again is not None and explains(*again, EXPLAINED - again[0].uncertainty):
        return again
    return search, found


def pierced(reported: Search, plain: Found, search: Search, found: Found, enough: float) -> tuple[Search, Found]:
    """Return the answer with holes of straight walls."""
    hole = reported.first_hole(plain)
    if hole is None:
        return search, found
    return _explaining(search, found, reported, reported.settle(reported.with_holes(hole)), enough)


def _explaining(
    search: Search, found: Found, other_search: Search, other: Found | None, enough: float
) -> tuple[Search, Found]:
    """What was found, or another, if that explains the echoes, each with the search over what images can explain."""
    if other is not None:
        other_search, other = imaged(other_search, other, enough)
        if explains(other_search, other, EXPLAINED - other_search.uncertainty):
            return other_search, other
    return search, found
