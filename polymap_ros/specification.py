"""What a parameter is: its name, default, unit, bounds and one line of text, and groups that check their values."""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

from polymap_ros.errors import ParameterError
from polymap_ros.paths import expanded

Value: TypeAlias = bool | int | float | str

_HUGE = 10**308
"""Whole numbers beyond this are no doubles."""


def parameter(
    default: Value,
    text: str,
    *,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    above: float | None = None,
    choices: tuple[str, ...] = (),
    live: bool = False,
    is_path: bool = False,
) -> Any:
    """Describe one parameter.

    `above` is an open lower bound, `live` allows a change while the node runs, and of a path ``~`` is expanded.
    """
    return field(
        default=default,
        metadata={
            'default': default, 'text': text, 'unit': unit, 'minimum': minimum, 'maximum': maximum, 'above': above,
            'choices': choices, 'live': live, 'is_path': is_path,
        },
    )


@dataclass(frozen=True)
class Specification:
    """What is known of one parameter, for descriptors and tables."""

    name: str
    type: type
    default: Value
    text: str
    unit: str
    minimum: float | None
    maximum: float | None
    above: float | None
    choices: tuple[str, ...]
    live: bool
    is_path: bool

    def check(self, value: object) -> Value:
        """Return `value` in the parameter's type, or raise `ParameterError` with what is allowed."""
        if getattr(value, 'ndim', None) == 0 and (item := getattr(value, 'item', None)):
            value = item()  # a scalar of numpy's, which need not be imported for this
        if value is False and 'off' in self.choices:
            value = 'off'  # YAML's word for false, which ROS reads so
        if self.type is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(max(min(value, _HUGE), -_HUGE))
        if not isinstance(value, (bool, int, float, str)) or type(value) is not self.type:
            raise ParameterError(
                self.name, f'{value!r} is of type {type(value).__name__}; allowed: {self.allowed()}'
            )
        if self.choices and value not in self.choices:
            raise ParameterError(self.name, f'{value!r} is not known; allowed: {self.allowed()}')
        if isinstance(value, str) and not value.isprintable():
            raise ParameterError(self.name, f'{value!r} holds characters that cannot be printed')
        if isinstance(value, (int, float)) and not isinstance(value, bool) and not self._within(value):
            raise ParameterError(self.name, f'{value!r} is out of range; allowed: {self.allowed()}')
        return self._expanded(value) if isinstance(value, str) and self.is_path else value

    def _expanded(self, path: str) -> str:
        try:
            return expanded(path)
        except ValueError as error:
            raise ParameterError(self.name, str(error)) from error

    def _within(self, value: float) -> bool:
        return (
            (isinstance(value, int) or math.isfinite(value))
            and (self.minimum is None or value >= self.minimum)
            and (self.above is None or value > self.above)
            and (self.maximum is None or value <= self.maximum)
        )

    def allowed(self) -> str:
        """Say in words what the parameter takes, such as ``double in (0, 100] m``."""
        if self.choices:
            return ' | '.join(self.choices)
        kind = {float: 'double', int: 'integer', bool: 'bool', str: 'string'}[self.type]
        low, high = self.above if self.above is not None else self.minimum, self.maximum
        if low is None and high is None:
            return f'{kind} {self.unit}'.strip()
        left = '(-inf' if low is None else f'{"(" if self.above is not None else "["}{low:g}'
        right = 'inf)' if high is None else f'{high:g}]'
        return f'{kind} in {left}, {right} {self.unit}'.strip()


def specifications_of(group: type['Group'], prefix: str) -> Iterator[Specification]:
    for entry in dataclasses.fields(group):
        if 'text' in entry.metadata:
            kind = type(entry.metadata['default'])
            yield Specification(name=prefix + entry.name, type=kind, **entry.metadata)


@dataclass(frozen=True)
class Group:
    """Base of the parameter groups: checks every value against its specification when constructed."""

    PREFIX: ClassVar[str] = ''

    def __post_init__(self) -> None:
        for spec in specifications_of(type(self), self.PREFIX):
            name = spec.name.removeprefix(self.PREFIX)
            object.__setattr__(self, name, spec.check(getattr(self, name)))
        self.check()

    def check(self) -> None:
        """Check what involves several values of the group; raises `ParameterError`."""
