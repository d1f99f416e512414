"""Many jobs at once: on the cores of this machine, or on a Dask cluster."""

import logging
import os
import signal
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from types import FrameType
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypeVar

from polymap_ros.commands import console
from polymap_ros.errors import UsageError

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar('T')
UNIT = 'recording'
WAIT_S = 10.0
"""For an answer of the scheduler, and for its first worker."""

Jobs = Sequence[tuple[Any, ...]]
Futures = Generator[tuple[int, Any], None, None]
"""Numbers of the jobs that are over, and their futures."""


class Done(NamedTuple):
    """How a job ended, and what it had to say."""

    result: Any
    said: console.Said


def run_all(
    program: str, job: Callable[..., T], jobs: Jobs, processes: int, scheduler: str | None, lost: Callable[..., T],
    note: Callable[[T], object] = lambda result: None,
) -> list[T]:
    """Do all jobs, whose first argument is their name; what each says is printed once it is done.

    A job that is lost is reported in one line, and the others go on.

    Parameters
    ----------
    program : str
        Name of the command, for what is said.
    job : callable
        Does a job.
    jobs : sequence of tuple
        Arguments of each.
    processes : int
        Jobs at a time.
    scheduler : str, optional
        Address of a Dask cluster's, to work there.
    lost : callable
        Makes the result of a job that was lost, of its arguments and the reason.
    note : callable
        Takes each result as soon as it is there.

    Returns
    -------
    list
        Results, in the order of the jobs.
    """
    results: dict[int, T] = {}
    over = _on_cluster(job, jobs, scheduler) if scheduler else _here(job, jobs, processes)
    with closing(over), console.progress(f'{UNIT}s', len(jobs), UNIT) as advance:
        for number, future in over:
            try:
                done = future.result()
            except Exception as error:  # whatever a job ended with
                reason = ' '.join(_reason(error).split())
                text = f'{program}: error: {jobs[number][0]}: {reason}'
                done = Done(lost(*jobs[number], reason), console.Said(err=[text]))
            results[number] = done.result
            note(done.result)  # before it is told: what was told is kept, whatever interrupts this
            console.repeat(done.said)
            advance(1)
    return [results[number] for number in range(len(jobs))]


def _reason(error: Exception) -> str:
    """Why there is no result."""
    if isinstance(error, CancelledError) or type(error).__name__ == 'CommClosedError':
        return 'the scheduler was lost before it told how this ended'
    if isinstance(error, BrokenProcessPool) or type(error).__name__ == 'KilledWorker':
        return 'the process that worked on it ended abruptly, as where memory runs out'
    return f'{type(error).__name__}: {error}'


def _here(job: Callable[..., Any], jobs: Jobs, processes: int) -> Futures:
    """In processes of this machine.

    Where one of them ends abruptly, all jobs that are not over are lost with it. They are done again, those under way
    last; what is lost a second time, each in a process of its own, one after the other.
    """
    from polymap_ros.evaluation.parallel import job_futures

    left = list(range(len(jobs)))
    for _ in range(2):
        lost = []
        with closing(job_futures(_in_process, [(job, *jobs[number]) for number in left], processes)) as futures:
            for index, future in futures:
                if isinstance(future.exception(), BrokenProcessPool):
                    lost.append(left[index])
                else:
                    yield left[index], future
        left = sorted(lost, reverse=True)
    for number in sorted(left):
        with closing(job_futures(_in_process, [(job, *jobs[number])], 1)) as futures:
            for _, future in futures:
                yield number, future


def _on_cluster(job: Callable[..., Any], jobs: Jobs, address: str) -> Futures:
    """On the workers of a Dask cluster; a job whose worker ends is given to another one, by the scheduler."""
    with _client(address) as client:
        from distributed import as_completed

        numbers = {client.submit(_unseen, job, *each, pure=False): number for number, each in enumerate(jobs)}
        for future in as_completed(numbers):
            yield numbers[future], future


def check_cluster(address: str) -> None:
    """Raise `UsageError` where nothing could be done on a cluster: no Dask, no scheduler, or one without workers."""
    _client(address).close()


def _client(address: str) -> 'Client':
    """A connection to a scheduler that has workers."""
    try:
        from distributed import Client
    except ImportError:
        raise UsageError("--scheduler needs Dask: pip install 'polymap_ros[fleet]'") from None
    for name in logging.root.manager.loggerDict:
        if name.startswith('distributed'):  # its errors come back with the jobs, and are told then
            logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=WAIT_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(f'--scheduler {address}: no Dask scheduler answers there: {error}; "dask scheduler" starts '
                         'one, and tells its address') from None
    try:
        client.wait_for_workers(1, timeout=WAIT_S)
    except TimeoutError:
        client.close()
        raise UsageError(f'--scheduler {address}: it has no workers; "dask worker {address} --nthreads 1", in an '
                         'environment that has polymap_ros, starts one') from None
    return client


def _unseen(job: Callable[..., Any], *arguments: Any) -> Done:
    with console.unseen() as said:
        result = job(*arguments)
    return Done(result, said)


def _in_process(job: Callable[..., Any], *arguments: Any) -> Done:
    """SIGTERM unwinds the job, which cleans up after itself, and then ends the process; without a job, at once."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGHUP)}
    signal.signal(signal.SIGTERM, _stop)
    try:
        return _unseen(job, *arguments)
    except KeyboardInterrupt:
        os._exit(console.TERMINATED)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        for number, handler in before.items():
            signal.signal(number, handler)


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    console.again_if_ignored(_stop)
    console.stop(KeyboardInterrupt())
