"""The one place that knows whether numba is there: kernels are compiled with it and plain Python without."""

import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

F = TypeVar('F', bound=Callable[..., Any])

COMPILING = 'compiling for this machine, which may take a minute at a first start'

_KERNELS: list[Callable[..., Any]] = []
_TOLD: set[str] = set()


class NotCompiled(Exception):
    """A kernel would have to be compiled where that is not wanted."""


class NotKept(RuntimeWarning):
    """Compiled code cannot be kept on disk for the next process."""


try:
    import numba
    from numba.core import event
except ModuleNotFoundError:
    numba = None
    warnings.warn('numba is not installed: polymap_ros runs, but slowly', RuntimeWarning, stacklevel=2)
except (ImportError, AttributeError, SystemError) as error:  # of one that does not fit numpy, or its own parts
    numba = None
    warnings.warn(f'numba cannot be used ({error}): polymap_ros runs, but slowly', RuntimeWarning, stacklevel=2)
else:
    class _Compilations(event.Listener):  # type: ignore[misc]
        """Tells of the first compilation, in whatever thread, and refuses those of threads that want none."""

        def __init__(self) -> None:
            self.tell: Callable[[str], object] | None = None
            self.refusing: set[int] = set()

        def on_start(self, compilation: Any) -> None:
            if threading.get_ident() in self.refusing:
                raise NotCompiled
            if compilation.kind == 'numba:compile':
                tell, self.tell = self.tell, None
                if tell is not None:
                    tell(COMPILING)

        def on_end(self, compilation: Any) -> None:
            """The abstract class asks for it."""

    _COMPILATIONS = _Compilations()
    event.register('numba:compile', _COMPILATIONS)
    event.register('numba:run_pass', _COMPILATIONS)  # of which a compilation has dozens: it can be broken off


IS_COMPILED = numba is not None
"""Whether kernels are compiled, and not plain Python."""


def when_compiling(tell: Callable[[str], object]) -> None:
    """Call `tell` with a line, once from here on, as soon as a kernel is compiled, and not just loaded."""
    if numba is not None:
        _COMPILATIONS.tell = tell


def refuse_to_compile(thread: int) -> None:
    """Let a thread [identifier] raise `NotCompiled` rather than compile; one that is compiling breaks off soon."""
    if numba is not None:
        _COMPILATIONS.refusing.add(thread)


@contextmanager
def only_loading() -> Iterator[None]:
    """Raise `NotCompiled` where this thread would have to compile a kernel within the ``with`` block."""
    refuse_to_compile(thread := threading.get_ident())
    try:
        yield
    finally:
        if numba is not None:
            _COMPILATIONS.refusing.discard(thread)


def are_kept() -> bool:
    """Whether the compiled code of all kernels made so far is kept on disk for the next process."""
    return all(getattr(getattr(each, '_cache', None), 'cache_path', None) is not None for each in _KERNELS)


def kernel(function: F, inline: str = 'never') -> F:
    """Compile an inner loop: releases the interpreter, cached on disk where there is a folder that can be written."""
    if numba is None:
        return function
    compiled: F
    try:
        compiled = numba.njit(nogil=True, cache=True, inline=inline)(function)
    except RuntimeError:
        _tell_once('no folder for numba to keep compiled code in (NUMBA_CACHE_DIR, or below HOME): polymap_ros is '
                   'compiled anew in every process', NotKept)
        compiled = numba.njit(nogil=True, inline=inline)(function)
    else:
        if hasattr(compiled, '_cache'):  # not with NUMBA_DISABLE_JIT
            _stamp_with_callees(compiled, function)
            _do_without(compiled._cache)
    _KERNELS.append(compiled)
    return compiled


def within_kernels(function: F) -> F:
    """Let kernels hold this function's code rather than call it.

    A call counts every array among its arguments as one more in use, and as one less after it: where these are tuples
    of arrays and the work is that of one path, that takes longer than the work.
    """
    return kernel(function, 'always')


def _do_without(cache: Any) -> None:
    """Go on where numba's cache fails, as on a full disk or where the power went while it was written."""
    load, save = cache.load_overload, cache.save_overload

    def loaded(*arguments: Any) -> Any:
        try:
            return load(*arguments)
        except Exception as error:  # whatever unpickling raises for what is no pickle
            _tell_once(f'compiled code in {cache.cache_path} cannot be read ({type(error).__name__}), and is '
                       'compiled anew', RuntimeWarning)
            with suppress(OSError):
                cache.flush()
            return None

    def saved(*arguments: Any) -> None:
        try:
            save(*arguments)
        except OSError as error:
            _tell_once(f'compiled code cannot be kept (NUMBA_CACHE_DIR): {error.strerror}; polymap_ros is compiled '
                       'anew in every process', NotKept)

    cache.load_overload, cache.save_overload = loaded, saved


def _tell_once(text: str, category: type[Warning]) -> None:
    """Warn; numba, and other imports, make Python forget what it has warned of."""
    if text not in _TOLD:
        _TOLD.add(text)
        warnings.warn(text, category, stacklevel=1)


def _stamp_with_callees(compiled: Any, function: Callable[..., Any]) -> None:
    """Let a cached kernel expire when a kernel that it calls has changed, too.

    numba looks at the caller's own file only, although what is called from other files is compiled into it.
    """
    callees = (function.__globals__.get(name) for name in function.__code__.co_names)
    files = [getattr(getattr(each, '_cache', None), '_cache_file', None) for each in callees]
    own = compiled._cache._cache_file
    own._source_stamp = tuple(file._source_stamp for file in (own, *files) if file is not None)
