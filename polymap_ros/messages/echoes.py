"""From an echo message to a `Ping`: one set of adapters for rclpy's messages and rosbags' dataclasses.

The four types and the A-scan convention of LaserScan are the contract of the ``echo`` topic; of any other type the
parameters name the fields. Only the shape and the types of a message are judged here; whether the samples make
sense is for the mapper to say.
"""

from collections.abc import Callable
from math import isfinite, isinf, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polymap_ros.acoustics.ping import Ping
from polymap_ros.acoustics.units import likely_unit
from polymap_ros.echo_parameters import EchoParameters
from polymap_ros.errors import BadPing
from polymap_ros.messages.fields import field_of, laid_out, numbers_of

POINT_FIELD_TYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
"""numpy's names of the datatypes of sensor_msgs/msg/PointField."""

IMAGE_ENCODINGS = {'32FC1': 'f4', '16SC1': 'i2'}

UNIFORMITY = 0.01
"""Steps of a PointCloud2's ``t`` may differ from their mean by this share of it."""

PERIOD_TOLERANCE = 1e-5
"""Relative difference from which `echo.sample_period_s` contradicts a message (its float32 gives 6e-8)."""


def ping_from_message(message: Any, type_name: str, echo: EchoParameters, arrival_ns: int) -> Ping:
    """Read one echo message.

    Parameters
    ----------
    message : object
        The message, with the fields of `type_name`.
    type_name : str
        Its type, such as ``sensor_msgs/msg/LaserScan``.
    echo : EchoParameters
        What the user said about the echoes.
    arrival_ns : int
        Time of arrival [ns], the stamp of messages that carry none.

    Returns
    -------
    Ping
        With samples as float32, or float64 where the message holds that or 32-bit counts.

    Raises
    ------
    BadPing
        ``wrong_type`` for what is no A-scan at all, ``bad_shape`` for one with contradictory fields.
    """
    if type_name != echo.type:
        raise BadPing('wrong_type', f'echo is of type {type_name}; echo.type says {echo.type}')
    return _READERS.get(type_name, _from_fields)(message, echo, arrival_ns)


def stamp_to_ns(stamp: Any) -> int:
    """Nanoseconds of a builtin_interfaces/msg/Time."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _from_laser_scan(message: Any, echo: EchoParameters, arrival_ns: int) -> Ping:
    if len(message.ranges):
        raise BadPing('wrong_type', f'echo has {len(message.ranges)} ranges: that is a lidar scan; an A-scan has '
                                    'its samples in intensities and leaves ranges empty')
    limits = _limit(message.range_min), _limit(message.range_max)
    if not all(limit >= 0.0 for limit in limits) or isinf(limits[0]) or 0.0 < limits[1] <= limits[0]:
        raise BadPing('bad_shape', f'range_min {limits[0]:g} m and range_max {limits[1]:g} m; allowed: '
                                   '0 <= range_min < range_max, 0 or nan where unset, range_max inf for no limit')
    return Ping(
        stamp_ns=stamp_to_ns(message.header.stamp),
        samples=_samples(np.asarray(message.intensities, dtype=np.float32)),
        period_s=_period(float(message.time_increment), 'time_increment', echo,
                         len(message.intensities)),
        t0_s=echo.t0_s, range_min_m=limits[0],
        range_max_m=limits[1] if isfinite(limits[1]) else 0.0, frame_id=message.header.frame_id,
    )


def _limit(value: Any) -> float:
    """A limit of range [m]; 0 for unset, which drivers write as nan, too."""
    return 0.0 if isnan(value) else float(value)


def _from_point_cloud(message: Any, echo: EchoParameters, arrival_ns: int) -> Ping:
    amplitude = _column(message, 'amplitude')
    if amplitude is None:
        names = ', '.join(field.name for field in message.fields) or 'none'
        raise BadPing('wrong_type', f'the cloud has no field amplitude, only {names}; an A-scan has one')
    times = _column(message, 't')
    if times is None:
        period_s, t0_s = _given_period(echo, 'a PointCloud2 without field t'), echo.t0_s
    else:
        period_s, t0_s = _uniform(times.astype(np.float64), echo)
    return Ping(stamp_ns=stamp_to_ns(message.header.stamp), samples=_samples(amplitude), period_s=period_s,
                t0_s=t0_s, frame_id=message.header.frame_id)


def _column(message: Any, name: str) -> NDArray[Any] | None:
    """One field of a cloud of height 1, (width,); None where the cloud does not have it."""
    field = next((field for field in message.fields if field.name == name), None)
    if field is None:
        return None
    code = POINT_FIELD_TYPES.get(int(field.datatype))
    if code is None or field.count > 1:
        raise BadPing('bad_shape', f'field {name} has datatype {field.datatype} and count {field.count}; '
                                   'allowed: a PointField datatype, 1 to 8, once')
    dtype = np.dtype(code).newbyteorder('>' if message.is_bigendian else '<')
    data, width, step = _bytes(message.data), int(message.width), int(message.point_step)
    if message.height != 1:
        raise BadPing('bad_shape', f'the cloud has height {message.height}; an A-scan has 1 and width = samples')
    sizes = width * step <= message.row_step <= data.size
    if field.offset + dtype.itemsize > min(step, data.size) or not sizes:
        raise BadPing('bad_shape', f'field {name} at offset {field.offset} with point_step {step}, row_step '
                                   f'{message.row_step} and width {width} does not fit {data.size} bytes')
    return np.ndarray((width,), dtype, data, int(field.offset), (step,))


def _uniform(times_s: NDArray[np.float64], echo: EchoParameters) -> tuple[float, float]:
    """Period and time of the first sample from the times of all, which must be uniform."""
    steps = np.diff(times_s)
    mean = float((times_s[-1] - times_s[0]) / steps.size) if steps.size else np.nan
    if not (np.isfinite(times_s).all() and mean > 0.0 and np.all(abs(steps - mean) <= UNIFORMITY * mean)):
        raise BadPing('bad_shape', f'field t is not uniform within {UNIFORMITY:.0%}: mean step {mean:g} s')
    return _period(mean, 't', echo), float(times_s[0])


def _from_image(message: Any, echo: EchoParameters, arrival_ns: int) -> Ping:
    code = IMAGE_ENCODINGS.get(message.encoding)
    if code is None:
        raise BadPing('wrong_type', f'the image is {message.encoding!r}; an A-scan is '
                                    f'{" or ".join(IMAGE_ENCODINGS)}')
    dtype = np.dtype(code).newbyteorder('>' if message.is_bigendian else '<')
    data, width = _bytes(message.data), int(message.width)
    if message.height != 1:
        raise BadPing('bad_shape', f'the image has height {message.height}; an A-scan has 1 and width = samples')
    if width * dtype.itemsize > message.step or message.step > data.size:
        raise BadPing('bad_shape', f'width {width} of {message.encoding} and step {message.step} do not fit '
                                   f'{data.size} bytes')
    return Ping(stamp_ns=stamp_to_ns(message.header.stamp), samples=_samples(np.ndarray((width,), dtype, data)),
                period_s=_given_period(echo, 'an Image'), t0_s=echo.t0_s, frame_id=message.header.frame_id)


def _from_float_array(message: Any, echo: EchoParameters, arrival_ns: int) -> Ping:
    samples = laid_out(np.asarray(message.data, dtype=np.float32), message.layout)
    return Ping(stamp_ns=arrival_ns, samples=_samples(samples), period_s=_given_period(echo, 'a Float32MultiArray'),
                t0_s=echo.t0_s)


def _from_fields(message: Any, echo: EchoParameters, arrival_ns: int) -> Ping:
    """A type of one's own, whose fields `echo` names."""
    stamp_ns, frame_id = arrival_ns, ''
    if echo.stamp_field:
        owner, stamp = field_of(message, echo.stamp_field)
        stamp_ns, frame_id = stamp_to_ns(stamp), getattr(owner, 'frame_id', '')
    return Ping(stamp_ns=stamp_ns, samples=_samples(numbers_of(message, echo)), t0_s=echo.t0_s, frame_id=frame_id,
                period_s=_given_period(echo, type(message).__name__))


_READERS: dict[str, Callable[[Any, EchoParameters, int], Ping]] = {
    'sensor_msgs/msg/LaserScan': _from_laser_scan,
    'sensor_msgs/msg/PointCloud2': _from_point_cloud,
    'sensor_msgs/msg/Image': _from_image,
    'std_msgs/msg/Float32MultiArray': _from_float_array,
}


def _bytes(data: Any) -> NDArray[np.uint8]:
    return np.frombuffer(data, np.uint8) if len(data) else np.empty(0, np.uint8)


def _samples(values: NDArray[Any]) -> NDArray[np.floating]:
    if values.size == 0:
        raise BadPing('bad_shape', 'the message has no samples')
    wide = values.dtype.itemsize == 8 or (values.dtype.kind in 'iu' and values.dtype.itemsize == 4)
    return np.require(values, np.float64 if wide else np.float32, ['C', 'A'])


def _period(found_s: float, where: str, echo: EchoParameters, count: int = 0) -> float:
    """The message's period, which must not contradict the parameter; the parameter's digits are the better ones."""
    if not (isfinite(found_s) and found_s > 0.0):
        raise BadPing('bad_shape', f'{where} gives a sample period of {found_s:g} s; allowed: above 0')
    given_s = echo.sample_period_s
    if given_s and abs(found_s - given_s) > PERIOD_TOLERANCE * given_s:
        raise BadPing('bad_shape', f'{where} gives a sample period of {found_s:g} s, '
                                   f'echo.sample_period_s {given_s:g} s{likely_unit(found_s, given_s, count)}')
    return given_s or found_s


def _given_period(echo: EchoParameters, what: str) -> float:
    if echo.sample_period_s <= 0.0:
        raise BadPing('bad_shape', f'{what} has no sample period: set echo.sample_period_s')
    return echo.sample_period_s
