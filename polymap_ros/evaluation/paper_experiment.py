"""The paper's section III: three simulated plates and a rectangular one, ten repetitions of the optimiser each."""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polymap_ros.evaluation.trials import Trial, filled_mapper, judged, ready, run_trials
from polymap_ros.geometry.lines import iou
from polymap_ros.geometry.pose import Pose
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.solvers.paper.solver import PaperSolver

SIMULATED, RECTANGLE = ('triangle', 'quadrilateral', 'pentagon'), 'rectangle'


@dataclass(frozen=True, eq=False)
class History:
    """One repetition of the optimiser, iteration by iteration.

    Parameters
    ----------
    scene : str
        Name of the built-in scene.
    true_edges : int
        Its number of edges.
    trial : Trial
        The final answer.
    cost : ndarray, shape (P,)
        Eq. (5) after each iteration.
    edges : ndarray, shape (P,)
        Number of edges after the filter of eq. (10); 0 where no polygon closes.
    iou : ndarray, shape (P,)
        Overlap of the filtered polygon with the truth.
    """

    scene: str
    true_edges: int
    trial: Trial
    cost: NDArray[np.float64]
    edges: NDArray[np.int64]
    iou: NDArray[np.float64]


@dataclass(frozen=True)
class PaperExperiment:
    """All repetitions; only the seed of the optimiser differs between those of a scene.

    Parameters
    ----------
    repetitions : int
        Per scene, with ``solver.seed`` 1, 2, ...
    snr_db : float or None
        As in `Scene`.
    parameters : Parameters
        What the scenes do not prescribe.
    """

    repetitions: int
    snr_db: float | None
    parameters: Parameters

    def jobs(self) -> list[tuple[str, int]]:
        """Scene and solver seed of every repetition."""
        return [(name, run) for name in (*SIMULATED, RECTANGLE) for run in range(1, self.repetitions + 1)]

    def run_one(self, name: str, run: int) -> History:
        """One repetition of the published method."""
        scene = self._scene(name)
        parameters = self.parameters.replaced({'solver.method': 'paper', 'solver.seed': run})
        ready(parameters)
        mapper = filled_mapper(scene, parameters)
        started = time.perf_counter()
        annealing = PaperSolver(mapper.parameters).annealed(mapper.evidence)
        estimate = annealing.estimate()
        seconds = time.perf_counter() - started
        start = mapper.start_pose or Pose(0.0, 0.0)
        polygons = [start.apply(annealing.polygon_at(iteration)) for iteration in range(1, len(annealing.costs))]
        return History(
            scene=name, true_edges=len(scene.vertices),
            trial=judged(estimate.moved(start), scene, 'paper', seconds, run=run),
            cost=annealing.costs[1:], edges=np.array([len(polygon) for polygon in polygons]),
            iou=np.array([iou(polygon, scene.vertices) for polygon in polygons]))

    def run_once(self, name: str, method: str) -> Trial:
        """One scene by another method, such as the rectangular plate by that of [1]."""
        return run_trials(self._scene(name), [method], self.parameters)[0]

    def _scene(self, name: str) -> Scene:
        return dataclasses.replace(load_scene(name), snr_db=self.snr_db)


def by_scene(histories: Sequence[History]) -> dict[str, list[History]]:
    """Histories by scene, in the paper's order, each by run."""
    return {name: sorted((history for history in histories if history.scene == name), key=lambda h: h.trial.run)
            for name in (*SIMULATED, RECTANGLE)}
