"""The errors a user can cause. Each names what was found, where, and what is allowed."""

import errno
from pathlib import Path
from typing import NamedTuple

_REMEDIES = {
    errno.ENOSPC: 'free some space there, or where df -i tells of no inodes, remove files',
    errno.EDQUOT: 'free some space within the quota',
    errno.EFBIG: 'raise the limit of the size of files (ulimit -f)',
    errno.EROFS: 'mount it for writing',
    errno.EMFILE: 'raise the number of open files (ulimit -n)',
}


class PolymapError(Exception):
    """Base of every error that the commands print as one line and turn into exit status 2."""


class UsageError(PolymapError):
    """A command was called in a way that cannot work."""


class ParameterError(PolymapError):
    """A parameter has an unknown name, a wrong type or a value that is not allowed.

    Parameters
    ----------
    name : str
        Full name, such as ``grid.range_step_m``.
    problem : str
        What was found and what is allowed.
    """

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f'parameter {name}: {problem}')
        self.name = name
        self.problem = problem

    def __reduce__(self) -> tuple[type['ParameterError'], tuple[str, str]]:
        """Pickle by what it was made of, so that it can come from another process."""
        return type(self), (self.name, self.problem)


class RecordingError(PolymapError):
    """A recording cannot be read, or holds no usable topic."""


class OutputError(PolymapError):
    """Results cannot be written.

    Parameters
    ----------
    path : Path
        As the user gave it.
    cause : str
        Why not, and what to do.
    """

    def __init__(self, path: Path, cause: str) -> None:
        super().__init__(f'{path}: cannot be written: {cause}{", or" if ";" in cause else ";"} choose another folder')
        self.path = path
        self.cause = cause

    def __reduce__(self) -> tuple[type['OutputError'], tuple[Path, str]]:
        """Pickle by what it was made of, so that it can come from another process."""
        return type(self), (self.path, self.cause)


class SceneError(PolymapError):
    """A scene to simulate is unknown, malformed or impossible."""


class StateError(PolymapError):
    """A saved state cannot be continued."""


class BadOdometry(PolymapError):
    """One odometry message cannot be used; it is dropped and counted, never fatal."""


class DropReason(NamedTuple):
    """What it means that a ping was dropped.

    Parameters
    ----------
    meaning : str
        What was wrong, in general.
    remedy : str
        What to do about it; empty where the ping itself is to be mended.
    """

    meaning: str
    remedy: str = ''


_ODOMETRY_FOR_ALL = 'record odometry for as long as pings, stamped by the same clock'

DROP_REASONS = {
    'no_pose': DropReason("no odometry before or after the emission, or no place of the echo's frame on the robot "
                          '(sensor.from_tf)', _ODOMETRY_FOR_ALL),
    'pose_gap': DropReason('emitted within a gap of the odometry that is longer than odometry.max_gap_s',
                           _ODOMETRY_FOR_ALL),
    'stale': DropReason('emitted longer before the newest odometry than odometry.buffer_s', _ODOMETRY_FOR_ALL),
    'queue_full': DropReason('the oldest of more waiting pings than odometry.queue_size, or than fit in memory',
                             _ODOMETRY_FOR_ALL),
    'off_plane': DropReason('the robot was tilted or lifted off the mapping plane by more than odometry.max_tilt_deg '
                            'or odometry.max_height_m',
                            'check the odometry, or set odometry.plane, max_tilt_deg and max_height_m'),
    'duplicate': DropReason('a ping emitted at the same time has been taken before',
                            'give every ping a stamp of its own'),
    'bad_samples': DropReason('samples that are not finite, all alike, or beyond 1e-100 to 1e100; or more of them '
                              'clipped or dropped out than front_end.max_bad'),
    'bad_shape': DropReason('no row of samples with a period that can hold the pulse: fields are missing or '
                            'contradict each other'),
    'wrong_type': DropReason('no A-scan: another type than echo.type, or the scan of a lidar'),
    'paused': DropReason('received while the node was paused (~/pause)', 'call ~/pause with false'),
    'too_long': DropReason('more samples or range than a ping can have, or a gain (front_end.gain_db_s) that grows '
                           'beyond all bounds over it'),
    'too_short': DropReason('over before an echo from beyond the blanking would be',
                            'record for longer after each emission, or check the sample period and echo.blanking_m'),
}
"""Why pings are dropped, by the reason that diagnostics and polygon.json count them under."""


class BadPing(PolymapError):
    """One ping cannot be used; it is dropped and counted, never fatal.

    Parameters
    ----------
    reason : str
        One of `DROP_REASONS`, such as ``bad_samples``.
    text : str
        The sentence for the log.
    """

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason

    def __reduce__(self) -> tuple[type['BadPing'], tuple[str, str]]:
        """Pickle by what it was made of, so that it can come from another process."""
        return type(self), (self.reason, str(self))


def in_words(error: Exception, ours: Path | None = None) -> str:
    """Return what an exception says, in one line.

    Parameters
    ----------
    error : Exception
        A fault of this program is told with its place.
    ours : Path, optional
        A temporary folder, whose files' names mean nothing to a user.
    """
    if isinstance(error, OSError):
        path = error.filename2 or error.filename  # of a move, where to
        if path is None and error.errno == errno.ENOENT:  # as of os.getcwd
            return 'the current folder was removed; change to one that is there (cd), or write whole paths'
        named = path is not None and not (ours and Path(str(path)).absolute().is_relative_to(ours.absolute()))
        remedy = _REMEDIES.get(error.errno or 0)
        return f'{f"{path}: " if named else ""}{error.strerror or error}{f"; {remedy}" if remedy else ""}'
    if isinstance(error, MemoryError):
        return 'not enough memory'
    if isinstance(error, PolymapError):
        return str(error)
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    place = f' ({Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno})' if trace is not None else ''
    return ' '.join(f'{type(error).__name__}: {error}{place}'.split())
