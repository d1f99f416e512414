"""The solvers by the name that `solver.method` gives them."""

from collections.abc import Callable

from polymap_ros.parameters import Parameters
from polymap_ros.solvers.evidence.localising import LocalisingSolver
from polymap_ros.solvers.evidence.solver import EvidenceSolver
from polymap_ros.solvers.paper.solver import PaperSolver
from polymap_ros.solvers.rectangle import RectangleSolver
from polymap_ros.solvers.solver import Solver

SOLVERS: dict[str, Callable[[Parameters], Solver]] = {
    'evidence': EvidenceSolver,
    'paper': PaperSolver,
    'rectangle': RectangleSolver,
}


def make_solver(parameters: Parameters) -> Solver:
    """The solver that the parameters ask for."""
    if parameters.localises:
        return LocalisingSolver(parameters)
    return SOLVERS[parameters.solver.method](parameters)
