r"""How sharp a map is: the strength of its lines under an assumed medium and an assumed path.

A wall's echoes lie on its line, d_i = r - n . x_i, only if ranges and positions have one scale and the positions are
where they are said to be; else the line is blurred, as in a camera that is out of focus. Focalisation of a beamformer
finds the parameters of its propagation model in this way (Bucker, J. Acoust. Soc. Am. 59, 368, 1976; Collins and
Kuperman, J. Acoust. Soc. Am. 90, 1410, 1991). Two measures:

- without phase: the evidence of the map's peaks, each the best contiguous run of feet on a line. Its main lobe is as
  wide as the pulse is long over the path's extent (some per cent of scale), so that a coarse grid finds it;
- with phase: of each wall of a rough polygon the power of its complex sum over the feet, largest over a small window of
  r and theta. Its lobe is ten times narrower, and it asks for no right number of edges.
"""

import numpy as np
from numpy.typing import NDArray

from polymap_ros.geometry.outline import corners_of
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.power import PowerLikelihood
from polymap_ros.solvers.evidence.proposals import first_strength, strongest_lines

_ANGLES, _PEAKS = 360, 100
_R_WINDOW_M, _THETA_WINDOW_RAD = 0.015, np.deg2rad(1.5)
"""How far a wall of the rough polygon may be from its place."""

_AWAY_FROM_ENDS = 0.05
"""Share of a rough wall at either end whose feet are not counted: corners are found last."""


def background(data: EchoData) -> NDArray[np.float64]:
    """Expected power (1, n_cells) without any wall."""
    return np.asarray(1.0 + PowerLikelihood(data).initial(0.0).background[None, :])


def echo_strength(data: EchoData) -> float:
    """Strength of a first-order echo, by which `line_focus` weighs what it hears."""
    return first_strength(data, background(data))


def line_focus(data: EchoData, strength: float) -> float:
    """Focus without phase: root of the sum of squares of the evidence [nats] of the map's peaks."""
    evidence = strongest_lines(data, background(data), strength, _PEAKS, angles=_ANGLES).evidence
    return float(np.sqrt(np.sum(evidence**2)))


def feet_heard(lines: NDArray[np.float64], positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the perpendicular foot of position i is well on edge k of the polygon of `lines`, shape (n, N)."""
    _, corners = corners_of(lines)
    along = np.roll(corners, -1, axis=0) - corners
    share = np.einsum('kij,kj->ki', positions[None] - corners[:, None], along) / np.sum(along**2, axis=1)[:, None]
    return np.asarray((share > _AWAY_FROM_ENDS) & (share < 1.0 - _AWAY_FROM_ENDS))


def wave_focus(
    data: EchoData, lines: NDArray[np.float64], feet: NDArray[np.bool_], positions: NDArray[np.float64], carrier: float
) -> float:
    """Focus with phase [nats]: sum over walls of |sum of the echoes at the feet|^2 over twice their weight.

    Parameters
    ----------
    data : EchoData
        The echoes.
    lines : ndarray, shape (n, 2)
        r [m] and theta [rad] of the walls, roughly.
    feet : ndarray, shape (n, N)
        Pings heard by each wall, of `feet_of`.
    positions : ndarray, shape (N, 2)
        Assumed positions [m], in the place of the data's.
    carrier : float
        Assumed wavenumber [rad/m], in the place of the pulse's.
    """
    theta_step = 0.5 / (carrier * data.extent_m)
    r_step = data.pulse.width_m / 4.0
    return float(_wave_focus(
        data.signal, lines, feet, positions, carrier, data.pulse.step_m, data.spreading, r_step,
        int(np.ceil(_R_WINDOW_M / r_step)), theta_step, int(np.ceil(_THETA_WINDOW_RAD / theta_step))))


@kernel
def _wave_focus(
    signal: NDArray[np.complex64],
    lines: NDArray[np.float64],
    feet: NDArray[np.bool_],
    positions: NDArray[np.float64],
    carrier: float,
    step: float,
    spreading: float,
    r_step: float,
    r_steps: int,
    theta_step: float,
    theta_steps: int,
) -> float:
    columns = 2 * r_steps + 1
    sums, total = np.empty(columns, np.complex128), 0.0
    for k in range(len(lines)):
        x, y, count = 0.0, 0.0, 0
        for i in range(len(positions)):
            if feet[k, i]:
                x, y, count = x + positions[i, 0], y + positions[i, 1], count + 1
        if count < 2:
            continue
        x, y = x / count, y / count
        # Turned about the foot of the feet's middle, so that r and theta do not trade.
        middle = lines[k, 0] - x * np.cos(lines[k, 1]) - y * np.sin(lines[k, 1])
        best = 0.0
        for t in range(-theta_steps, theta_steps + 1):
            c, s = np.cos(lines[k, 1] + t * theta_step), np.sin(lines[k, 1] + t * theta_step)
            sums[:] = 0.0
            weight = 0.0
            for i in range(len(positions)):
                if not feet[k, i]:
                    continue
                nearer = (positions[i, 0] - x) * c + (positions[i, 1] - y) * s
                first = (middle - nearer - r_steps * r_step) / step
                if first < 0.0 or middle <= nearer or first + columns * r_step / step > signal.shape[1] - 2:
                    continue
                share = (middle - nearer) ** -spreading
                weight += share * share
                turned = share * np.exp(-2j * carrier * nearer)
                for q in range(columns):
                    at = first + q * r_step / step
                    j = int(at)
                    sums[q] += turned * (signal[i, j] + (at - j) * (signal[i, j + 1] - signal[i, j]))
            if weight > 0.0:
                for q in range(columns):
                    best = max(best, (sums[q].real ** 2 + sums[q].imag ** 2) / (2.0 * weight))
        total += best
    return total
