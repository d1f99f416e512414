"""Writing what was found, beside the node's other work: for ``~/save`` and at intervals."""

import errno
import itertools
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from traceback import format_exception
from typing import Any, NamedTuple

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.task import Future as RosFuture
from std_srvs.srv import Trigger

from polymap_ros.atomic import move_into_place, staging
from polymap_ros.errors import PolymapError
from polymap_ros.mapping.estimate import Caution, Estimate
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.node.stopwatch import Stopwatch
from polymap_ros.parameters import Parameters
from polymap_ros.results.save import write_results


class Content(NamedTuple):
    """What a save holds: the number of the map, counted by resets, its pings, and the answer."""

    map: int
    pings: int
    estimate: Estimate | None


class Saver:
    """Saves to ``<output.dir>/<stamp_ns>-<n>``; the files are written in a thread from a snapshot.

    Parameters
    ----------
    node : Node
        Offers the service.
    mapper : PolygonMapper
        What is saved.
    parameters : callable
        Gives the parameters in force.
    stopwatch : Stopwatch
        Times the callbacks.

    Attributes
    ----------
    saved : str
        The folder written last.
    problem : str
        Why the last save failed; empty when it did not.
    """

    def __init__(
        self, node: Node, mapper: PolygonMapper, parameters: Callable[[], Parameters], stopwatch: Stopwatch
    ) -> None:
        self.saved = self.problem = ''
        self._node = node
        self._mapper = mapper
        self._parameters = parameters
        self._start = stopwatch.timed('begin of a save', self._start_save)
        self._writer = ThreadPoolExecutor(1, thread_name_prefix='save')
        self._automatic: tuple[Content, Future[Path]] | None = None
        self._automatic_s = time.monotonic()
        self._automatic_folder: Path | None = None
        self._maps = 0
        self._saved = self._content()
        # A group of its own: the service waits for the disk, and the inputs must not wait with it.
        node.create_service(Trigger, '~/save', self._serve, callback_group=MutuallyExclusiveCallbackGroup())

    def autosave(self) -> None:
        """Save where `output.autosave_s` asks for it and something new came; called about once a second."""
        if self._automatic is not None and not self._automatic[1].done():
            return
        self._finish_automatic()
        interval_s = self._parameters().output.autosave_s
        due = interval_s > 0.0 and time.monotonic() - self._automatic_s >= interval_s
        if due and self._is_new():
            self._automatic_s = time.monotonic()
            self._automatic = self._content(), self._start()

    def begin_anew(self) -> None:
        """The map is reset: what was saved of it stays, and the next one is saved beside it."""
        self._maps += 1
        self._automatic_folder = None

    def close(self) -> None:
        """Let a running save finish, and save a last time where automatic saves are on."""
        self._finish_automatic()
        if self._parameters().output.autosave_s > 0.0 and self._is_new():
            self._automatic = self._content(), self._start()
            self._finish_automatic()
        self._writer.shutdown()

    def _content(self) -> 'Content':
        return Content(self._maps, self._mapper.counts.used, self._mapper.estimate)

    def _is_new(self) -> bool:
        """Whether pings came, or an answer, since the last automatic save that succeeded."""
        content = self._content()
        return content.pings > 0 and content != self._saved

    def _start_save(self) -> 'Future[Path]':
        mapper, parameters = self._mapper, self._parameters()
        estimate = mapper.estimate or Estimate(
            'open', parameters.solver.method, cautions=(Caution('no_answer', 'nothing has been solved yet'),))
        return self._writer.submit(write, mapper.twin(), estimate, parameters)

    def _finish_automatic(self) -> None:
        """Of each map keep only the newest automatic save."""
        if self._automatic is None:
            return
        (content, future), self._automatic = self._automatic, None
        folder = self._note(future)
        if folder is None:  # tried again after the next interval
            return
        self._saved = content
        if content.map == self._maps:
            if self._automatic_folder is not None:
                self._writer.submit(discard, self._automatic_folder)
            self._automatic_folder = folder

    def _note(self, future: 'Future[Path]') -> Path | None:
        try:
            folder = future.result()
        except Exception as error:  # a full disk, or a fault of ours: the mapping goes on
            self.problem = f'cannot save: {error}'
            known = isinstance(error, (OSError, PolymapError))
            self._node.get_logger().error(
                self.problem if known else '\n'.join((self.problem, *format_exception(error))),
                throttle_duration_sec=10.0)
            return None
        self.saved, self.problem = str(folder), ''
        return folder

    async def _serve(self, request: Any, response: Any) -> Any:
        future = self._start()
        executor = self._node.executor
        written = RosFuture(executor=executor)
        future.add_done_callback(lambda _: executor.create_task(partial(written.set_result, None)))
        await written
        folder = self._note(future)
        response.success = folder is not None
        response.message = self.problem if folder is None else str(folder)
        return response


def write(mapper: PolygonMapper, estimate: Estimate, parameters: Parameters) -> Path:
    """Write a twin of the mapper as a whole folder that did not exist before; return its absolute path."""
    parent = Path(os.path.realpath(parameters.output.dir))
    with staging(parent / 'save') as stage:
        files = stage / 'files'
        files.mkdir()
        write_results(files, mapper, estimate, parameters)
        return _moved(files, (parent / f'{mapper.places.last_ns}-{n}' for n in itertools.count(1)))


def _moved(files: Path, targets: Iterator[Path]) -> Path:
    """Move a folder to the first target that is free: another node may take one between the look and the move."""
    while True:
        target = next(target for target in targets if not target.exists())
        try:
            move_into_place(files, target)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        else:
            return target


def discard(folder: Path) -> None:
    """Remove a saved folder so that half of one is never taken for a save; what cannot be removed stays."""
    with suppress(OSError), staging(folder.parent / 'save') as stage:
        folder.replace(stage / folder.name)
