"""The one place that knows whether numba is there: kernels are compiled with it and plain Python without."""

import warnings
from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar('F', bound=Callable[..., Any])

try:
    import numba
    from numba.core import event
except ImportError:
    numba = None
    warnings.warn('numba is not installed: polymap_ros runs, but slowly', RuntimeWarning, stacklevel=2)
else:
    class _Compilations(event.Listener):  # type: ignore[misc]
        """Tells of the first compilation, in whatever thread."""

        tell: Callable[[str], object] | None = None

        def on_start(self, compilation: Any) -> None:
            tell, self.tell = self.tell, None
            if tell is not None:
                tell(COMPILING)

        def on_end(self, compilation: Any) -> None:
            """The abstract class asks for it."""

    _COMPILATIONS = _Compilations()
    event.register('numba:compile', _COMPILATIONS)


COMPILING = 'compiling for this machine, which may take a minute at a first start'


def when_compiling(tell: Callable[[str], object]) -> None:
    """Call `tell` with a line, once from here on, as soon as a kernel is compiled, and not just loaded."""
    if numba is not None:
        _COMPILATIONS.tell = tell


def kernel(function: F) -> F:
    """Compile an inner loop: releases the interpreter, cached on disk where there is a folder that can be written."""
    if numba is None:
        return function
    compiled: F
    try:
        compiled = numba.njit(nogil=True, cache=True)(function)
    except RuntimeError:
        # Told once, as all kernels come from this line.
        warnings.warn('no folder for numba to keep compiled code in (NUMBA_CACHE_DIR, or below HOME): polymap_ros is '
                      'compiled anew in every process', RuntimeWarning, stacklevel=1)
        compiled = numba.njit(nogil=True)(function)
    _stamp_with_callees(compiled, function)
    return compiled


def _stamp_with_callees(compiled: Any, function: Callable[..., Any]) -> None:
    """Let a cached kernel expire when a kernel that it calls has changed, too.

    numba looks at the caller's own file only, although what is called from other files is compiled into it.
    """
    callees = (function.__globals__.get(name) for name in function.__code__.co_names)
    files = [getattr(getattr(each, '_cache', None), '_cache_file', None) for each in (compiled, *callees)]
    if hasattr(own := files[0], '_source_stamp'):
        own._source_stamp = tuple(file._source_stamp for file in files if file is not None)  # type: ignore[union-attr]
