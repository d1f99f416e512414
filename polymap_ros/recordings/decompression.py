"""Decompression that never gives more bytes than were promised or are reasonable."""

import shutil
import zlib
from pathlib import Path

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.storage import MOST_BYTES

_RATIO = 1000
"""Recordings are not compressed better than this, decompression bombs are."""

_SMALL = 2**24
"""Bytes that are always allowed: even silence, which is compressed without bounds."""


def most_of(compressed: int) -> int:
    """Bytes that so many compressed ones may become."""
    return _SMALL + _RATIO * compressed


def decompressed(data: bytes, compression: str, size: int) -> bytes:
    """The content of a chunk.

    Parameters
    ----------
    data : bytes
        As stored.
    compression : str
        ``zstd``, ``lz4`` or empty.
    size : int
        Bytes of the content, as promised.

    Raises
    ------
    ValueError
        For a content of another size, an unknown compression and damaged data.
    """
    if size > MOST_BYTES:
        raise ValueError(f'{size} bytes are promised, {MOST_BYTES} are allowed')
    if compression == 'zstd':
        content = _from_zstd(data, size + 1)
    elif compression == 'lz4':
        content = _from_lz4(data, size + 1)
    elif compression == '':
        content = data
    else:
        raise ValueError(f'compression {compression!r} is not known')
    if len(content) != size:
        raise ValueError(f'{size} bytes are promised, {"more" if len(content) > size else len(content)} are there')
    return content


def message_of_zstd(data: bytes) -> bytes:
    """A message that rosbag2 compressed on its own.

    Raises
    ------
    ValueError
        For damaged data and for a bomb.
    """
    most = min(MOST_BYTES, most_of(len(data)))
    content = _from_zstd(data, most + 1)
    if len(content) > most:
        raise ValueError(f'{len(data)} bytes become more than {most}')
    return content


def unpack_file(source: Path, folder: Path) -> Path:
    """Write what a file compressed by rosbag2 (``compression_mode: file``) holds; returns where.

    Raises
    ------
    RecordingError
        For damaged data, a bomb, and where there is no room for the content.
    """
    import zstandard

    size = source.stat().st_size
    target = folder / source.stem
    room = min(most_of(size), shutil.disk_usage(folder).free // 2)
    written = 0
    try:
        with source.open('rb') as packed, target.open('wb') as content:
            for block in zstandard.ZstdDecompressor().read_to_iter(packed):
                written += len(block)
                if written > room:
                    raise RecordingError(f'{source}: its {size} bytes become more than {room}, which is refused: a '
                                         'decompression bomb, or too little room for temporary files')
                content.write(block)
    except zstandard.ZstdError as error:
        raise RecordingError(f'{source}: cannot be decompressed ({error})') from error
    return target


def has_checksum(content: bytes, crc: int) -> bool:
    """Whether content has its CRC-32; 0 means that none was written."""
    return crc in (0, zlib.crc32(content))


def _from_zstd(data: bytes, at_most: int) -> bytes:
    import zstandard

    try:
        content: bytes = zstandard.ZstdDecompressor().stream_reader(data).read(at_most)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error
    return content


def _from_lz4(data: bytes, at_most: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    try:
        content: bytes = LZ4FrameDecompressor().decompress(data, max_length=at_most)
    except RuntimeError as error:
        raise ValueError(str(error)) from error
    return content
