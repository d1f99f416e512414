"""A solve of a square about the pings, for the kernels that it uses: compiled before the first answer is due."""

from contextlib import suppress

import numpy as np

from polymap_ros.geometry.outline import corners_of
from polymap_ros.jit import IS_COMPILED
from polymap_ros.parameters import Parameters
from polymap_ros.solvers.checkpoint import Stopped
from polymap_ros.solvers.evidence.first_walls import first_walls
from polymap_ros.solvers.evidence.moves.curve import rehearse_curves
from polymap_ros.solvers.evidence.moves.exchange import improved
from polymap_ros.solvers.evidence.moves.faint import rehearse_faint
from polymap_ros.solvers.evidence.moves.hole import rehearse_holes
from polymap_ros.solvers.evidence.moves.inner_wall import rehearse_inner_walls
from polymap_ros.solvers.evidence.moves.start import chosen, start_at
from polymap_ros.solvers.evidence.proposals import Candidates
from polymap_ros.solvers.evidence.ring_search import rehearse_rings
from polymap_ros.solvers.evidence.round_holes import rehearse_round_holes
from polymap_ros.solvers.evidence.search import search_of
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.snapshot import Snapshot
from polymap_ros.solvers.solver import Evidence

_REHEARSED = 40
"""Checkpoints after which the kernels of a solve have all been used."""


def rehearse(evidence: Evidence, parameters: Parameters) -> None:
    """Improve and settle a square about the pings, whatever they heard: every compiled kernel is used."""
    steps = iter(range(_REHEARSED))

    def enough() -> None:
        if next(steps, None) is None:
            raise Stopped

    search = search_of(evidence, parameters, enough)
    start_at(search, 1.0)
    middle, half = search.data.positions.mean(axis=0), search.data.extent_m
    walls = Walls.of_polygon(middle + half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]))
    square = search.nothing.with_strength(1.0).with_walls(walls)
    chosen(search, Candidates(walls.lines, np.ones(len(walls))), 1.0, iterations=4)
    with suppress(Stopped):
        improved(search, square, 1, np.empty((0, 2)), residual=True)
        search.settle(square)
    judged = search.judge(square)
    if judged is not None and judged.wave is not None:
        rehearse_curves(search, judged.wave)
    rehearse_faint()
    if parameters.solver.outline == 'auto' and IS_COMPILED:
        rehearse_rings(search, walls.lines)
        rehearse_holes(search, walls.lines)
        rehearse_inner_walls()
        if judged is not None:
            rehearse_round_holes(search, judged)
    first_walls(search.data.positions, np.full(len(search.data.positions), half), search.data.pulse.width_m)
    Snapshot.of(evidence).region.iou(corners_of(walls.lines)[1])
