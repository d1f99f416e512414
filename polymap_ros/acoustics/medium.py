"""Media: how a wave of one frequency travels, as the transfer function g of eq. (1) has it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.parameters import MediumParameters


class Medium(Protocol):
    """A homogeneous isotropic medium."""

    @property
    def spreading(self) -> float:
        """Exponent p of the amplitude's decay with distance, d**-p."""

    def wavenumber(self, omega_rad_s: ArrayLike) -> NDArray[np.float64]:
        """Wavenumber k [rad/m] at angular frequencies >= 0 [rad/s], same shape."""

    def excitability(self, omega_rad_s: ArrayLike) -> NDArray[np.float64]:
        """Amplitude of the transfer function at distance 1 m, same shape; 0 at 0 rad/s."""


@dataclass(frozen=True)
class ConstantSpeed:
    """Air or water: no dispersion, k = omega / c.

    Parameters
    ----------
    speed_m_s : float
        Speed of sound c [m/s].
    spreading : float
        1 in a volume: g = exp(-j k d) / d.
    """

    speed_m_s: float
    spreading: float = 1.0

    def wavenumber(self, omega_rad_s: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(omega_rad_s, dtype=float) / self.speed_m_s

    def excitability(self, omega_rad_s: ArrayLike) -> NDArray[np.float64]:
        return np.where(np.asarray(omega_rad_s) > 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class LambA0:
    """Fundamental antisymmetric guided wave of a free plate, from the Rayleigh-Lamb equation.

    With h half the thickness, alpha^2 = k^2 - (w/cL)^2 and beta^2 = k^2 - (w/cT)^2, both positive for A0, the
    equation reads (beta^2 + k^2)^2 tanh(alpha h) / alpha = 4 k^2 beta tanh(beta h).

    Parameters
    ----------
    thickness_m : float
        Plate thickness 2 h [m].
    longitudinal_speed_m_s, shear_speed_m_s : float
        Bulk wave speeds cL > cT [m/s].
    spreading : float
        0.5 in a plate: g = exp(-j k d) / sqrt(k d).
    """

    thickness_m: float
    longitudinal_speed_m_s: float
    shear_speed_m_s: float
    spreading: float = 0.5

    def wavenumber(self, omega_rad_s: ArrayLike) -> NDArray[np.float64]:
        omega = np.asarray(omega_rad_s, dtype=float)
        half = self.thickness_m / 2.0
        shear = omega * half / self.shear_speed_m_s
        longitudinal = omega * half / self.longitudinal_speed_m_s
        low, high = shear.copy(), 2.0 * shear + np.sqrt(shear)
        while np.any(growing := (_rayleigh_lamb(high, longitudinal, shear) > 0.0)):
            high = np.where(growing, 2.0 * high, high)
        for _ in range(12):  # bisection to a bracket of relative width 1e-4 ...
            middle = 0.5 * (low + high)
            above = _rayleigh_lamb(middle, longitudinal, shear) > 0.0
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        # ... over which the slope changes by as little: every step of Newton's method gains four digits.
        rise = _rayleigh_lamb(high, longitudinal, shear) - _rayleigh_lamb(low, longitudinal, shear)
        run = np.divide(high - low, rise, out=np.zeros_like(rise), where=rise < 0.0)
        root = 0.5 * (low + high)
        for _ in range(4):
            root = np.clip(root - _rayleigh_lamb(root, longitudinal, shear) * run, low, high)
        wavenumber: NDArray[np.float64] = root / half
        return wavenumber

    def excitability(self, omega_rad_s: ArrayLike) -> NDArray[np.float64]:
        k = self.wavenumber(omega_rad_s)
        return np.divide(1.0, np.sqrt(k), out=np.zeros_like(k), where=k > 0.0)


def _rayleigh_lamb(
    k: NDArray[np.float64], longitudinal: NDArray[np.float64], shear: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Antisymmetric Rayleigh-Lamb function in units of 1 / h; positive below the root, negative above."""
    alpha = np.sqrt(np.maximum(k * k - longitudinal * longitudinal, 0.0))
    beta = np.sqrt(np.maximum(k * k - shear * shear, 0.0))
    ratio = np.divide(np.tanh(alpha), alpha, out=np.ones_like(alpha), where=alpha > 0.0)
    value: NDArray[np.float64] = (beta**2 + k * k) ** 2 * ratio - 4.0 * k * k * beta * np.tanh(beta)
    return value


def group_speed(medium: Medium, frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """Group speed d omega / d k [m/s] at frequencies > 0 [Hz], by central difference (relative error ~1e-8)."""
    omega = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
    step = 1e-4 * omega
    speed: NDArray[np.float64] = 2.0 * step / (medium.wavenumber(omega + step) - medium.wavenumber(omega - step))
    return speed


def make_medium(parameters: MediumParameters) -> Medium:
    """The medium that the parameters describe."""
    if parameters.model == 'constant':
        return ConstantSpeed(parameters.speed_m_s, parameters.spreading)
    return LambA0(parameters.thickness_m, parameters.longitudinal_speed_m_s, parameters.shear_speed_m_s,
                  parameters.spreading)
