"""Echoes of any type by the names of their fields: what is read, and what is refused with the names that are there."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest

from polymap_ros.echo_parameters import A_SCAN_TYPES, EchoParameters
from polymap_ros.errors import BadPing, ParameterError
from polymap_ros.messages.echoes import ping_from_message
from polymap_ros.messages.fields import Field, check_echo_fields

JOINTS, ARRAY = 'sensor_msgs/msg/JointState', 'std_msgs/msg/Int16MultiArray'
TIME = 'builtin_interfaces/msg/Time'
FIELDS = {
    'sonar_msgs/msg/Sonar': {
        'header': Field('std_msgs/msg/Header'), 'gain': Field('float32'), 'image': Field('sonar_msgs/msg/Image'),
        'beams': Field('sonar_msgs/msg/Image', is_array=True), 'counts': Field('int16', is_array=True),
        'names': Field('string', is_array=True), 'flags': Field('bool', is_array=True), 'taken': Field(TIME)},
    'sonar_msgs/msg/Image': {'dtype': Field('uint32'), 'data': Field('uint8', is_array=True)},
    'std_msgs/msg/Header': {'stamp': Field(TIME), 'frame_id': Field('string')},
    TIME: {'sec': Field('int32'), 'nanosec': Field('uint32')},
}


def own(type_name='sonar_msgs/msg/Sonar', samples_field='counts', **rest):
    return EchoParameters(type=type_name, samples_field=samples_field, **{'sample_period_s': 1e-6, **rest})


def stamped(owner_of_samples, **fields):
    """A message of no type in particular."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=3, nanosec=7), frame_id='sonar')
    return SimpleNamespace(header=header, image=owner_of_samples, **fields)


def samples_of(message, echo):
    return ping_from_message(message, echo.type, echo, 99).samples


@pytest.mark.parametrize('given', [
    {}, {'samples_field': 'image.data'}, {'samples_field': 'image.data', 'samples_dtype': 'int16'},
    {'stamp_field': 'taken'}, {'stamp_field': '', 'allow_unstamped': True}])
def test_fields_that_are_there_are_taken(given):
    check_echo_fields(own(**given), FIELDS.__getitem__)


@pytest.mark.parametrize(('given', 'says'), [
    ({'samples_field': 'count'},
     "parameter echo.samples_field: 'count' of sonar_msgs/msg/Sonar: sonar_msgs/msg/Sonar has no field 'count', only "
     'header, gain, image, beams, counts, names, flags, taken'),
    ({'samples_field': 'image.pixels'}, "sonar_msgs/msg/Image has no field 'pixels', only dtype, data"),
    ({'samples_field': 'gain'}, "'gain' of sonar_msgs/msg/Sonar is float32; arrays of numbers there: "
                                'image.data, counts'),
    ({'samples_field': 'names'}, "'names' of sonar_msgs/msg/Sonar is string[]; arrays of numbers"),
    ({'samples_field': 'flags'}, 'is bool[]; arrays of numbers'),
    ({'samples_field': 'image'}, 'is sonar_msgs/msg/Image; arrays of numbers'),
    ({'samples_field': 'beams.data'}, "data would be a field of sonar_msgs/msg/Image[]; allowed: a field of single"),
    ({'samples_field': 'gain.x'}, 'x would be a field of float32'),
    ({'samples_dtype': 'int32'}, "parameter echo.samples_dtype: 'int32' is for arrays of bytes; counts of "
                                 'sonar_msgs/msg/Sonar is int16[]'),
    ({'stamp_field': 'stamp'}, "parameter echo.stamp_field: 'stamp' of sonar_msgs/msg/Sonar: "),
    ({'stamp_field': 'gain'}, f"'gain' of sonar_msgs/msg/Sonar is float32; allowed: {TIME}"),
])
def test_fields_that_cannot_be_are_refused_with_those_that_can(given, says):
    with pytest.raises(ParameterError) as refused:
        check_echo_fields(own(**given), FIELDS.__getitem__)
    assert says in str(refused.value)


@pytest.mark.parametrize(('given', 'name'), [
    ({'type': 'sonar_msgs/msg/Sonar', 'sample_period_s': 1e-6}, 'echo.samples_field'),
    ({'type': 'Sonar', 'samples_field': 'data', 'sample_period_s': 1e-6}, 'echo.type'),
    ({'type': 'sonar_msgs/msg/Sonar', 'samples_field': 'data'}, 'echo.sample_period_s'),
    ({'type': 'sonar_msgs/msg/Sonar', 'samples_field': 'data', 'sample_period_s': 1e-6, 'stamp_field': ''},
     'echo.allow_unstamped'),
    ({'samples_field': 'intensities'}, 'echo.samples_field'),
    ({'stamp_field': 'stamp'}, 'echo.stamp_field'),
    ({'samples_dtype': 'int16'}, 'echo.samples_dtype'),
    ({'samples_field': 'x', 'type': '../msg/x', 'sample_period_s': 1e-6}, 'echo.type'),
])
def test_parameters_that_can_never_work_are_refused_at_once(given, name):
    with pytest.raises(ParameterError) as refused:
        EchoParameters(**given)
    assert refused.value.name == name


def test_an_unknown_type_without_a_field_is_told_the_known_ones():
    with pytest.raises(ParameterError) as refused:
        EchoParameters(type='sonar_msgs/msg/Ping')
    assert all(name in str(refused.value) for name in A_SCAN_TYPES)
    with pytest.raises(ParameterError, match=r'did you mean sensor_msgs/msg/LaserScan\?'):
        EchoParameters(type='sensor_msgs/msg/LaserScn')


def test_the_four_types_need_no_check():
    check_echo_fields(EchoParameters(), {}.__getitem__)


@pytest.mark.parametrize('values', [[0.5, -1.25, 1e-300], [3.0, 4.0]])
def test_any_array_of_numbers_of_a_stamped_message(make, header, transported, values):
    message = make(JOINTS, header=header, name=[], position=np.array(values), velocity=np.ones(1),
                   effort=np.ones(1))
    echo = own(JOINTS, 'position', t0_s=2e-6)
    ping = ping_from_message(transported(message, JOINTS), JOINTS, echo, 99)
    assert (ping.stamp_ns, ping.frame_id, ping.period_s, ping.t0_s) == (12_000_000_345, 'sonar', 1e-6, 2e-6)
    assert ping.samples.dtype == np.float64
    assert ping.samples.tolist() == values


def int16_array(make, values, sizes=(), offset=0):
    dimensions = [make('std_msgs/msg/MultiArrayDimension', label='', size=size, stride=size) for size in sizes]
    return make(ARRAY, layout=make('std_msgs/msg/MultiArrayLayout', dim=dimensions, data_offset=offset),
                data=np.array(values, np.int16))


def test_counts_without_a_stamp_keep_their_sign_and_are_stamped_on_arrival(make, transported):
    echo = own(ARRAY, 'data', stamp_field='', allow_unstamped=True)
    ping = ping_from_message(transported(int16_array(make, [0, -32768, 32767], (3,)), ARRAY), ARRAY, echo, 99)
    assert (ping.stamp_ns, ping.frame_id) == (99, '')
    assert ping.samples.dtype == np.float32
    assert ping.samples.tolist() == [0.0, -32768.0, 32767.0]


@pytest.mark.parametrize(('sizes', 'offset', 'left'), [((), 0, 6), ((6,), 0, 6), ((1, 6), 0, 6), ((4,), 2, 4),
                                                      ((2, 3), 0, None), ((5,), 0, None)])
def test_a_layout_beside_the_samples_is_respected(make, sizes, offset, left):
    echo = own(ARRAY, 'data', stamp_field='', allow_unstamped=True)
    message = int16_array(make, range(6), sizes, offset)
    if left is None:
        with pytest.raises(BadPing, match='one dimension'):
            samples_of(message, echo)
    else:
        assert samples_of(message, echo).tolist() == list(range(6))[-left:]


CODES = {'uint8': 'B', 'int8': 'b', 'uint16': 'H', 'int16': 'h', 'uint32': 'I', 'int32': 'i', 'uint64': 'Q',
         'int64': 'q', 'float32': 'f', 'float64': 'd'}


@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize('said', [False, True])
@pytest.mark.parametrize(('code', 'name'), [*enumerate(CODES)])
def test_bytes_stand_for_numbers_of_every_type_and_order(code, name, said, big):
    """By the parameter, and as marine_acoustic_msgs' SonarImageData says of itself."""
    values = [1, 100, 7] if name[0] == 'u' else [1, -100, 7]
    data = np.frombuffer(struct.pack(f'{">" if big else "<"}3{CODES[name]}', *values), np.uint8)
    image = SimpleNamespace(data=data, is_bigendian=big)
    if said:
        image.dtype, image.beam_count = code, 1
    echo = own(samples_field='image.data', samples_dtype='message' if said else name)
    samples = samples_of(stamped(image), echo)
    assert samples.tolist() == values
    assert samples.dtype == (np.float64 if name.endswith(('32', '64')) and name != 'float32' else np.float32)
    assert samples.dtype.isnative


def test_plain_bytes_are_counts():
    image = SimpleNamespace(data=np.array([0, 128, 255], np.uint8))
    assert samples_of(stamped(image), own(samples_field='image.data')).tolist() == [0.0, 128.0, 255.0]
    signed = SimpleNamespace(data=np.array([-128, 0, 127], np.int8))
    assert samples_of(stamped(signed), own(samples_field='image.data')).tolist() == [-128.0, 0.0, 127.0]
    of_rclpy = SimpleNamespace(data=[b'\x00', b'\x80', b'\xff'])
    assert samples_of(stamped(of_rclpy), own(samples_field='image.data')).tolist() == [0.0, 128.0, 255.0]


def test_a_stamp_may_be_anywhere():
    taken = SimpleNamespace(sec=5, nanosec=6)
    message = stamped(None, counts=np.array([1, -2, 3], np.int16), taken=taken)
    ping = ping_from_message(message, 'sonar_msgs/msg/Sonar', own(stamp_field='taken'), 99)
    assert (ping.stamp_ns, ping.frame_id, ping.samples.tolist()) == (5_000_000_006, '', [1.0, -2.0, 3.0])


@pytest.mark.parametrize(('image', 'given', 'says'), [
    ({'beam_count': 2}, {}, '2 beams; an A-scan is one'),
    ({'data': np.zeros(5, np.uint8)}, {'samples_dtype': 'int16'}, '5 bytes of image.data are no whole number of int16'),
    ({'dtype': 3, 'beam_count': 1, 'is_bigendian': False}, {'samples_dtype': 'uint8'}, 'says int16, echo.samples_dtype '
                                                                                     'uint8'),
    ({'dtype': 10, 'beam_count': 1, 'is_bigendian': False}, {}, 'dtype 10 is not known'),
    ({'data': np.empty(0, np.uint8)}, {}, 'no samples'),
])
def test_bytes_that_are_no_one_row_of_numbers_are_refused(image, given, says):
    message = stamped(SimpleNamespace(**{'data': np.zeros(6, np.uint8), **image}))
    with pytest.raises(BadPing, match=says) as caught:
        samples_of(message, own(samples_field='image.data', **given))
    assert caught.value.reason == 'bad_shape'


def test_a_field_that_is_missing_after_all_is_the_wrong_type():
    with pytest.raises(BadPing, match="no field 'counts'") as caught:
        samples_of(stamped(None), own())
    assert caught.value.reason == 'wrong_type'
