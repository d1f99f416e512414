"""How sure each edge is: the best explanation without it, and how far r and theta may move."""

from collections.abc import Generator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from polymap_ros.mapping.evidence.power import Model
from polymap_ros.mapping.evidence.power_search import PRICE
from polymap_ros.mapping.evidence.search import FULL_ORDER, OBVIOUS, Found, Search, least_gain, without_wall
from polymap_ros.mapping.evidence.waveform import Wave, WaveformLikelihood

_TRUSTED = 0.85
"""Share of the echoes' power from which what is left casts no doubt on the edges: of L- and T-shaped outlines and of
plates with a seam, polygons explain 0.86 to 0.94, and their edges are real (measured)."""

_OUT_OF_PHASE = 0.75
"""Doubt in edges whose echoes, heard with phase, agree in power only: the medium, the time zero or the positions are
wrong then, and so may the edges be (of 45 in such scenes 34 were real, to 10 mm). As much in those of a plate's
magnitudes, whose echoes have another shape than is looked for."""

_VAGUE = 0.5
"""Doubt in an edge whose r is not known to half the width of the pulse: few or weak echoes speak for it, and another
wall near by may give them as well."""

_CYCLE_ERROR = 7e-4
"""Share of a cycle of range, pi / k0, below which sampling, truncation and interpolation let no r be
known; without phase, of the pulse's width."""

_SILENT = 0.2
"""Reflection coefficient below which a wall bounds the polygon by the echoes it takes from others, not by its own."""


class Certainty(NamedTuple):
    """Of each edge: the probability that it is real; of all, the covariance (2 n, 2 n) of r [m], theta [rad] of each.

    `silent` edges hardly reflect. `unsupported` ones bound the polygon and were not heard: they are silent, or without
    them nothing closes.
    """

    likelihood: NDArray[np.float64]
    covariance: NDArray[np.float64]
    silent: NDArray[np.bool_]
    unsupported: int


def certainty_of(search: Search, found: Found) -> Generator[None, None, Certainty]:
    """Leave out every edge in turn, refit, and compare; the odds are exp(loss - price), less a doubt."""
    price = least_gain(found.value + PRICE * len(found.lines))
    few = found.wave and search.few_wave.evaluate(*_walls(found.wave), FULL_ORDER, derive=False)
    losses = np.empty(len(found.lines))
    bounding = np.zeros(len(found.lines), np.bool_)
    for wall in range(len(found.lines)):
        yield
        if found.wave is not None and few is not None:
            losses[wall], bounding[wall] = _wave_loss(search, found.wave, few, wall, max(OBVIOUS, price))
        else:
            losses[wall], bounding[wall] = _power_loss(search, found.model, wall)
    likelihood = expit(losses - price)
    # Where much is left unexplained, a wall that is not there may explain some of it.
    doubt = np.clip((found.explained + search.uncertainty) / _TRUSTED, 0.0, 1.0)
    if found.wave is None and (search.coherent or search.dispersed):
        doubt *= _OUT_OF_PHASE
    silent = np.abs(found.reflection) < _SILENT
    covariance = _covariance(search, found)
    vague = np.sqrt(np.diag(covariance)[::2]) > 0.5 * search.data.pulse.width_m
    unsupported = int(np.sum((bounding & (losses < PRICE)) | silent))
    return Certainty(likelihood * np.where(vague, _VAGUE * doubt, doubt), covariance, silent, unsupported)


def _wave_loss(search: Search, wave: Wave, few: Wave, wall: int, enough: float) -> tuple[float, bool]:
    """What leaving a wall out costs, and whether only its echoes can be left out, since it closes the polygon.

    `few` is the same waveform by a part of the pings; where these lose `enough`, the others are not looked at, and
    nothing is refitted.
    """
    for likelihood, whole in ((search.few_wave, few), (search.wave, wave)):
        fewer, bounding = _left_out(likelihood, whole, wall)
        loss = whole.value - fewer.value
        if loss >= enough:
            return loss, bounding
    refitted = search.wave.refine(*_walls(fewer), FULL_ORDER, 4)
    return wave.value - (refitted or fewer).value, bounding


def _walls(wave: Wave) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    return wave.lines, wave.reflection, wave.phase


def _left_out(likelihood: WaveformLikelihood, wave: Wave, wall: int) -> tuple[Wave, bool]:
    """The waveform without a wall, or, where nothing closes without it, with the wall silent."""
    fewer = without_wall(likelihood, wave, wall)
    if fewer is not None:
        return fewer, False
    silent = wave.reflection.copy()
    silent[wall] = 0.0
    fewer = likelihood.evaluate(wave.lines, silent, wave.phase, FULL_ORDER, derive=False)
    assert fewer is not None, 'the walls bound a polygon'
    return fewer, True


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
    walls = np.arange(len(scale)) % 3 < 2  # without the losses
    plain, robust = inverse[np.ix_(walls, walls)], np.diag(spread)[walls]
    factor = np.maximum(1.0, np.mean((robust / np.maximum(np.diag(plain), 1e-300)).reshape(-1, 2), axis=1))
    factor = np.repeat(np.sqrt(factor), 2)
    covariance: NDArray[np.float64] = plain * np.outer(factor, factor)
    pulse = search.data.pulse
    cycle = np.pi / pulse.carrier if found.wave is not None else pulse.width_m
    offsets = np.arange(0, len(covariance), 2)
    covariance[offsets, offsets] += (_CYCLE_ERROR * cycle) ** 2
    return covariance + _shared_by_all(found, search.data.positions)


def _shared_by_all(found: Found, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance (2 n, 2 n) by the shift and the turn that all positions share, where each of them was estimated."""
    c, s = np.cos(found.lines[:, 1]), np.sin(found.lines[:, 1])
    x, y = centre = positions.mean(axis=0)
    by_motion = np.zeros((2 * len(c), 3))
    by_motion[::2] = np.column_stack((c, s, c * y - s * x))
    by_motion[1::2, 2] = 1.0
    spread = max(float(np.sum((positions - centre) ** 2)), 1e-300)
    variances = found.misplaced_m**2 / np.array([len(positions), len(positions), spread])
    return np.asarray(by_motion * variances @ by_motion.T)
