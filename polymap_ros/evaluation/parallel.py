"""Independent jobs, spread over processes."""

import multiprocessing
import signal
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import closing, contextmanager
from typing import TypeVar

T = TypeVar('T')


def run_jobs(
    function: Callable[..., T], jobs: Sequence[tuple[object, ...]], processes: int
) -> Generator[T, None, None]:
    """Yield ``function(*job)`` for every job as it is done, in any order.

    With one process everything runs in this one. An error in a job ends the run. Close it, lest an interrupt of whoever
    takes the results leaves the processes at work.
    """
    if processes == 1:
        for job in jobs:
            yield function(*job)
        return
    with closing(job_futures(function, jobs, processes)) as futures:
        for _, future in futures:
            yield future.result()


def job_futures(
    function: Callable[..., T], jobs: Sequence[tuple[object, ...]], processes: int
) -> Generator[tuple[int, Future[T]], None, None]:
    """Yield the number and the future of every job once it is done or has failed, in any order.

    Where this ends early, closed or interrupted, the processes get SIGTERM, and this waits for their end.
    """
    pool = ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context('spawn'))
    others = set(multiprocessing.active_children())
    try:
        with _interrupts_ignored():
            numbers = {pool.submit(function, *job): number for number, job in enumerate(jobs)}
        for future in as_completed(numbers):
            yield numbers[future], future
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Processes started here ignore Ctrl-C from their first instruction on: it is this process that ends them."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
