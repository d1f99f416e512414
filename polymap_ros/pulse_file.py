"""The recorded pulse of ``pulse.kind: file``."""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polymap_ros.errors import ParameterError
from polymap_ros.parameters import Parameters

NAME = 'pulse.path'


def read_pulse(parameters: Parameters) -> NDArray[np.float64] | None:
    """Samples of the recorded pulse, shape (n,), at the echoes' sample rate; None for the other kinds.

    A relative path starts at the parameter file's folder. Of a .wav with several channels the first is taken;
    integers are scaled to +-1, which the normalisation of eq. (3) removes again.

    Raises
    ------
    ParameterError
        For a file that is missing, no .npy or .wav, or holds no finite samples.
    """
    if parameters.pulse.kind != 'file':
        return None
    path = parameters.folder / parameters.pulse.path
    readers = {'.npy': _read_npy, '.wav': _read_wav}
    if path.suffix.lower() not in readers:
        raise ParameterError(NAME, f'{path.name!r} is neither .npy nor .wav')
    try:
        samples = readers[path.suffix.lower()](path)
    except OSError as error:
        raise ParameterError(NAME, f'{path}: cannot be read: {error.strerror or error}') from error
    except (ValueError, EOFError, TypeError, struct.error) as error:
        raise ParameterError(NAME, f'{path}: cannot be read: {" ".join(str(error).split())}') from error
    if samples.ndim != 1 or samples.size < 2 or not np.isfinite(samples).all() or not samples.any():
        raise ParameterError(NAME, f'{path}: holds an array of shape {samples.shape}; allowed: at least two finite '
                                   'samples in one dimension, not all zero')
    return samples


def _read_npy(path: Path) -> NDArray[np.float64]:
    samples = np.load(path, allow_pickle=False)
    if not isinstance(samples, np.ndarray) or samples.dtype.kind not in 'fiu':
        raise ValueError('not an array of real numbers')
    return samples.astype(np.float64)


def _read_wav(path: Path) -> NDArray[np.float64]:
    import scipy.io.wavfile

    _, samples = scipy.io.wavfile.read(path)
    channel: NDArray[np.float64] = (samples if samples.ndim == 1 else samples[:, 0]).astype(np.float64)
    if samples.dtype == np.uint8:
        return (channel - 128.0) / 128.0
    if samples.dtype.kind == 'i':
        return channel / -float(np.iinfo(samples.dtype).min)
    return channel
