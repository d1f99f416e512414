r"""Diffraction at a corner: the coefficient D of the uniform theory.

A wave that comes to a corner of two walls, at an angle of pi n between them, goes on from there in all directions, as
exp(-j k s) D / sqrt(s). With that, what image sources end at once where a hit leaves its wall becomes continuous: it
fades over a Fresnel zone. Where n is 1 over a whole number D is 0, as image sources are exact there.

R. G. Kouyoumjian, P. H. Pathak, "A uniform geometrical theory of diffraction for an edge in a perfectly conducting
surface", Proceedings of the IEEE 62 (1974), 1448-1461, equations (25) to (31), for waves exp(+j w t) in the plane; the
walls' coefficients stand at their own terms as in R. J. Luebbers, "Finite conductivity uniform GTD versus knife edge
diffraction in prediction of propagation path loss", IEEE Transactions on Antennas and Propagation 32 (1984), 70-76.
"""

import numpy as np
import scipy.special
from numpy.typing import ArrayLike, NDArray

_EXACT = 1e-6
"""An angle is pi over a whole number within this share of it."""

_AT_THE_EDGE_RAD = 1e-7
"""The coefficient's poles at the ends of images, whose limits are finite, are kept away from by this much."""


def diffracts(angle_rad: float, nearly: float = _EXACT) -> bool:
    """Return whether a corner of this interior angle diffracts: pi over a whole number, or nearly that, does not."""
    share = np.pi / angle_rad
    return abs(share - max(round(share), 1)) > nearly * share


def wedge_coefficient(
    angle_rad: ArrayLike, reflection: tuple[ArrayLike, ArrayLike], coming_rad: NDArray[np.float64],
    going_rad: NDArray[np.float64], wavenumber: float, focus_m: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Return D of ways over corners.

    Parameters
    ----------
    angle_rad : array_like
        The corner's interior angle, one or for each way.
    reflection : pair of array_like
        Coefficients of the wall from which angles are counted, and of the other one.
    coming_rad, going_rad : ndarray, shape (m,)
        Directions in which source and receiver, or their images, are seen from the corner.
    wavenumber : float
        k [rad/m].
    focus_m : ndarray, shape (m,)
        s s' / (s + s') of the ways' lengths to the corner and from it [m].

    Returns
    -------
    ndarray, shape (m,), complex
        D [sqrt(m)].
    """
    n, total = np.asarray(angle_rad, dtype=float) / np.pi, np.zeros(len(coming_rad), complex)
    for beta, reflected in ((coming_rad - going_rad, (1.0, 1.0)), (coming_rad + going_rad, reflection)):
        for sign, coefficient in zip((-1.0, 1.0), reflected, strict=True):
            angle = (np.pi + sign * beta) / (2.0 * n)
            near = np.abs(np.sin(angle)) < _AT_THE_EDGE_RAD
            angle = np.where(near, angle + _AT_THE_EDGE_RAD, angle)
            a = 2.0 * np.cos(n * (np.pi * np.round(angle / np.pi) - angle) + 0.5 * np.pi) ** 2
            total += np.asarray(coefficient) / np.tan(angle) * _transition(wavenumber * focus_m * a)
    return np.asarray(-np.exp(-0.25j * np.pi) / (2.0 * n * np.sqrt(2.0 * np.pi * wavenumber)) * total)


def _transition(x: NDArray[np.float64]) -> NDArray[np.complex128]:
    """F, equation (28): 2 j sqrt(x) exp(j x) times the integral of exp(-j t^2) from sqrt(x) on."""
    root = np.sqrt(x)
    return np.asarray(2j * root * np.exp(1j * x) * scipy.special.modfresnelm(root)[0])
