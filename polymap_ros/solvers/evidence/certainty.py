"""How sure each edge is: the best explanation without it, and how far r and theta may move."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from polymap_ros.solvers.evidence.corner_slopes import corner_slopes
from polymap_ros.solvers.evidence.likelihood import covariance_of, information_of
from polymap_ros.solvers.evidence.moves.curve import curvature_covariance
from polymap_ros.solvers.evidence.moves.late import delay_covariance
from polymap_ros.solvers.evidence.moves.round import corner_radius
from polymap_ros.solvers.evidence.power import Power
from polymap_ros.solvers.evidence.search import Found, Search
from polymap_ros.solvers.evidence.tuning import FULL_ORDER, OBVIOUS, PRICE, SILENT
from polymap_ros.solvers.evidence.walls import Walls
from polymap_ros.solvers.evidence.waveform import Wave, WaveformLikelihood

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


_DELAY_ERROR = 0.02
"""Share of what reflections delay an envelope by that walls may be off: in a plate a delay bends the phase over the
band, too, which is not modelled (0.07 mm of the 3.7 mm that a quarter of a cycle is; 12 plates, even seeds)."""


class Certainty(NamedTuple):
    """Of each edge: the probability that it is real; of all, the covariance (2 n, 2 n) of r [m], theta [rad] of each.

    `silent` edges hardly reflect. `unsupported` ones bound the polygon and were not heard: they are silent, or without
    them nothing closes. `curvature_std` [1/m] is that of each edge that is curved; empty where all are straight.
    `corner_radius` [m] is that of round corners and its deviation; 0 where they are sharp.
    """

    likelihood: NDArray[np.float64]
    covariance: NDArray[np.float64]
    silent: NDArray[np.bool_]
    unsupported: int
    curvature_std: NDArray[np.float64] = np.empty(0)
    corner_radius: tuple[float, float] = (0.0, 0.0)


def certainty_of(search: Search, found: Found, with_poses: NDArray[np.float64] | None = None) -> Certainty:
    """Leave out every edge in turn, refit, and compare; the odds are exp(loss - price), less a doubt.

    `with_poses` is the covariance (2 n, 2 n) of the lines where the poses are estimated, too.
    """
    price = search.least_gain(found.value + PRICE * len(found.walls))
    few = found.wave and search.few_wave.evaluate(found.wave.walls, found.wave, FULL_ORDER)
    losses = np.empty(len(found.walls))
    bounding = np.zeros(len(found.walls), np.bool_)
    for wall in range(len(found.walls)):
        search.checkpoint()
        if found.wave is not None and few is not None:
            losses[wall], bounding[wall] = _wave_loss(search, found.wave, few, wall, max(OBVIOUS, price))
        else:
            losses[wall], bounding[wall] = _power_loss(search, found.power, wall)
    likelihood = expit(losses - price)
    # Where much is left unexplained, a wall that is not there may explain some of it.
    doubt = np.clip((found.explained + search.uncertainty) / _TRUSTED, 0.0, 1.0)
    if found.wave is None and (search.coherent or search.dispersed):
        doubt *= _OUT_OF_PHASE
    silent = np.abs(found.walls.reflection) < SILENT
    covariance = _covariance(search, found) if with_poses is None else with_poses.copy()
    pulse, offsets = search.data.pulse, np.arange(0, len(covariance), 2)
    cycle_m = np.pi / pulse.carrier if found.wave is not None else pulse.width_m
    covariance[offsets, offsets] += (_CYCLE_ERROR * cycle_m) ** 2
    if found.wave is not None and found.wave.loudness.late != 0.0:
        covariance += delay_covariance(search, found.wave)
        covariance[np.ix_(offsets, offsets)] += (_DELAY_ERROR * found.wave.loudness.late) ** 2
    curvature_std, radius = np.empty(0), (0.0, 0.0)
    if found.wave is not None and len(found.walls.bend):
        curvature_std, more = curvature_covariance(search, found.wave)
        covariance += more
    if found.wave is not None and len(found.walls.round):
        radius = corner_radius(search, found.wave)
    vague = np.sqrt(np.diag(covariance)[::2]) > 0.5 * search.data.pulse.width_m
    unsupported = int(np.sum(((bounding & (losses < PRICE)) | silent)[:found.walls.ring]))
    return Certainty(likelihood * np.where(vague, _VAGUE * doubt, doubt), covariance, silent, unsupported,
                     curvature_std, radius)


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
    refitted = search.wave.refine(fewer, FULL_ORDER, 4)
    return wave.value - (refitted or fewer).value, bounding


def _left_out(likelihood: WaveformLikelihood, wave: Wave, wall: int) -> tuple[Wave, bool]:
    """The waveform without a wall, or, where nothing closes without it, with the wall silent."""
    fewer = likelihood.evaluate(wave.walls.without(wall), wave, FULL_ORDER)
    if fewer is not None:
        return fewer, False
    fewer = likelihood.evaluate(wave.walls.silenced(wall), wave, FULL_ORDER)
    assert fewer is not None, 'the walls bound a polygon'
    return fewer, True


def _power_loss(search: Search, power: Power, wall: int) -> tuple[float, bool]:
    fitted = search.power.fitted(power.walls, power, FULL_ORDER)
    assert fitted is not None, 'the walls bound a polygon'
    fewer = search.power.refine(power.walls.without(wall), fitted, FULL_ORDER, 3)
    if fewer is not None:
        return fitted.value - fewer.value, False
    return fitted.value - search.power.value(power.walls.silenced(wall), fitted, FULL_ORDER), True


def _covariance(search: Search, found: Found) -> NDArray[np.float64]:
    """Inverse Fisher information, and the sandwich of the pings' own scores where that is larger.

    The sandwich I^-1 (sum_i s_i s_i^T) I^-1 grows with what the model does not know, such as errors of position; it is
    scaled up by its degrees of freedom, N / (N - 3).
    """
    support: Power | Wave | None = found.wave
    if found.wave is None:
        support = search.power.evaluate(found.walls, found.power, FULL_ORDER, derive=True)
    assert support is not None, 'the walls bound a polygon'
    assert support.slopes is not None, 'a waveform that was refined has them'
    information, scores = information_of(support), support.slopes.scores
    inverse = by_scores = covariance_of(information)
    if search.whole is not None and found.wave is not None:
        by_scores = np.asarray(np.linalg.inv(information - corner_slopes(search.whole, found.wave, information)))
        inverse = by_scores @ information @ by_scores.T
    centred = scores - scores.mean(axis=0)
    pings = len(scores)
    spread = by_scores @ (centred.T @ centred) @ by_scores.T * (pings / max(pings - 3, 1))
    plain, robust = Walls.of_lines(inverse), np.diag(Walls.of_lines(spread))
    factor = np.maximum(1.0, np.mean((robust / np.maximum(np.diag(plain), 1e-300)).reshape(-1, 2), axis=1))
    factor = np.repeat(np.sqrt(factor), 2)
    covariance: NDArray[np.float64] = plain * np.outer(factor, factor)
    return covariance
