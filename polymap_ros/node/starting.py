"""The node's start: kernels are loaded or compiled beside the messages, which wait meanwhile."""

import gc
import threading
import time
from collections.abc import Callable

from rclpy.node import Node

from polymap_ros.acoustics.pulse import RecordedPulse
from polymap_ros.errors import PolymapError, UsageError
from polymap_ros.jit import COMPILING, NotCompiled, are_kept, only_loading, refuse_to_compile
from polymap_ros.mapping.warm_up import warm_up
from polymap_ros.node.compiling import CompilingProcess
from polymap_ros.node.later import Later
from polymap_ros.parameters import Parameters


class Starting:
    """Makes all kernels ready in a thread, and then says so in the executor's.

    They are loaded from numba's cache. Where some are not in there, a process compiles them into it, so that the
    messages keep this one's interpreter; where there is no cache, or that process fails, the thread compiles.

    Parameters
    ----------
    node : Node
        Whose log is told.
    parameters : Parameters
        Say what is needed.
    pulse : RecordedPulse or None
        That of ``pulse.kind: file``.
    later : Later
        The executor's thread.
    follow : callable
        Called in the executor's thread when all is ready; an error is raised there in its place.
    """

    def __init__(self, node: Node, parameters: Parameters, pulse: RecordedPulse | None, later: Later,
                 follow: Callable[[], None]) -> None:
        self._log = node.get_logger()
        self._parameters, self._pulse = parameters, pulse
        self._later, self._follow = later, follow
        self._begun_s = time.monotonic()
        self._doing = 'loading'
        self._process: CompilingProcess | None = None
        self._error: Exception | None = None
        self._lock = threading.Lock()  # so that no process begins after the end
        self._closed = False
        self._thread = threading.Thread(target=self._run, name='start', daemon=True)

    def begin(self) -> None:
        """Begin, when the node is complete."""
        self._thread.start()

    @property
    def state(self) -> str:
        """What is being done, and for how long; empty when the start is over."""
        return self._doing and f'starting: {self._doing}, {time.monotonic() - self._begun_s:.0f} s'

    def close(self) -> None:
        """Break off what is being done."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.stop()
        if self._thread.ident is not None:  # it has begun
            refuse_to_compile(self._thread.ident)
            self._thread.join()

    def _run(self) -> None:
        try:
            self._make_ready()
        except Exception as error:  # raised again in the executor's thread
            self._error = error
        if not self._closed:
            gc.collect()
            self._later('start', self._end)

    def _end(self) -> None:
        if self._error is not None:
            raise _told(self._error)
        gc.freeze()  # what was compiled, too
        self._doing = ''
        self._follow()

    def _make_ready(self) -> None:
        try:
            with only_loading():
                warm_up(self._parameters, self._pulse)
            return
        except NotCompiled:
            self._doing = 'compiling'
        self._log.info(f'{COMPILING}; what comes meanwhile waits')
        if are_kept():
            self._compile_apart()
        if not self._closed:
            warm_up(self._parameters, self._pulse)

    def _compile_apart(self) -> None:
        try:
            with self._lock:
                if self._closed:
                    return
                self._process = CompilingProcess(self._parameters)
            problem = self._process.wait()
        except OSError as error:
            problem = str(error)
        if problem and not self._closed:
            self._log.warning(f'the process that compiles failed ({problem}): compiling in this one')


def _told(error: Exception) -> Exception:
    """What a user can do about an error of the compiler; others as they are."""
    if isinstance(error, (PolymapError, OSError, MemoryError)):
        return error
    problem = ' '.join(f'{type(error).__name__}: {error}'.split())
    told = UsageError(f'cannot compile for this machine: {problem[:300]}; reinstall numba, or set NUMBA_DISABLE_JIT=1 '
                      'to do without, slowly')
    told.__cause__ = error
    return told
