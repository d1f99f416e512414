"""The solvers by the name that `solver.method` gives them."""

from collections.abc import Callable

from polymap_ros.mapping.evidence.solver import EvidenceSolver
from polymap_ros.mapping.paper_solver import PaperSolver
from polymap_ros.mapping.rectangle import RectangleSolver
from polymap_ros.mapping.solver import Solver
from polymap_ros.parameters import Parameters

SOLVERS: dict[str, Callable[[Parameters], Solver]] = {
    'evidence': EvidenceSolver,
    'paper': PaperSolver,
    'rectangle': RectangleSolver,
}


def make_solver(parameters: Parameters) -> Solver:
    """The solver that the parameters ask for."""
    return SOLVERS[parameters.solver.method](parameters)
