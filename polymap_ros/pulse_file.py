"""The recorded pulse of ``pulse.kind: file``."""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.pulse import RecordedPulse, problem_of, same_period
from polymap_ros.errors import ParameterError
from polymap_ros.parameters import Parameters

NAME = 'pulse.path'


def read_pulse(parameters: Parameters) -> RecordedPulse | None:
    """Read the recorded pulse; None for the other kinds. Only a .wav tells its sample period.

    A relative path starts at the parameter file's folder. Of a .wav with several channels the first is taken;
    integers are scaled to +-1, which the normalisation of eq. (3) removes again.

    Raises
    ------
    ParameterError
        For a file that is not named or missing, is no .npy or .wav, or holds no pulse, and for a .wav whose sample rate
        cannot be that of the echoes.
    """
    if parameters.pulse.kind != 'file':
        return None
    if not parameters.pulse.path:
        raise ParameterError(NAME, "'' names no file; pulse.kind 'file' needs a .npy or .wav")
    path = parameters.folder / parameters.pulse.path
    readers = {'.npy': _read_npy, '.wav': _read_wav}
    if path.suffix.lower() not in readers:
        raise ParameterError(NAME, f'{path.name!r} is neither .npy nor .wav')
    try:
        samples, period_s = readers[path.suffix.lower()](path)
    except OSError as error:
        raise ParameterError(NAME, f'{path}: cannot be read: {error.strerror or error}') from error
    except (ValueError, EOFError, TypeError, struct.error) as error:
        raise ParameterError(NAME, f'{path}: cannot be read: {" ".join(str(error).split())}') from error
    if problem := problem_of(samples):
        raise ParameterError(NAME, f'{path}: {problem}')
    if period_s:
        _check_period(path, period_s, parameters)
    return RecordedPulse(samples, period_s)


def _check_period(path: Path, period_s: float, parameters: Parameters) -> None:
    """Raise `ParameterError` where no echo could have the sample rate of the file."""
    frequency_hz, echo_s = parameters.pulse.frequency_hz, parameters.echo.sample_period_s
    if echo_s > 0.0 and not same_period(period_s, echo_s):
        raise ParameterError(NAME, f'{path}: is sampled at {1.0 / period_s:g} Hz, the echoes at {1.0 / echo_s:g} Hz '
                                   "(echo.sample_period_s); resample it to the echoes' rate")
    if parameters.echo.kind == 'rf' and not period_s * frequency_hz < 0.5:
        raise ParameterError(NAME, f'{path}: is sampled at {1.0 / period_s:g} Hz, which cannot hold pulse.frequency_hz '
                                   f"({frequency_hz:g} Hz); allowed: the echoes' rate, above {2.0 * frequency_hz:g} Hz")


def _read_npy(path: Path) -> tuple[NDArray[np.float64], float]:
    samples = np.load(path, allow_pickle=False)
    if not isinstance(samples, np.ndarray) or samples.dtype.kind not in 'fiu':
        raise ValueError('not an array of real numbers')
    return samples.astype(np.float64), 0.0


def _read_wav(path: Path) -> tuple[NDArray[np.float64], float]:
    import scipy.io.wavfile

    rate_hz, samples = scipy.io.wavfile.read(path)
    if rate_hz <= 0:
        raise ValueError(f'a sample rate of {rate_hz} Hz')
    period_s = 1.0 / rate_hz
    channel: NDArray[np.float64] = (samples if samples.ndim == 1 else samples[:, 0]).astype(np.float64)
    if samples.dtype == np.uint8:
        return (channel - 128.0) / 128.0, period_s
    if samples.dtype.kind == 'i':
        return channel / -float(np.iinfo(samples.dtype).min), period_s
    return channel, period_s
