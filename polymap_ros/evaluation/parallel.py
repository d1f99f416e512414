"""Independent jobs, spread over processes."""

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar('T')


def run_jobs(function: Callable[..., T], jobs: Sequence[tuple[object, ...]], processes: int) -> Iterator[T]:
    """Yield ``function(*job)`` for every job as it is done, in any order.

    With one process everything runs in this one. An error in a job ends the run.
    """
    if processes == 1:
        for job in jobs:
            yield function(*job)
        return
    pool = ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context('spawn'))
    try:
        with _interrupts_ignored():
            futures = [pool.submit(function, *job) for job in jobs]
        for future in as_completed(futures):
            yield future.result()
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
