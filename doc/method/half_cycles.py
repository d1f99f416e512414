"""Put walls half a cycle off, one or two at a time, and count what is mended: python doc/method/half_cycles.py."""

import itertools
from collections import Counter

import numpy as np

from polymap_ros import Parameters, load_scene
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.solvers.evidence.search import Found, Search, search_of
from polymap_ros.solvers.evidence.tuning import FULL_ORDER

SCENES = 'pentagon', 'quadrilateral'
SAME = 1e-4
"""By how much r [m] and theta [rad] of lines that are the same may differ."""


def mended(search: Search, found: Found, shifts: dict[int, float]) -> tuple[bool, float]:
    """Put walls so many cycles off, their signs turned, and search on; whether the answer is right, and its share."""
    walls = found.walls
    for wall, cycles in shifts.items():
        walls = walls.shifted(wall, cycles * search.cycle_m, turned=True)
    stuck = search.wave.refine(found.wave.with_walls(walls), FULL_ORDER)
    if stuck is None:
        return False, 0.0
    after = search.changed(found.power, stuck)
    right = len(after.lines) == len(found.lines) and bool(np.abs(after.lines - found.lines).max() < SAME)
    return right, after.explained


def main() -> None:
    """Try all walls and all pairs of walls of two plates."""
    tried, right, left = Counter(), Counter(), []
    for name in SCENES:
        mapper = filled_mapper(load_scene(name), Parameters())
        search = search_of(mapper.evidence, mapper.parameters)
        found = next(search.polygons())
        for count in (1, 2):
            for walls in itertools.combinations(range(len(found.walls)), count):
                for signs in itertools.product((0.5,), *[(0.5, -0.5)] * (count - 1)):
                    is_right, share = mended(search, found, dict(zip(walls, signs, strict=True)))
                    tried[count] += 1
                    right[count] += is_right
                    left += [] if is_right else [share]
    print(f'one wall: {right[1]} of {tried[1]} mended; two at once: {right[2]} of {tried[2]}; where not, at most '
          f'{max(left, default=0.0):.2f} of the power is explained')


if __name__ == '__main__':
    main()
