"""A ping placed in the plane: what the map, the free area and the solvers are made from."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.odometer import SUMS

_ON_THE_AXIS = Pose(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Sounding:
    """One processed ping in the start frame.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the ping [ns].
    x, y : float
        Position of the sensor in the start frame [m].
    echo : ndarray, shape (n_fine,), complex64
        Eq. (3) as an analytic signal over the fine axis; its real part is eq. (3), its magnitude the envelope.
    envelope : ndarray, shape (n_ranges,), float32
        e_i(r), the magnitude of `echo`.
    rho : float
        Closest range [m]; nan where no echo stands out.
    noise : float
        Standard deviation of the noise in the real part of `echo`.
    confidence : float
        How sure it is that an echo, not noise, is at `rho`; see `ranging.confidence`.
    heard_m : float
        Range up to which echoes are over before the ping is; see `MatchedFilter` [m].
    yaw : float
        Heading of the sensor in the start frame [rad].
    mount : Pose
        The sensor's place on the robot.
    way : ndarray, shape (SUMS,)
        What the robot has driven by its odometry; see `Odometer.sums`.
    """

    stamp_ns: int
    x: float
    y: float
    echo: NDArray[np.complex64]
    envelope: NDArray[np.float32]
    rho: float
    noise: float = 1.0
    confidence: float = 1.0
    heard_m: float = np.inf
    yaw: float = 0.0
    mount: Pose = _ON_THE_AXIS
    way: NDArray[np.float64] = field(default_factory=lambda: np.zeros(SUMS))

    @property
    def base(self) -> Pose:
        """The pose of the robot's base in the start frame."""
        return Pose(self.x, self.y, self.yaw).compose(self.mount.inverse())

    def __repr__(self) -> str:
        return (f'Sounding(stamp_ns={self.stamp_ns}, x={self.x:.4g}, y={self.y:.4g}, rho={self.rho:.4g}, echo: '
                f'{self.echo.size} ranges)')
