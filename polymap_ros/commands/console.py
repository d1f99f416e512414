"""What the commands share: arguments, parameters, one-line errors, exit status, progress."""

import argparse
import functools
import io
import os
import resource
import shutil
import signal
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, TypeVar

from polymap_ros import __version__
from polymap_ros.errors import PolymapError, in_words
from polymap_ros.parameter_file import load_parameters, parse_override
from polymap_ros.parameters import Parameters
from polymap_ros.paths import expanded

T = TypeVar('T')
DONE, NO_POLYGON, WRONG, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143
FORESEEN = (PolymapError, OSError, MemoryError)
"""Errors that a user can cause."""
AGAIN_S = 5.0
"""Longer than a job takes to clean up after itself."""


@dataclass
class Said:
    """What a job had to say that ran where nobody looks: lines for stdout and for stderr."""

    out: list[str] = field(default_factory=list)
    err: list[str] = field(default_factory=list)


_SAID: ContextVar[Said | None] = ContextVar('_SAID', default=None)
_LOST: list[str] = []
"""Why this process's stdout is not complete."""
_SIGNALS: dict[int, str] = {signal.SIGINT: 'interrupted', signal.SIGTERM: 'terminated', signal.SIGHUP: 'hung up'}
"""That end a command, and how that is told."""
_STOPS: list[KeyboardInterrupt] = []
"""What signals have raised to end the work."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, and whose help ends with command lines to try.

    With it the streams are ready to be told.
    """

    def __init__(self, program: str, description: str, epilog: str = '', examples: Sequence[str] = ()) -> None:
        ready_streams()
        width = max(shutil.get_terminal_size().columns - 2, 40)
        parts = [textwrap.fill(epilog, width), '\n  '.join(('examples:', *examples))]
        super().__init__(prog=program, description=textwrap.fill(description, width), epilog='\n\n'.join(parts).strip(),
                         formatter_class=argparse.RawDescriptionHelpFormatter)
        self.add_argument('--version', action='version', version=f'{program} {__version__}')

    def error(self, message: str) -> NoReturn:
        complain(self.prog, f'{message} (see {self.prog} --help)')
        sys.exit(WRONG)


class _Forgiving(io.FileIO):
    """What cannot be said, as nobody listens any longer or the disk is full, is lost; the work is not."""

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError:
            return memoryview(data).nbytes


def ready_streams() -> None:
    """Let stdout and stderr take any letter, and stderr anything at all, where they are this process's own."""
    if sys.stderr is sys.__stderr__ and sys.__stderr__ is not None:
        raw = _Forgiving(sys.__stderr__.fileno(), 'w', closefd=False)
        sys.stderr = io.TextIOWrapper(io.BufferedWriter(raw), sys.__stderr__.encoding, line_buffering=True)
    # A stream that the caller closed is None.
    sys.stdout, sys.stderr = (stream or Path(os.devnull).open('w', encoding='utf-8')  # noqa: SIM115
                              for stream in (sys.stdout, sys.stderr))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name that the terminal has no letters for is told all the same
            stream.reconfigure(errors='backslashreplace')


def argument(expected: str) -> Callable[[Callable[[str], T]], Callable[[str], T]]:
    """Make the type of an argument of a function that raises ValueError for what is not `expected`."""
    def typed(parse: Callable[[str], T]) -> Callable[[str], T]:
        @functools.wraps(parse)
        def read(text: str) -> T:
            try:
                return parse(text)
            except ValueError:
                raise argparse.ArgumentTypeError(f'{text!r}: must be {expected}') from None
        return read
    return typed


@argument('a whole number, at least 1')
def count(text: str) -> int:
    """The type of an argument that counts something."""
    if int(text) < 1:
        raise ValueError
    return int(text)


def path_argument(text: str) -> Path:
    """The type of an argument that is a path: no shell expands the ``~`` in ``--output=~/maps``."""
    if not text:  # as of a variable that is not set
        raise argparse.ArgumentTypeError("'' names nothing; write . for the current folder")
    try:
        return Path(expanded(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def add_parameter_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--params-file`` and ``-p``, as ROS nodes have them."""
    parser.add_argument('--params-file', type=path_argument, metavar='FILE',
                        help='ROS parameter file of polymap_node; without it every parameter has its default')
    parser.add_argument('-p', '--param', action='append', default=[], metavar='NAME:=VALUE', dest='overrides',
                        help='set one parameter, after the file; may be repeated')


def read_parameters(program: str, arguments: argparse.Namespace) -> Parameters:
    """Return the parameters that the arguments of `add_parameter_arguments` ask for."""
    overrides = dict(parse_override(text) for text in arguments.overrides)
    if arguments.params_file:
        return load_parameters(arguments.params_file, overrides,
                               warn=lambda text: complain(program, f'warning: {text}'))
    return Parameters().replaced(overrides)


def one_core() -> None:
    """Keep numerical libraries to one core, if this comes before their import.

    Processes side by side then do not get in each other's way, and sums are made in the same order everywhere.
    """
    for library in ('OMP', 'OPENBLAS', 'MKL', 'NUMBA'):
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')


@contextmanager
def unseen() -> Iterator[Said]:
    """Collect what is told and complained of in this block, in this thread, and show no progress."""
    said = Said()
    token = _SAID.set(said)
    try:
        yield said
    finally:
        _SAID.reset(token)


def repeat(said: Said) -> None:
    """Print what was collected, above the progress bar if there is one."""
    from tqdm import tqdm

    with tqdm.external_write_mode(sys.stderr):
        for line in said.out:
            tell(line)
        for line in said.err:
            print(_visible(line), file=sys.stderr, flush=True)


def _visible(text: str) -> str:
    """Lines without what moves a terminal's cursor or changes its colours: names in a recording may hold it."""
    return '\n'.join(map(in_one_line, text.split('\n')))


def in_one_line(name: object) -> str:
    """Return a name or a path with all that is not printed, line breaks too, spelled out as in Python: ``\\n``."""
    return ''.join(each if each.isprintable() else each.encode('unicode_escape').decode() for each in str(name))


def complain(program: str, text: str) -> None:
    """Print one line on stderr."""
    line = f'{program}: {" ".join(text.split())}'
    if said := _SAID.get():
        said.err.append(line)
    else:
        print(_visible(line), file=sys.stderr, flush=True)


def tell_compiling(program: str) -> None:
    """Print a line on stderr when kernels are compiled, above the progress bar if there is one."""
    from tqdm import tqdm

    from polymap_ros.jit import when_compiling

    ready_streams()

    def told(text: str) -> None:
        with tqdm.external_write_mode(sys.stderr):
            print(f'{program}: {text}', file=sys.stderr, flush=True)

    when_compiling(told)


def tell(text: str) -> None:
    """Print a result on stdout; who has closed it has seen enough, and the work goes on.

    What a full disk loses of it is told by `execute` at the end.
    """
    if said := _SAID.get():
        said.out.append(text)
        return
    try:
        print(_visible(text), flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            _LOST.append(f'standard output: {error.strerror}; what was to be written is written')


def attempt(program: str, job: Callable[[], int]) -> int:
    """Run a job; an error becomes one line on stderr and status 2: one that a user can cause, or a fault of ours."""
    try:
        with stops_heeded():
            return job()
    except Exception as error:  # a fault of ours is told with its place
        complain(program, f'error: {in_words(error)}')
    return WRONG


def execute(program: str, job: Callable[[], int]) -> int:
    """Run a command's job as `attempt` does; Ctrl-C becomes status 130, SIGTERM 143, a terminal that closes 129.

    Nothing is left half done.
    """
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # a recording may have more parts than the usual 1024
    before, hook = {number: signal.getsignal(number) for number in _SIGNALS}, sys.unraisablehook
    for number, handler in before.items():
        if handler in (signal.SIG_DFL, signal.default_int_handler):  # not where the caller has it ignored
            signal.signal(number, _end)
    _LOST.clear()
    try:
        status = attempt(program, job)
        for text in _LOST:
            complain(program, f'error: {text}')
        return max(status, WRONG) if _LOST else status
    except KeyboardInterrupt as why:
        number = why.number if isinstance(why, _Stopped) else int(signal.SIGINT)
        complain(program, _SIGNALS[number])
        return 128 + number
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)
        sys.unraisablehook = hook
        _STOPS.clear()


class _Stopped(KeyboardInterrupt):
    """A signal that ends a command; where a plain one is raised in an ``exec`` of text, Python has no status."""

    def __init__(self, number: int) -> None:
        super().__init__(_SIGNALS[number])
        self.number = number


def again_if_ignored(handler: Callable[[int, FrameType | None], NoReturn]) -> None:
    """Let a handler that raises be called again in a while, unless `signal.setitimer` is set to 0 before.

    What is raised in a finalizer or a callback from C does not get far: Python goes on. Until then further signals
    are ignored: a second one would cut short what the first has begun to clean up.
    """
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, AGAIN_S)


def stop(why: KeyboardInterrupt) -> NoReturn:
    """Raise this in a signal's handler, such that `stops_heeded` knows of it."""
    _STOPS.append(why)
    sys.unraisablehook = _tell_unless_a_stop  # the stop comes again, and a traceback says nothing to a user
    raise why


def _tell_unless_a_stop(told: 'sys.UnraisableHookArgs') -> None:
    if told.exc_value not in _STOPS:
        sys.__unraisablehook__(told)


@contextmanager
def stops_heeded() -> Iterator[None]:
    """Raise at the end of this block what a signal raised within, whatever has become of it.

    Numba makes a SystemError of it, finalizers and callbacks from C nothing at all.
    """
    try:
        yield
    finally:
        if _STOPS:
            raise _STOPS[-1]


def _end(number: int, frame: FrameType | None) -> NoReturn:
    again_if_ignored(lambda alarm, frame: _end(number, frame))
    stop(_Stopped(number))


@contextmanager
def progress(label: str, total: int | None, unit: str = 'it') -> Iterator[Callable[[int], object]]:
    """Show a progress bar on stderr; the function given takes the number of steps done since the last call.

    Where stderr is no terminal a line every ten seconds does.
    """
    if _SAID.get():
        yield lambda done: None
        return
    from tqdm import tqdm

    interval_s = 0.1 if sys.stderr.isatty() else 10.0
    # With a delay nothing is printed before the bar is complete: Ctrl-C in between would leave a traceback.
    with tqdm(desc=in_one_line(label), total=total, unit=unit, file=sys.stderr, mininterval=interval_s,
              dynamic_ncols=True, delay=1e-9) as bar:
        bar.refresh()
        yield bar.update


def worked(work: Callable[[Callable[[], object]], T], label: str) -> T:
    """Do a piece of work that is given a checkpoint to call between its steps, with a progress bar."""
    with progress(label, None, 'step') as advance:
        return work(lambda: advance(1))
