"""A node as a process of its own, watched from outside: what it costs, and what it says of itself."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from polymap_ros.errors import UsageError

START_S = 60.0
STOP_S = 20.0


class Observed:
    """A process that runs a module of the package, until the ``with`` block ends.

    Parameters
    ----------
    module : str
        Module to run, such as ``polymap_ros.commands.node``.
    arguments : sequence of str
        Its command line.

    Attributes
    ----------
    status : int or None
        Exit status, after the end.
    """

    def __init__(self, module: str, arguments: Sequence[str]) -> None:
        self.status: int | None = None
        self._process = subprocess.Popen(
            [sys.executable, '-m', module, *arguments], stderr=subprocess.PIPE, text=True, start_new_session=True)
        self._folder = Path('/proc') / str(self._process.pid)
        self._ready = threading.Event()
        self._last = ''
        threading.Thread(target=self._read, daemon=True).start()

    def __enter__(self) -> 'Observed':
        if not self._ready.wait(START_S) or self._process.poll() is not None:
            self.close()
            raise UsageError(f'the node did not start: {self._last}')
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process as Ctrl-C does."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(STOP_S)
            self._process.kill()
        self.status = self._process.wait()

    @property
    def cpu_s(self) -> float:
        """Time spent by all threads so far [s]."""
        fields = (self._folder / 'stat').read_text().rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    @property
    def memory_bytes(self) -> int:
        """Resident memory."""
        return int((self._folder / 'statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE')

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self._last = line.rstrip()
            if 'ready:' in line:
                self._ready.set()
        self._ready.set()


class Observer:
    """Hears the node's diagnostics, in a thread, while the ``with`` block lasts.

    Attributes
    ----------
    heard : callable or None
        Called with the time [s, steady clock] and the values by key, once a second.
    newest : dict
        The newest values, and `message`.
    """

    def __init__(self) -> None:
        self.heard: Callable[[float, dict[str, str]], None] | None = None
        self.newest: dict[str, str] = {}

    @contextmanager
    def listening(self) -> Iterator['Observer']:
        """Listen; rclpy has to be initialised."""
        node = Node('polymap_listener', start_parameter_services=False)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 10)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        thread = threading.Thread(target=self._spin, args=(executor,), daemon=True)
        thread.start()
        try:
            yield self
        finally:
            executor.shutdown()
            thread.join()
            node.destroy_node()

    def wait_for(self, wanted: Callable[[dict[str, str]], bool], timeout_s: float) -> bool:
        """Wait until the newest values are as wanted; False after `timeout_s`."""
        end_s = time.monotonic() + timeout_s
        while not wanted(self.newest) and time.monotonic() < end_s:
            time.sleep(0.1)
        return wanted(self.newest)

    def _take(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith('polymap_node:'):
                self.newest = {pair.key: pair.value for pair in status.values} | {'message': status.message}
                if self.heard is not None:
                    self.heard(time.monotonic(), self.newest)

    @staticmethod
    def _spin(executor: SingleThreadedExecutor) -> None:
        with suppress(ExternalShutdownException):
            executor.spin()
