"""What the published method makes of a plate beside the truth, for the figure about its cost."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros import Parameters, PolygonMapper
from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.geometry.lines import moved_lines, polygon_lines
from polymap_ros.geometry.outline import half_plane_polygon
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.simulation.clearance import clearance
from polymap_ros.simulation.scenes import Scene
from polymap_ros.solvers.paper.annealing import Landscape, cost_of
from polymap_ros.solvers.paper.solver import PaperSolver, filtered
from polymap_ros.solvers.snapshot import Snapshot


def true_lines(scene: Scene, mapper: PolygonMapper) -> NDArray[np.float64]:
    """Return r and theta (n, 2) of a scene's walls in the mapper's start frame."""
    assert mapper.start_pose is not None
    return moved_lines(polygon_lines(scene.vertices), mapper.start_pose.inverse())


class Against(NamedTuple):
    """Eq. (5) of two other states less that of the true lines, and what else the published method makes of a plate.

    `replaced` has one edge replaced by a copy of the strongest line, the one for which the cost is least; `annealed` is
    the state after all iterations, and `right` whether its polygon is. Eq. (10) keeps `kept` of the true lines. So many
    ranges of first echoes are `too_long` by more than a centimetre, and `iou` is that of the true polygon with A_T.
    The true edge with the lowest L_T has `weakest` of the map's highest.
    """

    replaced: float
    annealed: float
    right: bool
    kept: int
    too_long: int
    iou: float
    weakest: float


def against_the_truth(scene: Scene) -> Against:
    """Return what the published method makes of a scene.

    Its true lines are the best cells within one of them, and copies of the strongest of these fill up to K.
    """
    mapper = filled_mapper(scene, Parameters())
    evidence, parameters = mapper.evidence, mapper.parameters
    snapshot, lines = Snapshot.of(evidence), true_lines(scene, mapper)
    landscape = Landscape(snapshot.likelihood, snapshot.r_m, snapshot.theta_rad, snapshot.region.points,
                          snapshot.region.ends, snapshot.region.area, parameters.solver.iou_weight)
    cells = np.array([best_cell(snapshot, *line) for line in lines])
    values = snapshot.likelihood[cells[:, 1], cells[:, 0]]
    spare = np.repeat(cells[[values.argmax()]], parameters.solver.max_edges - len(cells), axis=0)
    truth = cost_of(np.vstack((cells, spare)), landscape)
    replaced = []
    for edge in np.flatnonzero(np.arange(len(cells)) != values.argmax()):
        fewer = cells.copy()
        fewer[edge] = cells[values.argmax()]
        replaced.append(cost_of(np.vstack((fewer, spare)), landscape))
    annealing = PaperSolver(parameters).annealed(evidence)
    nearest = clearance(scene.vertices, scene.positions)
    return Against(
        replaced=min(replaced) - truth, annealed=float(annealing.costs[-1]) - truth,
        right=compare(mapper.start_pose.apply(annealing.polygon_at()), scene.vertices).right,
        kept=len(filtered(lines, snapshot, parameters.solver.edge_filter_epsilon)),
        too_long=int(np.sum([sounding.rho for sounding in mapper.soundings] > nearest + 0.01)),
        iou=snapshot.region.iou(half_plane_polygon(lines)[0]), weakest=float(values.min()))


def best_cell(snapshot: Snapshot, r: float, theta: float) -> tuple[int, int]:
    """Return the cell (of r, of theta) with the highest value of the map within one of a line's."""
    i = round(np.mod(theta, 2.0 * np.pi) / snapshot.theta_rad[1])
    j = round(r / snapshot.r_m[1])
    around = [(min(max(j + a, 0), len(snapshot.r_m) - 1), (i + b) % len(snapshot.theta_rad))
              for a in (-1, 0, 1) for b in (-1, 0, 1)]
    return max(around, key=lambda cell: snapshot.likelihood[cell[1], cell[0]])
