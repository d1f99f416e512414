"""What a file is, by its first bytes: whatever it is called, and whatever metadata.yaml says of it."""

import shlex
import stat
import struct
from pathlib import Path

READABLE = ('mcap', 'sqlite3')
"""Kinds of file that hold a recording."""

PACKED = ('zstd', 'lz4', 'gzip')
"""Kinds that are unpacked on the way."""

ZSTD, LZ4 = b'\x28\xb5\x2f\xfd', b'\x04\x22\x4d\x18'
"""How a frame begins."""

_HEAD = 512
_MAGICS = {
    b'\x89MCAP0\r\n': 'mcap', b'SQLite format 3\0': 'sqlite3', ZSTD: 'zstd', LZ4: 'lz4', b'\x1f\x8b': 'gzip',
    b'#ROSBAG V': 'rosbag1', b'PK\x03\x04': 'zip', b'BZh': 'bzip2', b'\xfd7zXZ\0': 'xz', b'7z\xbc\xaf\x27\x1c': '7z',
    b'\x89MCAP0\n': 'as_text', b'\x89MCAP0\r\r\n': 'as_text', b'<?xml': 'answer', b'{': 'answer', bytes(_HEAD): 'zeros',
    b'version https://git-lfs': 'lfs', b'<!DOCTYPE': 'html', b'<!doctype': 'html', b'<html': 'html',
}
_SKIPPABLE = struct.Struct('<II')
_SKIPPABLE_FRAMES = range(0x184D2A50, 0x184D2A60)
"""Frames of zstd and lz4 that hold something else than data; they may come first."""

_UNPACKERS = {'zip': 'unzip', '7z': '7z x', 'bzip2': 'bunzip2 -k', 'xz': 'unxz -k', 'tar': 'tar xf'}


def kind_of(path: Path) -> str:
    """Return the kind of a file by its content: one of `READABLE` or `PACKED`, another known one, or ``unknown``.

    ``empty`` for a file without a byte, ``special`` for what is no regular file and is not opened.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        return 'special'
    with path.open('rb') as stream:
        head = stream.read(_HEAD)
        while is_skippable(head):
            stream.seek(_SKIPPABLE.unpack_from(head)[1] - len(head) + _SKIPPABLE.size, 1)
            head = stream.read(_HEAD)
            if not head:
                return 'unknown'
    if not head:
        return 'empty'
    return kind_of_bytes(head)


def kind_of_bytes(head: bytes) -> str:
    """Return the kind of what begins with some bytes, or ``unknown``."""
    if head[257:262] == b'ustar':
        return 'tar'
    return next((kind for magic, kind in _MAGICS.items() if head.startswith(magic)), 'unknown')


def is_skippable(head: bytes) -> bool:
    """Whether a skippable frame of zstd or lz4 begins here."""
    return len(head) >= _SKIPPABLE.size and _SKIPPABLE.unpack_from(head)[0] in _SKIPPABLE_FRAMES


def refusal(content: Path, kind: str, path: Path | None = None) -> str:
    """Say why a file of this kind is no recording that can be read, and what to do; the user calls it `path`."""
    path = path or content
    name = shlex.quote(str(path))
    if kind == 'rosbag1':
        target = path.with_suffix('') if path.suffix else path.with_name(f'{path.name}_ros2')
        renamed = ''
        if path.suffix != '.bag':  # by which rosbags-convert knows it
            bag = shlex.quote(f'{path.with_suffix("")}.bag')
            renamed, name = f'mv {name} {bag} && ', bag
        return (f'is a recording of ROS 1; convert it with: {renamed}rosbags-convert --src {name} --dst '
                f'{shlex.quote(str(target))}')
    if kind in _UNPACKERS:
        return f'is packed ({kind}); unpack it first: {_UNPACKERS[kind]} {name}'
    known = {
        'empty': 'the file is empty',
        'lfs': 'is a pointer of Git LFS, not the recording itself; get that with: git lfs pull',
        'html': 'is a web page, not a recording; download it again',
        'answer': "is a server's answer (XML or JSON), not a recording; see what it says, and download it again",
        'as_text': 'was copied as text, which changed the ends of its lines, and so all of it; copy it again as binary',
        'zeros': 'begins with zeros: room was made for it, and nothing written; copy it again from where it was made',
        'special': 'is no regular file; a recording is a rosbag2 directory, or an MCAP or SQLite file',
    }
    if kind in known:
        return known[kind]
    with content.open('rb') as stream:
        return f'is neither MCAP nor SQLite: it begins with {bytes_shown(stream.read(8))}'


def bytes_shown(data: bytes, at_most: int = 8) -> str:
    """Show the first of some bytes: as text where they are, or in hexadecimal."""
    head = data[:at_most]
    if head and all(32 <= byte < 127 for byte in head):
        return repr(head.decode('ascii'))
    return f'the bytes {head.hex(" ")}' if head else 'nothing'
