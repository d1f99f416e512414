"""How long work is shown, waited for and stopped: it calls a checkpoint between its steps."""

from collections.abc import Callable

Checkpoint = Callable[[], object]
"""Called between two steps of long work: it may show progress, wait, or raise `Stopped`."""


class Stopped(Exception):
    """Raised by a checkpoint to end the work that called it; what the work had found by then is dropped."""


def unwatched() -> None:
    """Return at once: the checkpoint of work that is neither shown nor stopped."""
