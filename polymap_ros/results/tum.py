"""A path in the TUM format, which tools for the evaluation of SLAM read."""

import numpy as np
from numpy.typing import NDArray


def tum(stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]) -> bytes:
    """Return a path in the TUM format, a line per pose: stamp [s] tx ty tz [m] qx qy qz qw.

    Parameters
    ----------
    stamps_ns : ndarray, shape (T,)
        Stamps [ns], written with all nine decimals.
    poses : ndarray, shape (T, 3)
        x, y [m] and yaw [rad].
    """
    lines = []
    for stamp_ns, (x, y, yaw) in zip(stamps_ns.tolist(), poses.tolist(), strict=True):
        seconds, rest = divmod(stamp_ns, 10**9)
        turn = f'0.0 0.0 {np.sin(0.5 * yaw):.17g} {np.cos(0.5 * yaw):.17g}'
        lines.append(f'{seconds}.{rest:09d} {x!r} {y!r} 0.0 {turn}\n')
    return ''.join(lines).encode()
