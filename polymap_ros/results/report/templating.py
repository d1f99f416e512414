"""Jinja2 as the pages use it: everything that is put into a page is escaped, and nothing in it is invisible."""

import importlib
from functools import cache
from importlib import resources
from typing import Any

from polymap_ros.errors import UsageError, in_words
from polymap_ros.results.report.svg import visible


def require_jinja() -> None:
    """Raise `UsageError` where pages cannot be written."""
    try:
        importlib.import_module('jinja2')
    except ModuleNotFoundError:
        raise UsageError("--report needs Jinja2: pip install 'polymap_ros[report]'") from None
    except Exception as error:  # such as of a MarkupSafe that does not fit to it
        raise UsageError(f'--report needs Jinja2, which cannot be started: {in_words(error)}') from error


def rendered(template: str, context: dict[str, Any]) -> bytes:
    """Return a page; the same context gives the same bytes."""
    text: str = _environment().get_template(template).render(context)
    return text.encode()


@cache
def _environment() -> Any:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    folder = resources.files(__package__) / 'templates'
    return Environment(
        loader=FunctionLoader(lambda name: (folder / name).read_text(encoding='utf-8')),
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_shown)


def _shown(value: Any) -> Any:
    """What a page says of a value, before it is escaped; markup of ours goes in as it is."""
    return visible(value) if isinstance(value, str) and not hasattr(value, '__html__') else value
