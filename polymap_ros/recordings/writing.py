"""Writing recordings, and making messages, without ROS."""

import functools
from collections.abc import Collection, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any

import numpy as np

from polymap_ros.atomic import check_writable, move_into_place, staging
from polymap_ros.errors import RecordingError

STORAGES = ('mcap', 'sqlite3')
_SUFFIXES = {'.mcap': 'mcap', '.db3': 'sqlite3'}
_DEFAULTS = {'geometry_msgs/msg/Quaternion': {'w': 1.0}}
"""Defaults other than zero in the message definitions; rosbags does not keep them."""


class RecordingWriter:
    """Writes a rosbag2 directory, or a bare file where the path ends in .mcap or .db3, and what belongs to it.

    A context manager: the recording appears whole at the end of the ``with`` block, or not at all.

    Parameters
    ----------
    path : Path
        Must not exist yet.
    storage : str
        ``mcap`` or ``sqlite3``; a bare file's suffix decides itself.
    latched : collection of str
        Topics recorded as transient local, so that a player keeps their last message for late joiners.
    companions : dict of str to bytes, optional
        Files that come with the recording: in its directory, or beside a bare file.
    compressed : bool
        Whether the chunks of an MCAP are compressed, by zstd.

    Raises
    ------
    RecordingError
        Where `path` or a companion exists.
    """

    def __init__(
        self, path: Path, storage: str = 'mcap', latched: Collection[str] = (),
        companions: Mapping[str, bytes] = MappingProxyType({}), compressed: bool = False,
    ) -> None:
        if storage not in STORAGES:
            raise RecordingError(f'{path}: storage {storage!r} is not known; allowed: {" | ".join(STORAGES)}')
        self.path = path
        self._storage = _SUFFIXES.get(path.suffix, storage)
        self._bare = path.suffix in _SUFFIXES
        self._latched = frozenset(latched)
        self._companions = companions
        self._compressed = compressed
        self._connections: dict[tuple[str, str], Any] = {}
        self._stack = ExitStack()

    def __enter__(self) -> 'RecordingWriter':
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        self._refuse_to_overwrite()
        check_writable(self.path.parent, self.path)
        with ExitStack() as stack:
            self._stage = stack.enter_context(staging(self.path))
            self._folder = self._stage / ('recording' if self._bare else self.path.name)
            plugin = StoragePlugin.MCAP if self._storage == 'mcap' else StoragePlugin.SQLITE3
            self._writer = Writer(self._folder, version=9, storage_plugin=plugin)
            if self._compressed:
                self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._stack:
            self._writer.close()
            if kind is None:
                self._refuse_to_overwrite()
                for name, data in self._companions.items():
                    ((self._stage if self._bare else self._folder) / name).write_bytes(data)
                if self._bare:
                    self._place_files()
                else:
                    move_into_place(self._folder, self.path)

    def _place_files(self) -> None:
        """The companions first: a recording is never without them."""
        suffix = '.mcap' if self._storage == 'mcap' else '.db3'
        with ExitStack() as undo:
            for name in self._companions:
                target = self.path.with_name(name)
                move_into_place(self._stage / name, target)
                undo.callback(target.unlink, missing_ok=True)
            move_into_place(self._folder / f'{self._folder.name}{suffix}', self.path)
            undo.pop_all()

    def write(self, topic: str, message: Any, log_ns: int) -> None:
        """Append a message of rosbags (see `make`) at a log time [ns]."""
        type_name = message.__msgtype__
        self.declare(topic, type_name)
        raw = typestore().serialize_cdr(message, type_name)
        self._writer.write(self._connections[topic, type_name], log_ns, raw)

    def declare(self, topic: str, type_name: str) -> None:
        """Say that there is a topic, be there a message or not."""
        if (topic, type_name) not in self._connections:
            self._connections[topic, type_name] = self._writer.add_connection(
                topic, type_name, typestore=typestore(), offered_qos_profiles=[_qos(topic in self._latched)]
            )

    def _refuse_to_overwrite(self) -> None:
        if _is_taken(self.path):
            raise RecordingError(f'{self.path}: exists already and is not overwritten')
        for path in (self.path.with_name(name) for name in self._companions if self._bare):
            if _is_taken(path):
                raise RecordingError(f'{path}: may belong to another recording; choose a folder without one')


def _is_taken(path: Path) -> bool:
    """Whether something has this name, a link that leads nowhere included; an `OSError` where nothing can have it."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


@functools.cache
def typestore() -> Any:
    """The message types of ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def make(type_name: str, /, **fields: Any) -> Any:
    """Make a message as a dataclass of rosbags; fields not given have their default, as with rclpy.

    Parameters
    ----------
    type_name : str
        Such as ``nav_msgs/msg/Odometry``.
    **fields
        Values; any sequence of numbers is taken for an array.
    """
    types = typestore()
    description: Mapping[str, Any] = dict(types.fielddefs[type_name][1])
    if unknown := fields.keys() - description.keys():
        raise TypeError(f'{type_name} has no field {", ".join(sorted(unknown))}')
    fields = _DEFAULTS.get(type_name, {}) | fields
    values = {
        name: _as_field(fields[name], kind) if name in fields else _empty(kind) for name, kind in description.items()
    }
    return types.types[type_name](**values)


def _as_field(value: Any, kind: Any) -> Any:
    """Numbers of an array field as the numpy array that rosbags serializes."""
    from rosbags.interfaces import Nodetype

    node, detail = kind
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) and (dtype := _dtype(detail[0])) is not None:
        return np.asarray(value, dtype=dtype)
    return value


def _empty(kind: Any) -> Any:
    from rosbags.interfaces import Nodetype

    node, detail = kind
    if node == Nodetype.NAME:
        return make(detail)
    if node == Nodetype.BASE:
        return '' if detail[0] in ('string', 'wstring') else np.dtype(detail[0]).type(0).item()
    element, size = detail[0], detail[1] if node == Nodetype.ARRAY else 0
    if (dtype := _dtype(element)) is not None:
        return np.zeros(size, dtype=dtype)
    return [_empty(element) for _ in range(size)]


def _dtype(element: Any) -> np.dtype[Any] | None:
    from rosbags.interfaces import Nodetype

    node, detail = element
    if node != Nodetype.BASE or detail[0] in ('string', 'wstring'):
        return None
    return np.dtype('uint8' if detail[0] in ('octet', 'byte', 'char') else detail[0])


def _qos(latched: bool) -> Any:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    unlimited = QosTime(sec=9223372036, nsec=854775807)
    return Qos(
        history=QosHistory.KEEP_LAST, depth=1 if latched else 100, reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=unlimited, lifespan=unlimited, liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=unlimited, avoid_ros_namespace_conventions=False,
    )
