"""The moves of the waveform, in the order in which they are tried.

A move takes what stands, tries what one kind of error would have left, and returns something better or nothing.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from polymap_ros.solvers.evidence.ground import Ground
from polymap_ros.solvers.evidence.moves.corner_cut import cut_corner
from polymap_ros.solvers.evidence.moves.curve import curve_at_last, curve_wall
from polymap_ros.solvers.evidence.moves.faint import hear_faint, look_for_faint
from polymap_ros.solvers.evidence.moves.inner_wall import add_inner_wall, tune_inner_walls
from polymap_ros.solvers.evidence.moves.late import delay_envelopes, tune_delay
from polymap_ros.solvers.evidence.moves.louder import hear_louder
from polymap_ros.solvers.evidence.moves.orders import weigh_orders
from polymap_ros.solvers.evidence.moves.phase import turn_law, turn_phase
from polymap_ros.solvers.evidence.moves.residual import add_from_residual
from polymap_ros.solvers.evidence.moves.retune import retune
from polymap_ros.solvers.evidence.moves.round import round_corners
from polymap_ros.solvers.evidence.moves.slip import fix_cycle_slips
from polymap_ros.solvers.evidence.moves.square import square_up
from polymap_ros.solvers.evidence.moves.standing import Standing
from polymap_ros.solvers.evidence.moves.storey import tune_storey
from polymap_ros.solvers.evidence.moves.wall_drop import drop_wall, merge_walls
from polymap_ros.solvers.evidence.tuning import ALL_EXPLAINED, WHOLE
from polymap_ros.solvers.evidence.waveform import Wave

Schedule: TypeAlias = tuple[tuple[Callable[[Ground, Standing], Wave | None], float], ...]
"""Moves of the waveform in the order in which they are tried, each where less than a share is explained."""

_CYCLES = fix_cycle_slips, np.inf
"""First, and cheap: a wall that is only half a cycle off bends, turns the phase or goes, by the moves that follow."""

_OF_ANY_OUTLINE: Schedule = (
    (tune_storey, np.inf),
    (hear_louder, np.inf),  # before strengths by order take what is lost on the way
    (turn_law, ALL_EXPLAINED),
    (weigh_orders, np.inf),  # before a wall that is not there takes echoes away that were not there
    (turn_phase, WHOLE),  # before what a phase makes of a wall is put down to its place
    (drop_wall, np.inf),
    (tune_delay, np.inf),
)

SCHEDULE: Schedule = (
    _CYCLES,
    (round_corners, WHOLE),  # before anything else is put down to their echoes
    (curve_wall, ALL_EXPLAINED),
    *_OF_ANY_OUTLINE,
    (hear_faint, np.inf),
    (add_from_residual, ALL_EXPLAINED),
    (curve_at_last, WHOLE),
    (cut_corner, WHOLE),
    (delay_envelopes, WHOLE),
    (look_for_faint, ALL_EXPLAINED),  # the dearest
)
"""That for convex outlines."""

RINGS: Schedule = (
    _CYCLES,
    *_OF_ANY_OUTLINE,
    (square_up, np.inf),
    (merge_walls, np.inf),
    (retune, np.inf),
)
"""The same for outlines that are not convex."""

INSIDE: Schedule = (
    _CYCLES,
    *_OF_ANY_OUTLINE,
    (tune_inner_walls, ALL_EXPLAINED),
    (add_inner_wall, ALL_EXPLAINED),
)
"""The same where something stands inside the outline."""
