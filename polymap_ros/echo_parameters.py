"""The parameters of the echo messages."""

import re
from dataclasses import dataclass
from difflib import get_close_matches

from polymap_ros.errors import ParameterError
from polymap_ros.specification import Group, parameter, specifications_of

A_SCAN_TYPES = (
    'sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/PointCloud2', 'sensor_msgs/msg/Image',
    'std_msgs/msg/Float32MultiArray')
"""The message types whose fields have a fixed sense as an A-scan."""

_WITH_PERIOD = A_SCAN_TYPES[:2]

SAMPLE_DTYPES = ('uint8', 'int8', 'uint16', 'int16', 'uint32', 'int32', 'uint64', 'int64', 'float32', 'float64')
"""Numbers that an array of bytes may stand for, as marine_acoustic_msgs/msg/SonarImageData counts them."""


@dataclass(frozen=True)
class EchoParameters(Group):
    """The echo messages."""

    PREFIX = 'echo.'
    type: str = parameter('sensor_msgs/msg/LaserScan', f'message type of the echo topic: {", ".join(A_SCAN_TYPES)}, '
                          'or any other, whose samples_field then is to be named')
    samples_field: str = parameter('', 'array of the samples in a type of your own, dotted, such as image.data')
    samples_dtype: str = parameter('message', 'numbers that an array of bytes there stands for; message: as a '
                                   'SonarImageData says itself, else 8 bits each', choices=('message', *SAMPLE_DTYPES))
    stamp_field: str = parameter('header.stamp', "stamp in a type of your own, dotted; '' for none, which needs "
                                 'allow_unstamped')
    kind: str = parameter('rf', 'samples are the signed signal (rf) or its magnitude (envelope)',
                          choices=('rf', 'envelope'))
    t0_s: float = parameter(0.0, 'time of the first sample after emission', unit='s', minimum=-100.0, maximum=100.0)
    sample_period_s: float = parameter(0.0, 'sample period; 0: from the message', unit='s', minimum=0.0, maximum=1.0)
    blanking_m: float = parameter(0.02, 'no echo is looked for nearer than this', unit='m', minimum=0.0, maximum=1e4)
    allow_unstamped: bool = parameter(False, 'take messages without a stamp (Float32MultiArray), stamped on arrival')

    def check(self) -> None:
        object.__setattr__(self, 'type', re.sub(r'^(\w+)/(\w+)$', r'\1/msg/\2', self.type))  # as ROS 1 writes it
        if self.type in A_SCAN_TYPES:
            self._check_fields_are_not_given()
        else:
            self._check_fields_are_given()
        if self.type not in _WITH_PERIOD and self.sample_period_s <= 0.0:
            raise ParameterError('echo.sample_period_s', f'{self.type} has no sample period; allowed: above 0')
        unstamped = self.type.endswith('/Float32MultiArray') or not self.stamp_field
        if unstamped and not self.allow_unstamped:
            raise ParameterError('echo.allow_unstamped', f'{self.type} has no stamp; true takes it, stamped on arrival')

    def _check_fields_are_given(self) -> None:
        if not re.fullmatch(r'\w+/msg/\w+', self.type):
            raise ParameterError('echo.type', f'{self.type!r} is no message type; allowed: package/msg/Name')
        if not self.samples_field and (close := get_close_matches(self.type, A_SCAN_TYPES, 1, 0.8)):
            raise ParameterError('echo.type', f'{self.type!r} has no fields that are known; did you mean {close[0]}?')
        if not self.samples_field:
            raise ParameterError('echo.samples_field', f"'' names no field; {self.type} is none of "
                                 f'{", ".join(A_SCAN_TYPES)}, so the array that holds its samples is to be named')

    def _check_fields_are_not_given(self) -> None:
        for spec in specifications_of(type(self), self.PREFIX):
            value = getattr(self, spec.name.removeprefix(self.PREFIX))
            if spec.name.endswith(('_field', '_dtype')) and value != spec.default:
                raise ParameterError(spec.name, f'{value!r} is for a type of your own, echo.type is {self.type}; '
                                     f'allowed: {spec.default!r}')
