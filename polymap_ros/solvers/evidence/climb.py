"""The one way up a likelihood: damped Gauss-Newton, with a parabola where a step leads too far."""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.solvers.evidence.likelihood import Likelihood, S, gradient_of, information_of

_CONVERGED = 0.01
"""Nats that are not worth another step: a seventh of a standard deviation."""

_SMALL = 0.5
"""Nats that a step promises, one standard deviation's, below which it is the last: it changes neither the information
nor how the pings' scores differ, and what is left after it is second order."""

_GAINED = 0.1
"""Nats gained by a step that is the last, where the information, and what it promises, is not exact."""

_TRIALS = 3
"""Lengths of one step that are tried, where the information is exact and the step's direction right."""

_SHORTER = 0.1
"""Share of a step's length that the next trial has at least."""

_DAMPED, _FREED, _LEAST_DAMPING, _MOST_DAMPING = 8.0, 4.0, 1e-4, 1e3
"""Where the information leaves something out, the damping grows by the first factor after a step that led down, which
turns it towards the gradient, and falls by the second after one that led up, within these bounds."""


def climb(likelihood: Likelihood[S], start: S | None, order: int, iterations: int) -> S | None:
    """Return the nearest maximum over the unknowns, or how far so many iterations come; None without an outline."""
    here = start and (start if start.slopes else likelihood.evaluate(start.unknowns, start, order, derive=True))
    damping = likelihood.damping
    for _ in range(iterations):
        if here is None:
            return None
        step, expected = _step(likelihood, here, damping)
        if expected <= 0.0 or (not damping and expected < _CONVERGED):
            return here
        better = _up(likelihood, here, step, expected, order, 1 if damping else _TRIALS)
        if better is None:
            if not damping or damping > _MOST_DAMPING:
                return here
            damping *= _DAMPED
            continue
        if better.value - here.value < _GAINED if damping else expected < _SMALL:
            return better.with_slopes(better.slopes or here.slopes)
        damping = max(damping / _FREED, _LEAST_DAMPING) if damping else 0.0
        here = better if better.slopes else likelihood.evaluate(better.unknowns, better, order, derive=True)
    return here


def _up(
    likelihood: Likelihood[S], here: S, step: NDArray[np.float64], expected: float, order: int, trials: int
) -> S | None:
    """Return what is higher along a step (k,), of the lengths tried the first; None where none is."""
    share = 1.0
    for _ in range(trials):
        trial = likelihood.evaluate(here.unknowns.moved(share * step), here, order, likelihood.derives_at_once)
        if trial is not None and trial.value > here.value:
            return trial
        loss = 0.0 if trial is None else here.value - trial.value
        # The maximum of the parabola with the gradient here and the value there.
        share *= max(expected * share / (2.0 * expected * share + loss), _SHORTER)
    return None


def _step(likelihood: Likelihood[S], here: S, damping: float) -> tuple[NDArray[np.float64], float]:
    """Return the step (k,) to where the gradient vanishes, and what the likelihood is expected to gain by it."""
    data, gradient, information = likelihood.data, gradient_of(here), information_of(here)
    diagonal = np.arange(len(gradient))
    information[diagonal, diagonal] *= 1.0 + damping
    held = here.unknowns.held(gradient)
    gradient[held], information[held], information[:, held] = 0.0, 0.0, 0.0
    information[held, held] = 1.0
    width_m = data.pulse.width_m
    step = np.asarray(np.linalg.solve(information, gradient), dtype=float)
    step = here.unknowns.limited(step, width_m, 2.0 * width_m / data.extent_m)
    return step, 0.5 * float(gradient @ step)
