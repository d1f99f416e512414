"""The one place that knows whether numba is there: kernels are compiled with it and plain Python without."""

import warnings
from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar('F', bound=Callable[..., Any])

try:
    import numba
except ImportError:
    numba = None
    warnings.warn('numba is not installed: polymap_ros runs, but slowly', RuntimeWarning, stacklevel=2)


def kernel(function: F) -> F:
    """Compile an inner loop: releases the interpreter, cached on disk."""
    if numba is None:
        return function
    compiled: F = numba.njit(nogil=True, cache=True)(function)
    return compiled
