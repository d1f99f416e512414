"""The echoes as the likelihoods read them: in units of the noise, as a signal and as power in cells of range."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from polymap_ros.geometry.poses import onward
from polymap_ros.hearing.pulse_shape import PulseShape
from polymap_ros.hearing.sounding import Sounding
from polymap_ros.solvers.evidence.early_noise import early_noise

CELLS_PER_WIDTH = 3.0
"""Cells of range per independent width of the pulse: fine enough that the power is smooth between them."""

_WEAK = 0.7
"""A ping's quietest fifth below this share of the noise says that the noise counts for more than it is. By chance it is
that far below 1 in one or two pings of a hundred (measured), which does them no harm."""

_UNHEARD = 1e-4
"""Share of what is heard that is left away with the end of the range axis: pings may be over before it."""


_SOFT = 0.1
"""Share of a cycle of range over which a wall's end is soft: what the ends of walls move by while they are found."""


@dataclass(frozen=True, eq=False)
class EchoData:
    """Pings as arrays.

    Attributes
    ----------
    positions : ndarray, shape (N, 2)
        Sensor positions in the start frame [m], half way between emitter and receiver.
    baselines : ndarray, shape (N, 3)
        From emitter to receiver [m]: in the start frame's x and y, and up.
    signal : ndarray, shape (N, n_ranges), complex64
        Eq. (3) without the pulse's carrier, scaled so that the noise has variance 1 in its real and imaginary part.
    power : ndarray, shape (N, n_cells)
        Half the squared magnitude at multiples of `cell_m`: exponential with mean 1 where there is noise only.
    filling : ndarray, shape (N,)
        What was added to a ping's power, whose noise is weaker than it counts, to make its mean 1 without echoes.
    gain : ndarray, shape (N,)
        Power of each ping's echoes relative to the median ping.
    first_cell : int
        Cells before this are blanked.
    range_max_m : float
        Echoes beyond this are not predicted [m]: the end of the axis, or of what is heard.
    cell_m : float
        Step of the cells [m].
    pulse : PulseShape
        The compressed pulse.
    spreading : float
        Amplitude ~ distance**-spreading.
    poses : ndarray, shape (N, 3)
        x, y [m] and yaw [rad] of the robot's base in the start frame, to which the device is fixed.
    first_m : ndarray, shape (N,)
        Range of each ping's first echo [m].
    arm_m : tuple of float
        x and y of the device on the robot, and of its baseline there.
    foot_limits : tuple of float
        Least and most evidence [nats] that one ping may bring for or against a wall where walls are proposed.
    louder : float
        Power of the noise over what the pings' own noise says.
    """

    positions: NDArray[np.float64]
    baselines: NDArray[np.float64]
    signal: NDArray[np.complex64]
    power: NDArray[np.float64]
    filling: NDArray[np.float64]
    gain: NDArray[np.float64]
    first_cell: int
    range_max_m: float
    cell_m: float
    pulse: PulseShape
    spreading: float
    poses: NDArray[np.float64]
    first_m: NDArray[np.float64]
    arm_m: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    foot_limits: tuple[float, float] = (-np.inf, np.inf)
    louder: float = 1.0

    def at(self, poses: NDArray[np.float64]) -> 'EchoData':
        """Return the same pings heard at other poses (N, 3) of the robot's base."""
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        along, left = self.arm_m[2:]
        baselines = np.column_stack((c * along - s * left, s * along + c * left, self.baselines[:, 2]))
        return dataclasses.replace(self, positions=self.sensors(poses), baselines=baselines, poses=poses)

    def sensors(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where the device is (n, 2) at poses (n, 3) of the robot's base."""
        sensors = onward(poses, np.tile((*self.arm_m[:2], 0.0), (len(poses), 1)))
        return np.ascontiguousarray(sensors[:, :2])

    def blurred(self, by_m: float) -> 'EchoData':
        """Return the same with power spread over range by a Gaussian of this deviation [m], as its pulse is.

        Walls and poses are then found from farther away, and less well.
        """
        power = gaussian_filter1d(self.power, by_m / self.cell_m, axis=1, mode='nearest')
        return dataclasses.replace(self, power=power, pulse=self.pulse.blurred(by_m))

    def up_to(self, range_m: float) -> 'EchoData':
        """Return the same up to a range [m]; all where that is beyond it, or before half a dozen pulses."""
        if not 6.0 * self.pulse.width_m < range_m < self.range_max_m:
            return self
        power = np.ascontiguousarray(self.power[:, :int(range_m / self.cell_m) + 1])
        return dataclasses.replace(self, power=power, range_max_m=range_m)

    def with_signal(self, signal: NDArray[np.complex64]) -> 'EchoData':
        """Return the same pings with another signal (N, n_ranges), and its power, up to the same range."""
        stride = round(self.cell_m / self.pulse.step_m)
        heard = signal[:, :stride * self.power.shape[1]:stride]
        power = 0.5 * np.abs(heard).astype(float) ** 2 + self.filling[:, None]
        return dataclasses.replace(self, signal=signal, power=np.ascontiguousarray(power))

    def without_phase(self) -> 'EchoData':
        """Return the same with power alone, of which copies for many places are small."""
        return dataclasses.replace(self, signal=np.empty((len(self.signal), 0), np.complex64))

    @cached_property
    def ends(self) -> NDArray[np.float64]:
        """x and y of emitter and receiver, and the height between them, of each ping [m], shape (N, 5)."""
        half = 0.5 * self.baselines[:, :2]
        return np.hstack((self.positions - half, self.positions + half, self.baselines[:, 2:]))

    @property
    def level(self) -> bool:
        """Whether emitter and receiver are at one height."""
        return not np.any(self.baselines[:, 2])

    @cached_property
    def mean_power(self) -> NDArray[np.float64]:
        """Mean of `power` over the pings, shape (n_cells,)."""
        return np.asarray(self.power.mean(axis=0))

    @cached_property
    def excess(self) -> float:
        """Power of the echoes: what all cells hold more than noise does."""
        return max(float(np.sum(self.power[:, self.first_cell:] - 1.0)), 1e-300)

    @property
    def shortest_m(self) -> float:
        """A cycle of range, half a wavelength [m]: a shorter edge reflects as a point does, not as a wall.

        Magnitudes have no cycles: the pulse's width instead.
        """
        return float(np.pi / self.pulse.carrier) if self.pulse.carrier else self.pulse.width_m

    @property
    def soft_m(self) -> float:
        """How far from a wall's end a path begins to count less [m]."""
        return _SOFT * self.shortest_m

    @property
    def weight(self) -> float:
        """Independent cells per cell: what a cell's log likelihood counts."""
        return self.cell_m / self.pulse.width_m

    @property
    def extent_m(self) -> float:
        """Diagonal of the path's bounding box [m], at least one pulse width."""
        return max(float(np.hypot(*np.ptp(self.positions, axis=0))), self.pulse.width_m)

    def every(self, count: int) -> 'EchoData':
        """One ping of so many."""
        return self.chosen(np.arange(len(self.positions)) % count == 0)

    def chosen(self, pings: NDArray[np.bool_] | NDArray[np.int64]) -> 'EchoData':
        """Some of the pings, by a mask or their numbers."""
        return dataclasses.replace(
            self, positions=self.positions[pings], baselines=self.baselines[pings], signal=self.signal[pings],
            power=self.power[pings], filling=self.filling[pings], gain=self.gain[pings], poses=self.poses[pings],
            first_m=self.first_m[pings])

    @classmethod
    def of(
        cls, soundings: Sequence[Sounding], pulse: PulseShape, spreading: float, blanking_m: float,
        baseline_m: tuple[float, float, float] = (0.0, 0.0, 0.0), louder: float | None = None,
    ) -> 'EchoData':
        """Gather soundings, whose echoes lie on one range axis, of a sensor with this baseline (forward, left, up).

        The noise is so many times `louder` than it counts as; by `early_noise` unless that is given.
        """
        mount, (x, y, z) = soundings[0].mount, baseline_m
        c, s = np.cos(mount.yaw), np.sin(mount.yaw)
        bases = [sounding.base for sounding in soundings]
        poses = np.array([(base.x, base.y, base.yaw) for base in bases])
        signal = np.array([sounding.echo for sounding in soundings])
        ranges = pulse.step_m * np.arange(signal.shape[1])
        signal[ranges > np.array([sounding.heard_m for sounding in soundings])[:, None]] = 0.0
        parts = signal.view(np.float32)  # real and imaginary ones in turn
        parts /= np.array([sounding.noise for sounding in soundings], np.float32)[:, None]
        signal *= np.exp(-2j * pulse.carrier * ranges).astype(np.complex64)
        stride = max(1, round(pulse.width_m / CELLS_PER_WIDTH / pulse.step_m))
        power = 0.5 * np.abs(signal[:, ::stride]).astype(float) ** 2
        heard = np.cumsum(power.sum(axis=0))
        width = len(pulse.power)
        end, last = int(np.searchsorted(heard, (1.0 - _UNHEARD) * heard[-1])) * stride, len(ranges) - width - 4
        if end < last:  # pings are over before the axis is
            last = max(end - width, 0)
        power = power[:, :last // stride + 1]
        first = min(int(np.ceil(max(blanking_m, pulse.width_m) / (stride * pulse.step_m))), power.shape[1] - 1)
        first_m = np.array([sounding.rho for sounding in soundings])
        if louder is None:  # quieter noise is `filling`
            louder = max(early_noise(power, first, first_m, stride * pulse.step_m, pulse.width_m), 1.0)
        if louder > 1.0:
            signal *= np.float32(louder**-0.5)
            power = power / louder
        quietest = power.shape[1] // 5
        quiet = np.partition(power, quietest, axis=1)[:, quietest] / -np.log(0.8)  # of an exponential's mean
        filling = np.where(quiet < _WEAK, 1.0 - quiet, 0.0)
        power += filling[:, None]
        excess = np.maximum(np.sum(power[:, first:] - 1.0, axis=1), 1.0)
        gain = excess / np.median(excess)
        nowhere, upwards = np.empty((len(poses), 2)), np.full((len(poses), 3), z)
        data = cls(nowhere, upwards, signal, np.ascontiguousarray(power), filling, gain, first, float(ranges[last]),
                   stride * pulse.step_m, pulse, spreading, poses, first_m,
                   (mount.x, mount.y, x * c - y * s, x * s + y * c), louder=louder)
        return data.at(poses)
