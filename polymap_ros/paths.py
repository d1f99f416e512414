"""Paths as users write them in parameters, scenes and arguments that no shell has seen."""

import os
from pathlib import Path


def working_folder() -> Path:
    """Return the current folder's path; an empty one where it was removed, in which only whole paths lead anywhere."""
    try:
        return Path.cwd()
    except FileNotFoundError:
        return Path()


def expanded(text: str) -> str:
    """Return a path with ``~`` or ``~user`` at its start expanded as a shell does.

    Raises
    ------
    ValueError
        For a user who has no home here, and for a variable, which only a shell knows. ``./~`` and ``./$`` are names.
    """
    if text.startswith('$'):
        raise ValueError(f'{text!r} names a variable, which is not looked up here; write ~, or the whole path')
    path = os.path.expanduser(text)  # noqa: PTH111, which changes nothing else about the path
    if text.startswith('~') and path == text:
        user = text[1:].partition('/')[0]
        raise ValueError(f'{text!r}: {f"there is no user {user}" if user else "no home folder is known"}; write the '
                         'whole path')
    return path
