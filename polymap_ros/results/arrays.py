"""state.npz and beam_map.npz: arrays and nothing else, so that reading a foreign file runs no foreign code."""

import io
import sys
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import Pose
from polymap_ros.maps.beamforming import BeamformingMap

STATE_FORMAT = 'polymap-state/1'


def npz(arrays: Mapping[str, ArrayLike]) -> bytes:
    """An uncompressed .npz; the same arrays give the same bytes."""
    plain = {name: np.asarray(values) for name, values in arrays.items()}
    if pickled := [name for name, values in plain.items() if values.dtype.hasobject]:
        raise TypeError(f'{", ".join(pickled)}: would need pickle')
    buffer = io.BytesIO()
    np.savez(buffer, **plain)  # type: ignore[arg-type]
    return buffer.getvalue()


def npy(values: ArrayLike) -> bytes:
    """A .npy of an array of numbers."""
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(values), allow_pickle=False)
    return buffer.getvalue()


def state_npz(state: Mapping[str, NDArray[np.generic]]) -> bytes:
    """The content of state.npz from `PolygonMapper.state`."""
    return npz({'format': np.array(STATE_FORMAT), **state})


def read_state(path: Path) -> dict[str, NDArray[np.generic]]:
    """Read a state.npz, given by itself or by its folder, for `PolygonMapper.from_state`.

    Raises
    ------
    StateError
        For a file that is missing, damaged, or no saved state of a format known here.
    """
    path = path / 'state.npz' if path.is_dir() else path
    problem = f'{path}: is no saved state, or a damaged one; allowed: state.npz of polymap_replay or ~/save'
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise StateError(problem)
    try:
        with path.open('rb') as stream:
            _check_archive(stream, path.stat().st_size)
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as file:
                state = {name: file[name] for name in file.files}
            if not all(map(_is_writable, state.values())):
                raise StateError(problem)
    except OSError as error:
        raise StateError(f'{path}: cannot be read: {error.strerror or error}') from error
    except Exception as error:  # whatever numpy's and Python's parsers meet in a damaged file
        raise StateError(problem) from error
    if 'format' not in state:
        raise StateError(problem)
    found = str(state.pop('format'))
    if found != STATE_FORMAT:
        raise StateError(f'{path}: has format {found}; allowed: {STATE_FORMAT}')
    return state


@contextmanager
def naming(path: str) -> Iterator[None]:
    """Let a `StateError` in the block tell the file."""
    try:
        yield
    except StateError as error:
        raise StateError(f'{path}: {error}') from error


def _is_writable(array: NDArray[np.generic]) -> bool:
    """Whether text is text: numpy makes strings of any 32 bits, with which Python does not know what to do."""
    if array.dtype.kind != 'U':
        return True
    codes = np.frombuffer(array.tobytes(), f'{array.dtype.str[0]}u4')
    return bool(np.all((codes <= sys.maxunicode) & ((codes < 0xD800) | (codes > 0xDFFF))))


def _check_archive(stream: BinaryIO, size: int) -> None:
    """Raise an exception unless all members are as `npz` writes them, with their checksums, not beyond the file.

    What else numpy reads are single arrays, pickles, and compressed arrays of any size.
    """
    with zipfile.ZipFile(stream) as archive:
        members = archive.infolist()
        plain = all(member.compress_type == zipfile.ZIP_STORED for member in members)
        if not plain or sum(member.file_size for member in members) > size or archive.testzip() is not None:
            raise zipfile.BadZipFile('not as it was written')


def beam_map_npz(beam_map: BeamformingMap, start_pose: Pose | None) -> bytes:
    """The content of beam_map.npz.

    ``map`` (n_theta, n_r) float32 is eq. (4), over ``theta_rad`` and ``r_m`` in the start frame, whose origin and
    heading are ``start_pose`` [x, y, yaw] in the map frame; nan where no ping was used.
    """
    start = [np.nan] * 3 if start_pose is None else [start_pose.x, start_pose.y, start_pose.yaw]
    return npz({
        'map': beam_map.values, 'r_m': beam_map.r_m, 'theta_rad': beam_map.theta_rad, 'start_pose': np.array(start),
    })
