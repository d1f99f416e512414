r"""What odometry says of neighbouring poses: increments with the errors that wheels make, and now and then a slip.

From pose i - 1 to pose i the robot reports a way b, seen from pose i - 1, and a turn a. With poses (x, psi) the
increment's error is

    e = (R(psi_{i-1})^T (x_i - x_{i-1}) - b,  psi_i - psi_{i-1} - a),

and over one step of length d, for a robot that turns before it drives, its covariance along b, across it and in heading
is

    s_aa = k_d^2 d + f^2,   s_cc = d^2 (s_t^2 + s_w^2 / 3) + f^2,   s_ch = d (s_t^2 + s_w^2 / 2),   s_hh = s_t^2 + s_w^2

with s_t = k_t \|a\| and s_w^2 = k_h^2 d: random walks of distance and heading, and a share of each turn. Over several
steps, as between two kept pings, an error of the heading acts on all that is driven after it (`hearing.odometer`). The
distribution is Student's with a few degrees of freedom: a wheel that slips makes an error of many deviations, which
would bend all other poses if it were taken for a Gaussian's. What drivers send as covariances is not looked at: it is
zeros or worse.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.lines import wrapped
from polymap_ros.geometry.poses import between
from polymap_ros.hearing.odometer import odometer_sums
from polymap_ros.slam_parameters import SlamParameters

FLOOR_M, FLOOR_RAD = 5e-4, 1e-3
"""Errors of an increment, however short: of counting, of rounding, and of the time to which a pose belongs."""

FREEDOM = 4.0
"""Degrees of freedom of the errors: tails in which an error of a hundred deviations along one axis costs 27 nats."""

MEDIAN_OF_TWO = 1.386
"""Median of the sum of two squared Gaussians, 2 ln 2: of an increment's three errors headings, which are free, take
one."""

_SOME = 8
"""Poses from which their median tells something."""

_SCALE_ROUNDS = 4
"""Regressions by which a scale is found: of 3 % the first leaves a fifth, since an error tells less the larger it is.
"""

_GAUSSIAN = 1e9
"""As many that the distribution is a Gaussian."""

SLIP = 50.0
"""Squared error, in units of its covariance, from which an increment is a slip: one in 10^10 of a Gaussian, and of
levels that are twice what is assumed one in 10^3."""


NOISIER = 25.0
"""How much larger than assumed the odometry's covariance may be, by which slips are told: the random walks of the
level `bad` are four times, and a mirror image makes of a turn of 20 deg an error of some thousands."""


@dataclass(frozen=True)
class OdometryNoise:
    """Assumed errors: `distance` [m per sqrt m], `heading` [rad per sqrt m], and `turn`, a share of every turn.

    Beside these of wheels, `place` [m], by which each reported position is off by itself. Increments are taken to err
    by it independently: that the errors of neighbouring ones are opposite is left out, which tells less than there is.
    """

    distance: float
    heading: float
    turn: float
    place: float = 0.0

    @classmethod
    def assumed(cls, slam: SlamParameters) -> 'OdometryNoise':
        """Return what the parameters assume."""
        return cls(slam.noise_m_sqrt_m, float(np.deg2rad(slam.noise_deg_sqrt_m)), slam.noise_turn)

    def times(self, factor: float) -> 'OdometryNoise':
        """Return the same with errors of wheels as many times as large."""
        return OdometryNoise(factor * self.distance, factor * self.heading, factor * self.turn, self.place)

    def straight_on(self, way_m: float) -> NDArray[np.float64]:
        """Return the covariance (3, 3) of (along, across, heading) over a straight way."""
        poses = np.array([(0.0, 0.0, 0.0), (way_m, 0.0, 0.0)])
        return np.asarray(Increments.of(poses, odometer_sums(poses), self).covariance[0])

    def covariance(self, way: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return that of the errors of x, y and heading, (n, 3, 3), at the `ends` (n, 2) of ways (n, SUMS)."""
        count, to_x, to_y, xx, xy, yy = (self.heading**2 * way[:, :6] + self.turn**2 * way[:, 6:12]).T
        (x, y), (along_xx, along_xy, along_yy) = ends.T, self.distance**2 * way[:, 12:].T
        covariance = np.empty((len(way), 3, 3))
        covariance[:, 0, 0] = along_xx + y * (count * y - 2.0 * to_y) + yy
        covariance[:, 1, 1] = along_yy + x * (count * x - 2.0 * to_x) + xx
        covariance[:, 0, 1] = covariance[:, 1, 0] = along_xy - count * x * y + x * to_y + y * to_x - xy
        covariance[:, 0, 2] = covariance[:, 2, 0] = to_y - count * y
        covariance[:, 1, 2] = covariance[:, 2, 1] = count * x - to_x
        covariance[:, 2, 2] = count
        values, axes = np.linalg.eigh(covariance)  # far from the start rounding makes some negative
        kept = np.maximum(values, 0.0)[:, None, :] * axes @ np.swapaxes(axes, 1, 2)
        each = FLOOR_M**2 + 2.0 * self.place**2
        return np.asarray(kept + np.diag((each, each, FLOOR_RAD**2)))


@dataclass(frozen=True, eq=False)
class Increments:
    """Increments between poses in the order of time.

    Parameters
    ----------
    increments : ndarray, shape (N - 1, 3)
        b [m] and a [rad].
    covariance : ndarray, shape (N - 1, 3, 3)
        Of their errors, in the axes of b.
    freedom : float
        Degrees of freedom of their distribution.
    least : float
        Squared error from which an increment tells less the larger it is.
    """

    increments: NDArray[np.float64]
    covariance: NDArray[np.float64]
    freedom: float = FREEDOM
    least: float = 0.0

    @classmethod
    def of(
        cls, poses: NDArray[np.float64], way: NDArray[np.float64], noise: OdometryNoise
    ) -> 'Increments':
        """Return what reported poses (N, 3) say, with the way (N, SUMS) added up to each."""
        covariance = noise.covariance(np.diff(way, axis=0), poses[1:, :2])
        to_body = turns(-poses[:-1, 2])
        return cls(between(poses[:-1], poses[1:]), to_body @ covariance @ np.swapaxes(to_body, 1, 2))

    def trusted(self) -> 'Increments':
        """Return the same with Gaussian errors, among which no slip is expected."""
        return replace(self, freedom=_GAUSSIAN)

    def expected(self) -> 'Increments':
        """Return the same, of which none tells more than one is expected to, (nu + 3) / (nu + 5): for deviations."""
        return replace(self, least=5.0)

    def loosened(self, poses: NDArray[np.float64], most: float) -> 'Increments':
        """Return the same with the covariance that the errors at poses that echoes have told show, where it is larger.

        It grows by a factor `most` at most.
        """
        spread = float(np.median(self.squares(poses))) / MEDIAN_OF_TWO if len(poses) > _SOME else 1.0
        return replace(self, covariance=min(max(spread, 1.0), most) * self.covariance)

    def errors(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return e (N - 1, 3) at poses (N, 3)."""
        x, y, turn = (between(poses[:-1], poses[1:]) - self.increments).T
        return np.column_stack((x, y, wrapped(turn)))

    def squares(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the squared errors (N - 1,) in units of their covariance."""
        errors = self.errors(poses)
        squares: NDArray[np.float64] = np.einsum('ij,ijk,ik->i', errors, self._information, errors)
        return squares

    def weights(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what each increment tells at poses (N, 3), (N - 1, 3, 3): less the farther it is off."""
        weight = (self.freedom + 3.0) / (self.freedom + np.maximum(self.squares(poses), self.least))
        return np.asarray(weight[:, None, None] * self._information)

    def scale(self, poses: NDArray[np.float64]) -> tuple[float, float]:
        """Return the length of the ways over that between poses (N, 3), and its deviation; slips tell next to nothing.

        By linear regression of the errors on the ways, again with those that the scale explains taken off.
        """
        scale = told = 1.0
        for _ in range(_SCALE_ROUNDS):
            scaled = replace(self, increments=self.increments / (scale, scale, 1.0))
            ways, known = scaled.increments * (1.0, 1.0, 0.0), scaled.weights(poses)
            told = float(np.einsum('ij,ijk,ik', ways, known, ways))
            if told <= 0.0:  # the robot stood
                return 1.0, np.inf
            scale /= 1.0 + float(np.einsum('ij,ijk,ik', ways, known, scaled.errors(poses))) / told
        return scale, told**-0.5

    def log_prior(self, poses: NDArray[np.float64]) -> float:
        """Return the log density of the errors, over that without any."""
        return -0.5 * (self.freedom + 3.0) * float(np.sum(np.log1p(self.squares(poses) / self.freedom)))

    def derivatives(self, poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the gradient (3 N,) of the log density by the poses, one after the other, and its information."""
        n, errors = len(poses), self.errors(poses)
        before, after = by_ends(poses[:-1], poses[1:])
        known = self.weights(poses)
        slope = np.einsum('ijk,ik->ij', known, errors)
        gradient, information = np.zeros((n, 3)), np.zeros((n, n, 3, 3))
        gradient[:-1] -= np.einsum('ijk,ij->ik', before, slope)
        gradient[1:] -= np.einsum('ijk,ij->ik', after, slope)
        i = np.arange(n - 1)
        information[i, i] += np.swapaxes(before, 1, 2) @ known @ before
        information[i + 1, i + 1] += np.swapaxes(after, 1, 2) @ known @ after
        information[i, i + 1] = np.swapaxes(before, 1, 2) @ known @ after
        information[i + 1, i] = np.swapaxes(information[i, i + 1], 1, 2)
        return gradient.ravel(), information.transpose(0, 2, 1, 3).reshape(3 * n, 3 * n)

    @cached_property
    def _information(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.inv(self.covariance), dtype=np.float64)


def turns(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return matrices (n, 3, 3) that turn (x, y, heading) by angles (n,)."""
    c, s = np.cos(angles), np.sin(angles)
    matrices = np.zeros((len(c), 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = c
    matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 2, 2] = -s, s, 1.0
    return matrices


def by_ends(
    before: NDArray[np.float64], after: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the derivatives (n, 3, 3) of `between` by the poses before and after."""
    to_body = np.swapaxes(turns(before[:, 2]), 1, 2)
    by_before = -to_body
    x, y, _ = between(before, after).T
    by_before[:, 0, 2], by_before[:, 1, 2] = y, -x
    return by_before, to_body
