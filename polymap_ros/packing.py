"""Numbers read back from the arrays of a saved state."""

from typing import Any

import numpy as np

from polymap_ros.errors import StateError

_MOST = 2**62
"""Upper bound for stored counters and stamps, so that incrementing them cannot overflow int64."""


def whole_number(value: Any, least: int = 0) -> int:
    """A number that can be counted to, of an array's one element; `StateError` for any other."""
    number = np.asarray(value)
    if number.shape != () or number.dtype.kind not in 'iu' or not least <= int(number) <= _MOST:
        raise StateError(f'{number.tolist()!r:.80} is not a whole number from {least} to {_MOST}')
    return int(number)
