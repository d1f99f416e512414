"""Starts: closed polygons of the lines with the most first-order evidence, by annealing over subsets of them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import bounding_lines
from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.proposals import Candidates, first_strength, foot_evidence, strongest_lines
from polymap_ros.solvers.evidence.subset import annealed_subset
from polymap_ros.solvers.evidence.tuning import ANNEALING, POOL, PRICE, STRENGTHS
from polymap_ros.solvers.evidence.walls import Walls


class Start(NamedTuple):
    """A polygon to start from, and the lines (m, 2) that it was chosen among."""

    power: Power
    pool: NDArray[np.float64]


def starts(ground: Ground) -> Iterator[Start | None]:
    """Give a start for each assumed strength of a first-order echo; None where all lines together bound no polygon."""
    strength = first_strength(ground.data, ground.nothing.expected)
    for factor in STRENGTHS:
        yield start_at(ground, factor * strength)


def start_at(ground: Ground, strength: float) -> Start | None:
    """Anneal over subsets of the strongest lines, then add the next ones until they close."""
    candidates = strongest_lines(ground.data, ground.nothing.expected, strength, POOL)
    subset = candidates.lines[chosen(ground, candidates, strength)]
    for line in (None, *candidates.lines):
        subset = subset if line is None else np.vstack((subset, line))
        lines = bounding_lines(subset, ground.data.shortest_m)
        if len(lines):
            return Start(ground.nothing.with_strength(strength).with_walls(Walls.convex(lines)), candidates.lines)
    return None


def chosen(
    ground: Ground, candidates: Candidates, strength: float, iterations: int = ANNEALING
) -> NDArray[np.int64]:
    """Return the subset of candidates with the most first-order evidence at an assumed strength."""
    evidence = foot_evidence(ground.data, ground.nothing.expected, strength)
    return annealed_subset(
        ground.data, candidates, evidence, PRICE, ground.max_edges, iterations, ground.generator)
