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

from polymap_ros.atomic import check_writable, move_into_place, staging
from polymap_ros.cautions import Caution
from polymap_ros.errors import OutputError, PolymapError, in_words
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.node.stopwatch import Stopwatch
from polymap_ros.parameters import Parameters
from polymap_ros.paths import working_folder
from polymap_ros.result_parameters import OutputParameters
from polymap_ros.results.folder import STATE, Unwritten, write_results
from polymap_ros.results.save import answer, map_cautions, map_files
from polymap_ros.solvers.estimate import Estimate


class Content(NamedTuple):
    """What a save holds: the number of the map, counted by resets, its pings, and the answer."""

    map: int
    pings: int
    estimate: Estimate | None


class Saved(NamedTuple):
    """A folder that was written, by its absolute path, and what is missing in it."""

    folder: Path
    unwritten: tuple[Unwritten, ...]

    @property
    def missing(self) -> frozenset[str]:
        """Names of the files that could not be written."""
        return frozenset(name for each in self.unwritten for name in each.names)

    @property
    def whole(self) -> bool:
        """Whether the answer is there, and can be gone on from."""
        return STATE not in self.missing

    @property
    def problem(self) -> str:
        """What is missing, and why; empty where nothing is."""
        return '; '.join(map(str, self.unwritten))


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
        self._asked = 0  # saves that a client waits for
        self._home = working_folder()  # output.dir is relative to it, even where it is removed meanwhile
        self._node = node
        self._mapper = mapper
        self._parameters = parameters
        self._start = stopwatch.timed('begin of a save', self._start_save)
        self._writer = ThreadPoolExecutor(1, thread_name_prefix='save')
        self._automatic: tuple[Content, Future[Saved]] | None = None
        self._automatic_s = time.monotonic()
        self._kept: list[Saved] = []  # of the map that was saved last, which a reset may have ended since
        self._kept_map = 0
        self._maps = 0
        self._saved = self._content()
        self._check(parameters().output)
        # A group of its own: the service waits for the disk, and the inputs must not wait with it.
        node.create_service(Trigger, '~/save', self._serve, callback_group=MutuallyExclusiveCallbackGroup())

    def _check(self, output: OutputParameters) -> None:
        """Say at the start what a save would find out; the node goes on, as a disk may come later."""
        try:
            check_writable(Path(os.path.realpath(self._home / output.dir)))
        except (OutputError, OSError) as error:
            problem = f'nothing can be saved (output.dir): {in_words(error)}'
            self._node.get_logger().error(problem)
            self.problem = problem if output.autosave_s > 0.0 else ''

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

    @property
    def answering(self) -> bool:
        """Whether a client waits for a save."""
        return self._asked > 0

    def begin_anew(self) -> None:
        """The map is reset: what was saved of it stays, and the next one is saved beside it."""
        self._maps += 1

    def close(self) -> None:
        """Let a running save finish, and save a last time where automatic saves are on."""
        self._finish_automatic()
        output = self._parameters().output
        if output.autosave_s > 0.0 and self._is_new():
            self._node.get_logger().info(f'saving the map to {self._home / output.dir}: wait for it')
            saved = self._note(self._start(), self._node.get_logger().error)
            if saved is not None:
                self._keep(self._maps, saved)
                self._node.get_logger().info(f'saved: {saved.folder}')
        self._writer.shutdown()

    def _content(self) -> 'Content':
        counts = self._mapper.counts
        pings = counts.used + (counts.waiting if self._mapper.intake.held else 0)  # those are in the state, too
        return Content(self._maps, pings, self._mapper.estimate)

    def _is_new(self) -> bool:
        """Whether pings came, or an answer, since the last automatic save that succeeded."""
        content = self._content()
        return content.pings > 0 and content != self._saved

    def _start_save(self) -> 'Future[Saved]':
        mapper, parameters = self._mapper, self._parameters()
        waiting = f': {mapper.counts.waiting} pings wait for the end of the start' if mapper.intake.held else ''
        estimate = mapper.estimate or Estimate('open', parameters.solver.method, cautions=(
            Caution('no_answer', f'nothing has been solved yet{waiting}'),))
        return self._writer.submit(write, mapper.twin(), estimate, parameters, self._home)

    def _finish_automatic(self) -> None:
        """Of each map keep the newest automatic save, and older ones only where they have files that it lacks."""
        if self._automatic is None:
            return
        (content, future), self._automatic = self._automatic, None
        saved = self._note(future, self._complain)
        if saved is None:  # tried again after the next interval
            return
        if saved.whole:
            self._saved = content
        self._keep(content.map, saved)

    def _keep(self, number: int, saved: Saved) -> None:
        """Take the place of what was saved of this map before."""
        if number != self._kept_map:
            self._kept, self._kept_map = [], number
        for older in self._kept:
            if saved.missing <= older.missing:
                self._writer.submit(discard, older.folder)
        self._kept = [*(older for older in self._kept if not saved.missing <= older.missing), saved]

    def _complain(self, text: str) -> None:
        """Log the trouble of automatic saves, which comes again with each of them."""
        self._node.get_logger().error(text, throttle_duration_sec=10.0)

    def _note(self, future: 'Future[Saved]', complain: Callable[[str], object]) -> Saved | None:
        try:
            saved = future.result()
        except Exception as error:  # a full disk, or a fault of ours: the mapping goes on
            self.problem = f'cannot save: {in_words(error)}'
            known = isinstance(error, (OSError, PolymapError))
            complain(self.problem if known else '\n'.join((self.problem, *format_exception(error))))
            return None
        self.saved, self.problem = str(saved.folder), ''
        if saved.unwritten:
            self.problem = f'{saved.folder}: {saved.problem}'
            complain(self.problem)
        return saved

    async def _serve(self, request: Any, response: Any) -> Any:
        future = self._start()
        executor = self._node.executor
        written = RosFuture(executor=executor)
        self._asked += 1

        def answer_now(_: Future[Saved]) -> None:
            with suppress(AttributeError):  # the executor has ended, and the client waits no longer
                executor.create_task(partial(written.set_result, None))

        future.add_done_callback(answer_now)
        try:
            await written
        finally:
            self._asked -= 1
        saved = self._note(future, self._node.get_logger().error)
        if not self.problem:
            self._node.get_logger().info(f'saved: {self.saved}')
        response.success = saved is not None and saved.whole
        response.message = self.problem or self.saved
        return response


def write(mapper: PolygonMapper, estimate: Estimate, parameters: Parameters, home: Path = Path()) -> Saved:
    """Write a twin of the mapper as a whole folder that did not exist before; `output.dir` may be relative to `home`.

    Raises
    ------
    OutputError
        Where not even the answer can be written.
    """
    parent = Path(os.path.realpath(home / parameters.output.dir))
    files = answer(mapper, estimate, parameters, map_cautions(estimate, parameters))
    try:
        with staging(parent / 'save') as stage:
            unwritten = write_results(stage / 'files', files, map_files(estimate, parameters))
            targets = (parent / f'{mapper.places.last_ns}-{n}' for n in itertools.count(1))
            return Saved(_moved(stage / 'files', targets), tuple(unwritten))
    except OSError as error:
        raise OutputError(parent, in_words(error, parent)) from error
    except OutputError as error:
        raise OutputError(parent, error.cause) from error


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
