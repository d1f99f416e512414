"""How sure each edge is: the best explanation without it, and how far r and theta may move."""

from collections.abc import Generator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.evidence.power import Model
from polymap_ros.mapping.evidence.power_search import PRICE
from polymap_ros.mapping.evidence.search import FULL_ORDER, Found, Search, without_wall
from polymap_ros.mapping.evidence.waveform import Wave

_OBVIOUS = 400.0
"""Nats that no refit of the other walls makes up for."""

_CYCLE_ERROR = 7e-4
"""Share of a cycle of range, pi / k0, below which sampling, truncation and interpolation let no r be
known; without phase, of the pulse's width."""

_SILENT = 0.2
"""Reflection coefficient below which a wall bounds the polygon by the echoes it takes from others, not by its own."""


class Certainty(NamedTuple):
    """Of each edge: the probability that it is real, the covariance (n, 2, 2) of r [m] and theta [rad].

    `unsupported` edges bound the polygon and were not heard: without them nothing closes, or they hardly reflect.
    """

    likelihood: NDArray[np.float64]
    covariance: NDArray[np.float64]
    unsupported: int


def certainty_of(search: Search, found: Found) -> Generator[None, None, Certainty]:
    """Leave out every edge in turn, refit, and compare; the edge's odds are exp(loss - price)."""
    losses = np.empty(len(found.lines))
    bounding = np.zeros(len(found.lines), np.bool_)
    for wall in range(len(found.lines)):
        yield
        if found.wave is not None:
            losses[wall], bounding[wall] = _wave_loss(search, found.wave, wall)
        else:
            losses[wall], bounding[wall] = _power_loss(search, found.model, wall)
    likelihood = 1.0 / (1.0 + np.exp(np.clip(PRICE - losses, -500.0, 500.0)))
    # Where much is left unexplained, a wall that is not there may explain some of it.
    doubt = np.clip((found.explained + search.uncertainty) / 0.85, 0.0, 1.0)
    silent = np.zeros(len(losses), np.bool_) if found.wave is None else np.abs(found.wave.reflection) < _SILENT
    unsupported = int(np.sum((bounding & (losses < PRICE)) | silent))
    return Certainty(likelihood * doubt, _covariance(search, found), unsupported)


def _wave_loss(search: Search, wave: Wave, wall: int) -> tuple[float, bool]:
    """What leaving a wall out costs, and whether only its echoes can be left out, since it closes the polygon."""
    fewer = without_wall(search.wave, wave, wall)
    bounding = fewer is None
    if fewer is None:
        silent = wave.reflection.copy()
        silent[wall] = 0.0
        fewer = search.wave.evaluate(wave.lines, silent, wave.phase, FULL_ORDER, derive=False)
        assert fewer is not None, 'the walls bound a polygon'
    loss = wave.value - fewer.value
    if loss < _OBVIOUS:
        refitted = search.wave.refine(fewer.lines, fewer.reflection, fewer.phase, FULL_ORDER, 4)
        loss = wave.value - (refitted or fewer).value
    return loss, bounding


def _power_loss(search: Search, model: Model, wall: int) -> tuple[float, bool]:
    value = search.power.fit_nuisances(model, FULL_ORDER)
    fewer = model.without(wall)
    bounding = not np.isfinite(search.power(fewer, FULL_ORDER))
    if bounding:
        fewer = Model(model.lines, model.loss.copy(), model.strength, model.background)
        fewer.loss[wall] = -20.0
        return value - search.power(fewer, FULL_ORDER), bounding
    return value - search.power.refine(fewer, FULL_ORDER, 3)[1], bounding


def _covariance(search: Search, found: Found) -> NDArray[np.float64]:
    """Inverse Fisher information, and the sandwich of the pings' own scores where that is larger.

    The sandwich I^-1 (sum_i s_i s_i^T) I^-1 grows with what the model does not know, such as errors of position; it is
    scaled up by its degrees of freedom, N / (N - 3).
    """
    if found.wave is not None:
        wave = found.wave
        information, scores = wave.information, wave.scores
    else:
        derived = search.power.derivatives(found.model, FULL_ORDER)
        assert derived is not None
        _, scores, information = derived
    # Scaled to a diagonal of 1, so that the ridge is relative: what the pings cannot tell has a large error, not none.
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    ridge = 1e-9 * np.eye(len(scale))
    inverse = np.linalg.inv(information * np.outer(scale, scale) + ridge) * np.outer(scale, scale)
    centred = scores - scores.mean(axis=0)
    pings = len(scores)
    spread = inverse @ (centred.T @ centred) @ inverse * (pings / max(pings - 3, 1))
    n = len(found.lines)
    blocks = [(inverse[3 * k:3 * k + 2, 3 * k:3 * k + 2], spread[3 * k:3 * k + 2, 3 * k:3 * k + 2]) for k in range(n)]
    covariance = np.array([_larger(plain, robust) for plain, robust in blocks])
    pulse = search.data.pulse
    cycle = np.pi / pulse.carrier if found.wave is not None else pulse.width_m
    covariance[:, 0, 0] += (_CYCLE_ERROR * cycle) ** 2
    return covariance + _shared_by_all(found, search.data.positions)


def _shared_by_all(found: Found, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance (n, 2, 2) by the shift and the turn that all positions share, where each of them was estimated."""
    normals = np.column_stack((np.cos(found.lines[:, 1]), np.sin(found.lines[:, 1])))
    centre = positions.mean(axis=0)
    lever = normals @ np.array([[0.0, 1.0], [-1.0, 0.0]]) @ centre
    shift = found.misplaced_m**2 / len(positions)
    turn = found.misplaced_m**2 / max(float(np.sum((positions - centre) ** 2)), 1e-300)
    shared = np.empty((len(lever), 2, 2))
    shared[:, 0, 0], shared[:, 1, 1] = shift + turn * lever**2, turn
    shared[:, 0, 1] = shared[:, 1, 0] = turn * lever
    return shared


def _larger(plain: NDArray[np.float64], robust: NDArray[np.float64]) -> NDArray[np.float64]:
    """A covariance (2, 2) scaled up to the larger variances of another, and no less than rounding."""
    variances = np.maximum(np.diag(plain), 1e-18)
    factor = max(1.0, float(np.max(np.diag(robust) / variances)))
    bound = 0.999 * np.sqrt(variances[0] * variances[1])
    off = float(np.clip(plain[0, 1], -bound, bound))
    return factor * np.array([[variances[0], off], [off, variances[1]]])
