"""Samples and stamp of a message type of one's own: the fields that parameters name, checked and read.

What a type holds is asked for through a function ``fields_of(type_name)``, which rclpy's classes and a
recording's definitions both can answer; see `Field`.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from polymap_ros.echo_parameters import SAMPLE_DTYPES, EchoParameters
from polymap_ros.errors import BadPing, ParameterError


class Field(NamedTuple):
    """What one field holds: numpy's name of a number, a message type, or ``string``; one, or an array of them."""

    element: str
    is_array: bool = False

    def __str__(self) -> str:
        return f'{self.element}[]' if self.is_array else self.element


FieldsOf: TypeAlias = Callable[[str], Mapping[str, Field]]

TIME = 'builtin_interfaces/msg/Time'
BYTES = ('uint8', 'int8')


def check_echo_fields(echo: EchoParameters, fields_of: FieldsOf) -> None:
    """Raise `ParameterError` where the fields that `echo` names are not in its type, or cannot be what they should.

    Nothing is checked for the four A-scan types, which name their fields themselves.
    """
    if not echo.samples_field:
        return
    found = _find(echo.type, echo.samples_field, 'echo.samples_field', fields_of)
    if not (found.is_array and found.element in SAMPLE_DTYPES):
        arrays = ', '.join(_arrays_of_numbers(echo.type, fields_of)) or 'none'
        raise ParameterError('echo.samples_field', f'{echo.samples_field!r} of {echo.type} is {found}; arrays of '
                                                   f'numbers there: {arrays}')
    if echo.samples_dtype != 'message' and found.element not in BYTES:
        raise ParameterError('echo.samples_dtype', f'{echo.samples_dtype!r} is for arrays of bytes; '
                                                   f'{echo.samples_field} of {echo.type} is {found}; allowed: message')
    if echo.stamp_field:
        stamp = _find(echo.type, echo.stamp_field, 'echo.stamp_field', fields_of)
        if stamp != Field(TIME):
            raise ParameterError('echo.stamp_field', f'{echo.stamp_field!r} of {echo.type} is {stamp}; allowed: {TIME}')


def _find(type_name: str, path: str, parameter: str, fields_of: FieldsOf) -> Field:
    found = Field(type_name)
    for name in path.split('.'):
        if found.is_array or '/' not in found.element:
            raise ParameterError(parameter, f'{path!r} of {type_name}: {name} would be a field of {found}; allowed: a '
                                            'field of single messages')
        fields = fields_of(found.element)
        if name not in fields:
            raise ParameterError(parameter, f'{path!r} of {type_name}: {found} has no field {name!r}, only '
                                            f'{", ".join(fields)}')
        found = fields[name]
    return found


def _arrays_of_numbers(type_name: str, fields_of: FieldsOf, prefix: str = '') -> Iterator[str]:
    for name, field in fields_of(type_name).items():
        if field.is_array and field.element in SAMPLE_DTYPES:
            yield f'{prefix}{name}'
        elif '/' in field.element and not field.is_array:
            yield from _arrays_of_numbers(field.element, fields_of, f'{prefix}{name}.')


def field_of(message: Any, path: str) -> tuple[Any, Any]:
    """The value at a dotted path, and the message it is a field of.

    Raises
    ------
    BadPing
        ``wrong_type`` where there is none.
    """
    owner = value = message
    for name in path.split('.'):
        owner = value
        try:
            value = getattr(owner, name)
        except AttributeError as error:
            raise BadPing('wrong_type', f'{path}: {type(owner).__name__} has no field {name!r}') from error
    return owner, value


def numbers_of(message: Any, echo: EchoParameters) -> NDArray[Any]:
    """The samples that ``echo.samples_field`` names, (n,), in their own type.

    Fields beside them have a say where they have one by the names that others use: ``layout`` (std_msgs'
    MultiArrays), ``beam_count``, ``dtype`` and ``is_bigendian`` (marine_acoustic_msgs' SonarImageData).

    Raises
    ------
    BadPing
        ``bad_shape`` for more than one beam or dimension, and for bytes that are no whole numbers.
    """
    owner, values = field_of(message, echo.samples_field)
    beams = int(getattr(owner, 'beam_count', 1))
    if beams > 1:
        raise BadPing('bad_shape', f'{echo.samples_field} holds {beams} beams; an A-scan is one')
    numbers = _from_bytes(np.asarray(values), owner, echo)
    layout = getattr(owner, 'layout', None)
    return numbers if layout is None else laid_out(numbers, layout)


def laid_out(numbers: NDArray[Any], layout: Any) -> NDArray[Any]:
    """What a std_msgs/msg/MultiArrayLayout leaves of the data of an A-scan, which has one dimension."""
    numbers = numbers[layout.data_offset:]
    sizes = [int(dimension.size) for dimension in layout.dim]
    if sizes and (np.prod(sizes, dtype=float) != numbers.size or max(sizes) != numbers.size):
        raise BadPing('bad_shape', f'dimensions {sizes} for {numbers.size} values; an A-scan has one dimension')
    return numbers


def _from_bytes(numbers: NDArray[Any], owner: Any, echo: EchoParameters) -> NDArray[Any]:
    """Bytes as the numbers they stand for: by the parameter, by a ``dtype`` beside them, or counts of 8 bits."""
    if numbers.dtype.itemsize != 1:
        return numbers
    said = _said_dtype(owner)
    name = echo.samples_dtype if echo.samples_dtype != 'message' else said or _own_name(numbers)
    if said is not None and name != said:
        raise BadPing('bad_shape', f'the dtype beside {echo.samples_field} says {said}, echo.samples_dtype {name}')
    dtype = np.dtype(name).newbyteorder('>' if getattr(owner, 'is_bigendian', False) else '<')
    if numbers.size % dtype.itemsize:
        raise BadPing('bad_shape', f'{numbers.size} bytes of {echo.samples_field} are no whole number of {name}')
    return np.frombuffer(numbers.tobytes(), dtype)


def _own_name(numbers: NDArray[Any]) -> str:
    return 'int8' if numbers.dtype == np.int8 else 'uint8'  # rclpy gives byte[] as bytes objects


def _said_dtype(owner: Any) -> str | None:
    """What a SonarImageData says of its bytes; None for any other message."""
    if not (hasattr(owner, 'dtype') and hasattr(owner, 'beam_count') and hasattr(owner, 'is_bigendian')):
        return None
    code = int(owner.dtype)
    if not 0 <= code < len(SAMPLE_DTYPES):
        raise BadPing('bad_shape', f'dtype {code} is not known; allowed: 0 to {len(SAMPLE_DTYPES) - 1}')
    return SAMPLE_DTYPES[code]
