"""Decompression that never gives more bytes than were promised or are reasonable."""

import gzip
import shutil
import zlib
from collections.abc import Iterator
from pathlib import Path

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.sniff import LZ4, ZSTD, is_skippable
from polymap_ros.recordings.storage import MOST_BYTES

_RATIO = 1000
"""Recordings are not compressed better than this, decompression bombs are."""

_SMALL = 2**24
"""Bytes that are always allowed: even silence, which is compressed without bounds."""

_FED = 2**9
"""Bytes given to zstd at a time: at most 16 MiB come out of them."""

_WINDOW = 2**31
"""As far back as a frame of zstd may look (``--long=31``): the memory that it may take [bytes]."""

_BLOCK = 2**20


def most_of(compressed: int) -> int:
    """Bytes that so many compressed ones may become."""
    return _SMALL + _RATIO * compressed


def decompressed(data: bytes, compression: str, size: int) -> bytes:
    """Return the content of a chunk.

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


def plain_message(data: bytes) -> bytes:
    """Return a message without the compression that rosbag2 may have given it on its own; CDR begins otherwise.

    Raises
    ------
    ValueError
        For damaged data and for a bomb.
    """
    if not (data.startswith((ZSTD, LZ4)) or is_skippable(data)):
        return data
    most = min(MOST_BYTES, most_of(len(data)))
    content = _from_lz4(data, most + 1) if data.startswith(LZ4) else _from_zstd(data, most + 1)
    if len(content) > most:
        raise ValueError(f'{len(data)} bytes become more than {most}')
    return content


def unpack_file(path: Path, kind: str, target: Path, content: Path | None = None) -> str:
    """Write what a compressed file holds, all its frames, and return what is lost of it; empty where nothing is.

    Parameters
    ----------
    path : Path
        What the user calls it.
    kind : str
        One of `polymap_ros.recordings.sniff.PACKED`.
    target : Path
        Must not exist.
    content : Path, optional
        Where it lies, if not there.

    Raises
    ------
    RecordingError
        For a bomb, where there is no room for the content, and where nothing can be unpacked.
    """
    source = content or path
    size = source.stat().st_size
    written, fault = 0, 'it holds nothing'
    try:
        room = min(most_of(size), shutil.disk_usage(target.parent).free // 2)
        with target.open('xb') as unpacked:
            for block in _blocks(source, kind):
                written += len(block)
                if written > room:
                    raise RecordingError(f'{path}: its {size} bytes become more than {room}, which is refused: a '
                                         'decompression bomb, or too little room for temporary files (TMPDIR)')
                unpacked.write(block)
        fault = fault if not written else ''
    except EOFError:
        fault = f'its compressed data ({kind}) have no end: it was cut off'
    except ValueError as error:
        fault = f'its compressed data ({kind}) are damaged ({error})'
    except OSError as error:
        raise RecordingError(f'{path}: cannot be unpacked: {error.strerror or error}; TMPDIR may name a folder with '
                             'room for it') from error
    if not written:
        raise RecordingError(f'{path}: cannot be decompressed: {fault}')
    return f'{path.name}: {fault}; the first {written} bytes can be unpacked' if fault else ''


def has_checksum(content: bytes, crc: int) -> bool:
    """Whether content has its CRC-32; 0 means that none was written."""
    return crc in (0, zlib.crc32(content))


def _blocks(source: Path, kind: str) -> Iterator[bytes]:
    """What a file holds; EOFError where it was cut off, ValueError where it is damaged."""
    if kind == 'zstd':
        yield from _zstd_blocks(source)
        return
    import lz4.frame

    with (gzip.open if kind == 'gzip' else lz4.frame.open)(source) as stream:
        try:
            while block := stream.read1(_BLOCK):
                yield block
        except (gzip.BadGzipFile, zlib.error, RuntimeError) as error:
            raise ValueError(str(error)) from error


def _zstd_blocks(source: Path) -> Iterator[bytes]:
    import zstandard

    frame = None
    with source.open('rb') as stream:
        while data := stream.read(_FED):
            while data:
                frame = frame or zstandard.ZstdDecompressor(max_window_size=_WINDOW).decompressobj()
                try:
                    block = frame.decompress(data)
                except zstandard.ZstdError as error:
                    raise ValueError(str(error)) from error
                data, frame = (frame.unused_data, None) if frame.eof else (b'', frame)
                if block:
                    yield block
    if frame is not None:
        raise EOFError


def _from_zstd(data: bytes, at_most: int) -> bytes:
    import zstandard

    try:
        content: bytes = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True).read(at_most)
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
