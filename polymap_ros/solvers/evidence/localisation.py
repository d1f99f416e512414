"""Where a ping was heard, given the walls: the pose at which they explain it best, near where odometry expects it."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import are_inside, corners_of
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.likelihood import Slopes
from polymap_ros.solvers.evidence.odometry import by_ends
from polymap_ros.solvers.evidence.power import Power, PowerLikelihood
from polymap_ros.solvers.evidence.search import Found
from polymap_ros.solvers.evidence.tuning import FULL_ORDER, SEARCH_ORDER
from polymap_ros.solvers.evidence.waveform import WaveformLikelihood

_COARSE, _FINE = 0.3, 0.13
"""Steps of the places tried, in cycles of range: by power, and in phase."""

_DEVIATIONS = 3.0
"""Deviations of the prior within which places are tried."""

_MAXIMA, _CLIMBED = 4, 3
"""Places, the best by power, that are looked at in phase, and of those found there that are climbed from."""

_WIDER_M = 0.012, 0.04, 0.15
"""By how much the odometry may be off besides, where a ping is not found: near a wall, after a slip, after a push."""

_WIDER_RAD = 0.3
"""The same of the heading [rad], where it is off by the most."""

MISLED = 0.75
"""Share of what a ping should be worth below which it is looked for in phase over the whole prior: near a wall the
maximum of power misleads by a cycle. At right poses the share is 0.90 to 1.07, at wrong ones 0.6 at most."""

_MOST_PLACES, _MOST_IN_PHASE = 60_000, 4_000
"""Places that are tried at most, by power, of which more lie farther apart, and in phase."""

_KEEPS_WITHIN = 0.25
"""Cycles of range within which a climb in phase keeps to its maximum: the longest step, and how far starts are apart.
"""

_STEPS_AT_MOST, _SHORTER_STEP, _GAINED_NOTHING = 6, 0.3, 0.01
"""Steps of a climb, the share of a step that led down that is tried next, and nats that are not worth another."""

_TRIED_AT_ONCE = 2**17
"""Cells of range of the places tried in one go: what a processor's cache holds."""


class Prior(NamedTuple):
    """Where a pose (3,) is expected, and the covariance (3, 3) of that."""

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]

    def wider(self, by_m: float) -> 'Prior':
        """Return the same with less faith."""
        turn = _WIDER_RAD * min(by_m / _WIDER_M[-1], 1.0)
        return self._replace(covariance=self.covariance + np.diag((by_m, by_m, turn)) ** 2)

    def next(
        self, expected: NDArray[np.float64], noise: NDArray[np.float64], backwards: bool
    ) -> 'Prior':
        """Return what is expected of the neighbour, with the covariance (3, 3) of the increment between the two."""
        ends = (expected, self.pose) if backwards else (self.pose, expected)
        before, after = (matrix[0] for matrix in by_ends(ends[0][None], ends[1][None]))
        mine, other = (after, before) if backwards else (before, after)
        back = np.linalg.inv(other)
        return Prior(expected, back @ (noise + mine @ self.covariance @ mine.T) @ back.T)


class Fix(NamedTuple):
    """A pose (3,) with its covariance (3, 3), and what the ping is worth there.

    That is its share [nats] of the log likelihood, over its gain; `wider_m` says how much farther than expected the
    ping was looked for.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    worth: float
    wider_m: float = 0.0


class Localiser:
    """Places pings of `data` between walls that were found.

    `level` is what a ping is worth at the right pose, over its gain [nats].
    """

    def __init__(self, data: EchoData, found: Found, level: float) -> None:
        self._data, self._found, self._level = data, found, level
        self._power = data.without_phase()
        self._cycle_m = data.shortest_m
        self._extent_m = float(np.hypot(*np.ptp(corners_of(found.lines)[1], axis=0)))

    def place(self, ping: int, prior: Prior, widest_m: float = np.inf) -> Fix:
        """Return the best pose, looked for the wider the less is found; wider than the prior by so much at most.

        Of the many places far away some fit by chance: there a ping has to be worth as much as at its right pose.
        """
        best = self._near(ping, prior, whole=False)
        if best.worth < MISLED * self._level and self._is_small(prior):
            best = max(best, self._near(ping, prior, whole=True), key=_worth)
        for by_m in _WIDER_M:
            if best.worth >= MISLED * self._level or by_m > widest_m:
                break
            wider = self._near(ping, prior.wider(by_m), whole=False)._replace(wider_m=by_m)
            if by_m < _WIDER_M[-1] or wider.worth >= MISLED * self._level:
                best = max(best, wider, key=_worth)
        return best

    def place_in_phase(self, ping: int, prior: Prior) -> Fix:
        """Return the best pose in phase, looked for all over a prior of some cycles."""
        return self._near(ping, prior, whole=True)

    def _is_small(self, prior: Prior) -> bool:
        """Whether all of a prior can be looked at in phase."""
        area_m2 = (2.0 * _DEVIATIONS) ** 2 * np.sqrt(max(float(np.linalg.det(prior.covariance[:2, :2])), 0.0))
        return bool(area_m2 < _MOST_IN_PHASE * (_FINE * self._cycle_m) ** 2)

    def _near(self, ping: int, prior: Prior, whole: bool) -> Fix:
        """Return the best pose within a prior; in phase over the whole of it, or where power has its maxima."""
        known = np.asarray(np.linalg.inv(prior.covariance), dtype=float)
        if whole or self._found.wave is None:
            poses = self._grid(prior, _FINE if self._found.wave else _COARSE)
        else:
            poses = self._grid(prior, _COARSE)
            values = self._by_power(ping, poses) - _cost(poses - prior.pose, known)
            steps = self._cycle_m * _FINE * np.arange(-2, 3)
            around = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
            middles = _apart(poses, values, self._cycle_m)
            poses = np.concatenate([_with_heading(prior, middle[:2] + around) for middle in middles])
        values = self._shares(ping, poses) - _cost(poses - prior.pose, known)
        return self._climbed(ping, _apart(poses, values, _KEEPS_WITHIN * self._cycle_m)[:_CLIMBED], prior.pose, known)

    def _grid(self, prior: Prior, step: float) -> NDArray[np.float64]:
        """Return poses (n, 3) within the prior and the walls, so many cycles apart."""
        variances, axes = np.linalg.eigh(prior.covariance[:2, :2])
        reach = np.minimum(_DEVIATIONS * np.sqrt(np.maximum(variances, 0.0)), self._extent_m)
        step_m = max(step * self._cycle_m, float(np.sqrt(np.prod(2.0 * reach) / _MOST_PLACES)))
        steps = [step_m * np.arange(-(n := int(r / step_m) + 1), n + 1) for r in reach]
        offsets = np.stack(np.meshgrid(*steps, indexing='ij'), axis=-1).reshape(-1, 2)
        within = np.sum((offsets / (reach + step_m)) ** 2, axis=1) <= 1.0
        poses = _with_heading(prior, prior.pose[:2] + offsets[within] @ axes.T)
        inside = are_inside(corners_of(self._found.lines)[1], self._data.sensors(poses))
        return poses[inside] if np.any(inside) else prior.pose[None]

    def _by_power(self, ping: int, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        return placed_by_power(self._power, self._found.power.with_walls(self._found.walls), ping, poses)

    def _shares(self, ping: int, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._found.wave is None:
            return self._by_power(ping, poses)
        return np.concatenate([WaveformLikelihood(_heard(self._data, ping, some)).shares(self._found.wave, FULL_ORDER)
                               for some in _in_turn(poses, self._data)])

    def _slopes(self, ping: int, poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], Slopes]:
        data = _heard(self._data, ping, poses)
        if self._found.wave is None:
            return PowerLikelihood(data).by_ping(self._found.power, FULL_ORDER)
        return WaveformLikelihood(data).by_ping(self._found.wave, FULL_ORDER)

    def _climbed(
        self, ping: int, poses: NDArray[np.float64], expected: NDArray[np.float64], known: NDArray[np.float64]
    ) -> Fix:
        """Return the best of the maxima near poses (n, 3), by Gauss-Newton on all of them at a time."""
        best, top = -np.inf * np.ones(len(poses)), poses
        trial, shares, information = poses, np.zeros(len(poses)), np.zeros((len(poses), 3, 3))
        step = np.zeros_like(poses)
        for _ in range(_STEPS_AT_MOST):
            value, slopes = self._slopes(ping, trial)
            total = value - _cost(trial - expected, known)
            by_pose = self._found.walls.by_pose(trial)
            gradient = np.einsum('ijk,ij->ik', by_pose, slopes.scores) - (trial - expected) @ known
            bend = np.swapaxes(by_pose, 1, 2) @ slopes.information @ by_pose + known
            better = total > best
            gained = float(np.max(np.where(better, total - best, 0.0)))
            top = np.where(better[:, None], trial, top)
            best, shares = np.where(better, total, best), np.where(better, value, shares)
            information = np.where(better[:, None, None], bend, information)
            fresh = np.linalg.solve(bend, gradient[:, :, None])[:, :, 0]
            step = np.where(better[:, None], fresh, _SHORTER_STEP * step)
            if gained < _GAINED_NOTHING:
                break
            limit = _KEEPS_WITHIN * self._cycle_m
            step = step * np.minimum(1.0, limit / np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-12))[:, None]
            trial = top + step
        i = int(np.argmax(best))
        return Fix(top[i], np.linalg.inv(information[i]), float(shares[i]) / float(self._data.gain[ping]))


def placed_by_power(data: EchoData, like: Power, ping: int, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a ping of `data` is worth (n,) at poses (n, 3) between the walls of `like` by power of low orders."""
    shares = []
    for some in _in_turn(poses, data):
        likelihood = PowerLikelihood(_heard(data, ping, some))
        power = likelihood.evaluate(like.walls, like, SEARCH_ORDER)
        assert power is not None, 'the walls bound a polygon'
        shares.append(likelihood.shares(power))
    return np.concatenate(shares)


def _in_turn(poses: NDArray[np.float64], data: EchoData) -> Iterator[NDArray[np.float64]]:
    at_once = max(_TRIED_AT_ONCE // data.power.shape[1], 1)
    return (poses[first:first + at_once] for first in range(0, len(poses), at_once))


def _heard(data: EchoData, ping: int, poses: NDArray[np.float64]) -> EchoData:
    return data.chosen(np.full(len(poses), ping)).at(poses)


def _worth(placed: Fix) -> float:
    return placed.worth


def _cost(away: NDArray[np.float64], known: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.5 * np.einsum('ij,jk,ik->i', away, known, away))


def _with_heading(prior: Prior, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places (n, 2) with the heading that is most likely there: a way that ends elsewhere went elsewhere."""
    covariance = prior.covariance
    slope = np.linalg.solve(covariance[:2, :2], covariance[:2, 2])
    return np.column_stack((places, prior.pose[2] + (places - prior.pose[:2]) @ slope))


def _apart(poses: NDArray[np.float64], values: NDArray[np.float64], least_m: float) -> NDArray[np.float64]:
    """Return the poses with the highest values, `_MAXIMA` at most and so far from each other."""
    chosen: list[NDArray[np.float64]] = []
    for pose in poses[np.argsort(-values)]:
        if all(np.hypot(*(pose - other)[:2]) > least_m for other in chosen):
            chosen.append(pose)
            if len(chosen) == _MAXIMA:
                break
    return np.array(chosen)
