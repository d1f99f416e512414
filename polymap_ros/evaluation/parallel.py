"""Independent jobs, spread over processes."""

import multiprocessing
import os
import signal
import threading
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
    with _interrupts_ignored():  # by the process that looks after their semaphores, too
        pool = ProcessPoolExecutor(processes, multiprocessing.get_context('spawn'), _end_with_parent)
    others = set(multiprocessing.active_children())
    try:
        with _interrupts_ignored():
            numbers = {pool.submit(function, *job): number for number, job in enumerate(jobs)}
        for future in as_completed(numbers):
            yield numbers[future], future
    except BaseException:
        # What a signal's handler raised has arrived; raised again by its alarm it would leave the pool's lock held.
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """Let this process end with the one that started it, even where that is killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None, 'is started by another process'

    def wait() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Processes started here ignore Ctrl-C, and that the terminal closes, from their first instruction on.

    It is this process that ends them.
    """
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
