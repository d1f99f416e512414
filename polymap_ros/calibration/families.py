"""What may be wrong with medium or odometry, as few numbers each: the families that a calibration looks through."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.medium import group_speed, make_medium
from polymap_ros.errors import ParameterError
from polymap_ros.parameters import Parameters

Vector = NDArray[np.float64]


class View(NamedTuple):
    """How echoes that were filtered at one point of a family look from another one nearby, without filtering anew.

    Ranges are to be multiplied by `zoom`, and `shift_m` added; `carrier` [rad/m] is what the pulse's own wavenumber
    changes by, per metre of the range axis as it was filtered. `parameters` give the positions.
    """

    parameters: Parameters
    zoom: float
    carrier: float
    shift_m: float = 0.0


class Family(Protocol):
    """Parameters that a vector p stands for."""

    fine: Vector
    """Step of p by which ranges of 1 m change by about half a millimetre."""

    grid: Vector
    """Steps of the grid of `near`."""

    given: Vector
    """Where the given parameters are."""

    def values(self, p: Vector) -> dict[str, float] | None:
        """The parameters' values at p; None where there are none."""

    def coarse(self) -> list[Vector]:
        """Points at which to measure the focus without phase: a row."""

    def near(self, p: Vector) -> list[Vector]:
        """Points about the sharpest of these at which to measure the focus with phase."""

    def view(self, p: Vector, q: Vector) -> View:
        """How what was filtered at p looks at q."""


class _Media:
    """What the families of media share."""

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self._omega = 2.0 * np.pi * parameters.pulse.frequency_hz

    def _wave(self, parameters: Parameters) -> tuple[float, float]:
        """Group speed [m/s] and wavenumber [rad/m] at the pulse's frequency."""
        medium = make_medium(parameters.medium)
        return (float(group_speed(medium, parameters.pulse.frequency_hz)), float(medium.wavenumber(self._omega)))

    def _seen(self, before: Parameters, after: Parameters) -> View:
        # An echo from d lies at d / zoom on the axis of `before`, with phase 2 d (k_before / zoom - k_after).
        (speed, k), (new_speed, new_k) = self._wave(before), self._wave(after)
        zoom = new_speed / speed
        return View(before, zoom, zoom * new_k - k)


class Thickness(_Media):
    """Thickness of a plate; p is its logarithm."""

    names: tuple[str, ...] = ('medium.thickness_m',)
    _REACH, _STEP = np.log(2.0), 0.05

    def __init__(self, parameters: Parameters) -> None:
        super().__init__(parameters)
        self.given = np.log([parameters.medium.thickness_m])
        self.fine, self.grid = np.array([0.0007]), np.array([0.002])

    def values(self, p: Vector) -> dict[str, float] | None:
        return {self.names[0]: float(np.exp(p[0]))}

    def coarse(self) -> list[Vector]:
        return [self.given + offset for offset in _steps(self._REACH, self._STEP)]

    def near(self, p: Vector) -> list[Vector]:
        return [p + offset for offset in _steps(1.2 * self._STEP, float(self.grid[0]))]

    def view(self, p: Vector, q: Vector) -> View:
        return self._seen(*(self.parameters.replaced(self.values(point) or {}) for point in (p, q)))


class Speed(Thickness):
    """A constant speed; p is its logarithm."""

    names = ('medium.speed_m_s',)
    _REACH, _STEP = 0.3, 0.01

    def __init__(self, parameters: Parameters) -> None:
        super().__init__(parameters)
        self.given = np.log([parameters.medium.speed_m_s])
        self.fine, self.grid = np.array([0.0004]), np.array([0.0007])


class Plate(_Media):
    """Thickness and shear speed of a plate; p is the logarithms of the group and of the phase speed that they lead to.

    The group speed places the echoes, the phase speed turns them along a wall: these are what is heard. The
    longitudinal speed, which hardly matters to A0, is kept.

    Parameters
    ----------
    parameters : Parameters
        Their medium is the best that thickness alone can do.
    """

    names = ('medium.thickness_m', 'medium.shear_speed_m_s')

    def __init__(self, parameters: Parameters) -> None:
        super().__init__(parameters)
        self.fine, self.grid = np.array([0.0004, 0.0004]), np.array([0.006, 0.002])
        self.given = self._point(parameters)

    def _point(self, parameters: Parameters) -> Vector:
        speed, k = self._wave(parameters)
        return np.log((speed, self._omega / k))

    def values(self, p: Vector) -> dict[str, float] | None:
        try:
            return self._solved(p)
        except ParameterError:  # on its way beyond what is allowed
            return None

    def _solved(self, p: Vector) -> dict[str, float] | None:
        """Newton's method on the logarithms of thickness and shear speed."""
        at = np.log((self.parameters.medium.thickness_m, self.parameters.medium.shear_speed_m_s))
        highest = np.log(0.98 * self.parameters.medium.longitudinal_speed_m_s)
        for _ in range(12):
            error = self._at(at) - p
            if np.max(np.abs(error)) < 1e-10:
                return dict(zip(self.names, np.exp(at).tolist(), strict=True))
            slopes = np.column_stack([(self._at(at + step) - self._at(at - step)) / 2e-4 for step in 1e-4 * np.eye(2)])
            at = at - np.clip(np.linalg.lstsq(slopes, error, rcond=None)[0], -0.3, 0.3)
            at[1] = min(at[1], highest)
        return None

    def _at(self, logarithms: Vector) -> Vector:
        return self._point(self.parameters.replaced(dict(zip(self.names, np.exp(logarithms).tolist(), strict=True))))

    def coarse(self) -> list[Vector]:
        return [self.given]

    def near(self, p: Vector) -> list[Vector]:
        return [p + (group, phase) for group in _steps(0.048, self.grid[0]) for phase in _steps(0.08, self.grid[1])]

    def view(self, p: Vector, q: Vector) -> View:
        zoom = float(np.exp(q[0] - p[0]))
        k, new_k = self._omega * np.exp(-np.array((p[1], q[1])))
        return View(self.parameters, zoom, float(zoom * new_k - k))


class Odometry:
    """Scale and yaw drift of the odometry; p is the logarithm of the scale, and the drift [deg/m]."""

    names = ('odometry.scale', 'odometry.yaw_drift_deg_m')
    _DRIFT, _STEP = 5.0, 0.25

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.fine, self.grid = np.array([0.0008, 0.008]), np.array([0.0025, 0.05])
        odometry = parameters.odometry
        self.given = np.array((np.log(odometry.scale), odometry.yaw_drift_deg_m))

    def values(self, p: Vector) -> dict[str, float] | None:
        return {'odometry.scale': float(np.exp(p[0])), 'odometry.yaw_drift_deg_m': float(p[1])}

    def coarse(self) -> list[Vector]:
        return [self.given + (0.0, drift) for drift in _steps(self._DRIFT, self._STEP)]

    def near(self, p: Vector) -> list[Vector]:
        return [p + (scale, drift) for scale in _steps(0.04, self.grid[0]) for drift in _steps(0.5, self.grid[1])]

    def view(self, p: Vector, q: Vector) -> View:
        return View(self.parameters.replaced(self.values(q) or {}), 1.0, 0.0)


class TimeZero:
    """Time of the first sample after emission; p is the range by which it moves all echoes [m].

    Echoes of first order tell nothing of it: all walls move by as much. Those of higher order hit more walls, and are
    in their places with one time zero only.
    """

    names = ('echo.t0_s',)
    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.fine, self.grid, self.given = np.array([0.0005]), np.array([0.002]), np.zeros(1)
        self._speed = float(group_speed(make_medium(parameters.medium), parameters.pulse.frequency_hz))

    def values(self, p: Vector) -> dict[str, float] | None:
        return {self.names[0]: self.parameters.echo.t0_s + 2.0 * float(p[0]) / self._speed}

    def row(self, p: Vector, reach_m: float) -> list[Vector]:
        """Thirteen points about p that reach so far to either side."""
        return [p + offset for offset in _steps(reach_m, reach_m / 6.0)]

    def coarse(self) -> list[Vector]:
        return [self.given]

    def near(self, p: Vector) -> list[Vector]:
        return [p]

    def view(self, p: Vector, q: Vector) -> View:
        return View(self.parameters, 1.0, 0.0, float(q[0] - p[0]))


def _steps(reach: float, step: float | np.floating) -> Vector:
    """Multiples of a step from -reach to reach."""
    count = int(np.ceil(reach / step))
    return np.asarray(step * np.arange(-count, count + 1), dtype=float)
