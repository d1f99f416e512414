"""Every echo type, from rclpy and from rosbags, byte orders, strides and what is refused."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest

from polymap_ros.echo_parameters import EchoParameters
from polymap_ros.errors import BadPing, ParameterError
from polymap_ros.messages.echoes import ping_from_message

SCAN, CLOUD = 'sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/PointCloud2'
IMAGE, ARRAY = 'sensor_msgs/msg/Image', 'std_msgs/msg/Float32MultiArray'
SAMPLES = [0.5, -1.25, 3.0, 0.0, -2.0]
STRUCT_CODES = {1: 'b', 2: 'B', 3: 'h', 4: 'H', 5: 'i', 6: 'I', 7: 'f', 8: 'd'}


def scan(make, header, **changes):
    fields = {
        'header': header, 'angle_min': 0.0, 'angle_max': 0.0, 'angle_increment': 0.0, 'time_increment': 1e-6,
        'scan_time': 0.0, 'range_min': 0.05, 'range_max': 2.0, 'ranges': np.empty(0, np.float32),
        'intensities': np.array(SAMPLES, np.float32),
    }
    return make(SCAN, **(fields | changes))


def cloud(make, header, columns, padding=0, big=False, **changes):
    """A cloud packed by struct: columns is a list of (name, PointField datatype, values)."""
    order = '>' if big else '<'
    fields, offset = [], padding
    for name, datatype, _ in columns:
        fields.append(make('sensor_msgs/msg/PointField', name=name, offset=offset, datatype=datatype, count=1))
        offset += struct.calcsize(order + STRUCT_CODES[datatype])
    rows = zip(*(values for _, _, values in columns), strict=True)
    codes = ''.join(STRUCT_CODES[datatype] for _, datatype, _ in columns)
    data = b''.join(bytes(padding) + struct.pack(order + codes, *row) for row in rows)
    width = len(columns[0][2])
    values = {
        'header': header, 'height': 1, 'width': width, 'fields': fields, 'is_bigendian': big, 'point_step': offset,
        'row_step': offset * width, 'data': np.frombuffer(data, np.uint8), 'is_dense': True,
    }
    return make(CLOUD, **(values | changes))


def image(make, header, pixels, data, big=False, **changes):
    size = {'32FC1': 4, '16SC1': 2}[pixels]
    values = {
        'header': header, 'height': 1, 'width': len(data) // size, 'encoding': pixels, 'is_bigendian': int(big),
        'step': len(data), 'data': np.frombuffer(data, np.uint8),
    }
    return make(IMAGE, **(values | changes))


def float_array(make, values, sizes=(), offset=0):
    dimensions = [make('std_msgs/msg/MultiArrayDimension', label='', size=size, stride=size) for size in sizes]
    layout = make('std_msgs/msg/MultiArrayLayout', dim=dimensions, data_offset=offset)
    return make(ARRAY, layout=layout, data=np.array(values, np.float32))


def refusal(message, type_name, echo):
    with pytest.raises(BadPing) as caught:
        ping_from_message(message, type_name, echo, 0)
    return caught.value


def test_laser_scan_uses_each_field_in_its_sense(make, header):
    ping = ping_from_message(scan(make, header), SCAN, EchoParameters(t0_s=2e-6), 99)
    assert ping.stamp_ns == 12_000_000_345
    assert ping.emission_ns == 12_000_000_345 - 2000
    assert ping.samples.dtype == np.float32
    assert ping.samples.tolist() == SAMPLES
    assert ping.period_s == pytest.approx(1e-6, rel=1e-7)
    assert (ping.range_min_m, ping.range_max_m, ping.frame_id) == (pytest.approx(0.05), 2.0, 'sonar')


def test_laser_scan_survives_the_wire(make, header, transported):
    ping = ping_from_message(transported(scan(make, header), SCAN), SCAN, EchoParameters(), 0)
    assert ping.samples.tolist() == SAMPLES
    assert ping.stamp_ns == 12_000_000_345


def test_sample_period_of_laser_scan_must_agree_with_the_parameter(make, header):
    echo = EchoParameters(sample_period_s=1e-6)
    assert ping_from_message(scan(make, header), SCAN, echo, 0).period_s == 1e-6
    error = refusal(scan(make, header, time_increment=1.001e-6), SCAN, echo)
    assert error.reason == 'bad_shape'
    assert 'echo.sample_period_s' in str(error)


@pytest.mark.parametrize('period', [0.0, -1e-6, float('nan'), float('inf')])
def test_laser_scan_without_a_period_is_refused(make, header, period):
    assert refusal(scan(make, header, time_increment=period), SCAN, EchoParameters()).reason == 'bad_shape'


def test_lidar_scan_is_refused_in_words(make, header):
    lidar = scan(make, header, ranges=np.ones(3, np.float32), intensities=np.empty(0, np.float32))
    error = refusal(lidar, SCAN, EchoParameters())
    assert error.reason == 'wrong_type'
    assert 'lidar' in str(error)


@pytest.mark.parametrize('changes', [
    {'range_min': float('inf')}, {'range_min': -0.1}, {'range_max': float('-inf')},
    {'range_min': 2.0, 'range_max': 1.0}, {'intensities': np.empty(0, np.float32)},
])
def test_contradictory_laser_scan_is_refused(make, header, changes):
    assert refusal(scan(make, header, **changes), SCAN, EchoParameters()).reason == 'bad_shape'


@pytest.mark.parametrize(('limits', 'taken'), [
    ((0.05, float('inf')), (0.05, 0.0)), ((float('nan'), float('nan')), (0.0, 0.0)), ((0.0, 0.0), (0.0, 0.0)),
    ((0.0, 3e38), (0.0, 3e38))])
def test_a_last_range_without_end_and_limits_that_are_not_known_are_no_limits(make, header, limits, taken):
    ping = ping_from_message(scan(make, header, range_min=limits[0], range_max=limits[1]), SCAN, EchoParameters(), 0)
    assert (ping.range_min_m, ping.range_max_m) == pytest.approx(taken)


def test_a_type_may_be_written_without_msg(make, header):
    assert EchoParameters(type='sensor_msgs/LaserScan') == EchoParameters()


def test_a_period_in_another_unit_than_the_parameter_says_is_named(make, header):
    error = refusal(scan(make, header, time_increment=1.0), SCAN, EchoParameters(sample_period_s=1e-6))
    assert str(error).endswith(': 1 looks like microseconds or a sample rate in MHz, the period is in seconds (1e-06)')


def test_type_other_than_the_parameter_is_refused(make, header):
    assert refusal(scan(make, header), SCAN, EchoParameters(type=CLOUD)).reason == 'wrong_type'


@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize('datatype', range(1, 9))
def test_cloud_of_every_datatype_and_byte_order(make, header, transported, datatype, big):
    values = [0.5, -1.25, 3.0] if datatype > 6 else [1, 100, 7] if datatype in (2, 4, 6) else [1, -100, 7]
    message = cloud(make, header, [('x', 7, [9.0] * 3), ('amplitude', datatype, values)], padding=3, big=big)
    echo = EchoParameters(type=CLOUD, sample_period_s=2e-6, t0_s=1e-5)
    ping = ping_from_message(transported(message, CLOUD), CLOUD, echo, 0)
    assert ping.samples.tolist() == values
    assert ping.samples.dtype == (np.float64 if datatype in (5, 6, 8) else np.float32)
    assert ping.samples.dtype.isnative
    assert ping.samples.flags.c_contiguous
    assert ping.samples.flags.aligned
    assert (ping.period_s, ping.t0_s, ping.stamp_ns, ping.frame_id) == (2e-6, 1e-5, 12_000_000_345, 'sonar')


@pytest.mark.parametrize('datatype', [7, 8])
def test_times_of_a_cloud_give_period_and_t0(make, header, datatype):
    times = [5e-5 + k * 1e-6 for k in range(50)]
    message = cloud(make, header, [('t', datatype, times), ('amplitude', 7, [1.0] * 50)])
    ping = ping_from_message(message, CLOUD, EchoParameters(type=CLOUD, t0_s=7.0), 0)
    assert ping.period_s == pytest.approx(1e-6, rel=1e-6)
    assert ping.t0_s == pytest.approx(5e-5, rel=1e-6)
    assert ping.emission_ns == 12_000_000_345 - 50_000


@pytest.mark.parametrize(('jitter', 'accepted'), [(0.004, True), (0.02, False)])
def test_times_of_a_cloud_are_uniform_within_one_percent(make, header, jitter, accepted):
    times = np.arange(20) * 1e-6
    times[7] += jitter * 1e-6
    message = cloud(make, header, [('t', 8, times), ('amplitude', 7, [1.0] * 20)])
    echo = EchoParameters(type=CLOUD)
    if accepted:
        assert ping_from_message(message, CLOUD, echo, 0).period_s == pytest.approx(1e-6)
    else:
        assert refusal(message, CLOUD, echo).reason == 'bad_shape'


@pytest.mark.parametrize('times', [[0.0], [0.0, 0.0], [1e-6, 0.0], [0.0, float('nan'), 2e-6]])
def test_times_that_are_no_axis_are_refused(make, header, times):
    message = cloud(make, header, [('t', 8, times), ('amplitude', 7, [1.0] * len(times))])
    assert refusal(message, CLOUD, EchoParameters(type=CLOUD)).reason == 'bad_shape'


def test_times_of_a_cloud_must_agree_with_the_parameter(make, header):
    message = cloud(make, header, [('t', 8, np.arange(9) * 1e-6), ('amplitude', 7, [1.0] * 9)])
    error = refusal(message, CLOUD, EchoParameters(type=CLOUD, sample_period_s=2e-6))
    assert 'echo.sample_period_s' in str(error)


def test_cloud_without_times_needs_the_parameter(make, header):
    error = refusal(cloud(make, header, [('amplitude', 7, SAMPLES)]), CLOUD, EchoParameters(type=CLOUD))
    assert error.reason == 'bad_shape'
    assert 'echo.sample_period_s' in str(error)


def test_lidar_cloud_is_refused_with_its_fields(make, header):
    message = cloud(make, header, [('x', 7, SAMPLES), ('intensity', 7, SAMPLES)])
    error = refusal(message, CLOUD, EchoParameters(type=CLOUD))
    assert error.reason == 'wrong_type'
    assert 'x, intensity' in str(error)


@pytest.mark.parametrize('changes', [
    {'height': 2}, {'point_step': 3}, {'row_step': 19}, {'width': 6}, {'data': np.zeros(19, np.uint8)},
    {'width': 0}, {'row_step': 2**31}, {'width': 0, 'row_step': 0, 'data': np.zeros(3, np.uint8)},
])
def test_cloud_whose_sizes_do_not_fit_is_refused(make, header, changes):
    echo = EchoParameters(type=CLOUD, sample_period_s=1e-6)
    message = cloud(make, header, [('amplitude', 7, SAMPLES)], **changes)
    assert refusal(message, CLOUD, echo).reason == 'bad_shape'


@pytest.mark.parametrize(('datatype', 'count'), [(0, 1), (9, 1), (7, 2)])
def test_cloud_field_that_is_no_number_is_refused(make, header, datatype, count):
    fields = [make('sensor_msgs/msg/PointField', name='amplitude', offset=0, datatype=datatype, count=count)]
    message = cloud(make, header, [('amplitude', 7, SAMPLES)], fields=fields)
    assert refusal(message, CLOUD, EchoParameters(type=CLOUD, sample_period_s=1e-6)).reason == 'bad_shape'


@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize(('encoding', 'code', 'values'), [('32FC1', 'f', SAMPLES), ('16SC1', 'h', [3, -300, 32767])])
def test_image_of_both_encodings_and_byte_orders(make, header, transported, encoding, code, values, big):
    data = struct.pack(f'{">" if big else "<"}{len(values)}{code}', *values)
    message = transported(image(make, header, encoding, data, big), IMAGE)
    ping = ping_from_message(message, IMAGE, EchoParameters(type=IMAGE, sample_period_s=1e-6), 0)
    assert ping.samples.tolist() == values
    assert ping.samples.dtype == np.float32
    assert (ping.period_s, ping.stamp_ns) == (1e-6, 12_000_000_345)


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'encoding': 'bgr8'}, 'wrong_type'), ({'height': 2}, 'bad_shape'), ({'width': 3}, 'bad_shape'),
    ({'step': 7}, 'bad_shape'), ({'step': 9}, 'bad_shape'), ({'width': 0}, 'bad_shape'),
])
def test_image_that_is_no_row_of_numbers_is_refused(make, header, changes, reason):
    message = image(make, header, '32FC1', struct.pack('<2f', 1.0, 2.0), **changes)
    assert refusal(message, IMAGE, EchoParameters(type=IMAGE, sample_period_s=1e-6)).reason == reason


UNSTAMPED = EchoParameters(type=ARRAY, sample_period_s=1e-6, allow_unstamped=True)


def test_float_array_is_stamped_on_arrival(make, transported):
    ping = ping_from_message(transported(float_array(make, SAMPLES), ARRAY), ARRAY, UNSTAMPED, 77)
    assert (ping.stamp_ns, ping.period_s) == (77, 1e-6)
    assert ping.samples.tolist() == SAMPLES


@pytest.mark.parametrize(('sizes', 'offset'), [((5,), 0), ((1, 5), 0), ((4,), 1), ((), 1)])
def test_float_array_layout_is_respected(make, sizes, offset):
    ping = ping_from_message(float_array(make, SAMPLES, sizes, offset), ARRAY, UNSTAMPED, 0)
    assert ping.samples.tolist() == SAMPLES[offset:]


@pytest.mark.parametrize(('sizes', 'offset'), [((4,), 0), ((2, 3), 0), ((5, 5), 0), ((), 5), ((0,), 0)])
def test_float_array_of_another_shape_is_refused(make, sizes, offset):
    assert refusal(float_array(make, SAMPLES, sizes, offset), ARRAY, UNSTAMPED).reason == 'bad_shape'


def test_two_dimensional_float_array_is_refused(make):
    assert refusal(float_array(make, range(6), (2, 3)), ARRAY, UNSTAMPED).reason == 'bad_shape'


@pytest.mark.parametrize('wrong', [
    {'type': IMAGE}, {'type': ARRAY, 'allow_unstamped': True}, {'type': ARRAY, 'sample_period_s': 1e-6},
])
def test_parameters_that_can_never_work_are_refused_at_once(wrong):
    with pytest.raises(ParameterError, match=r'echo\.(sample_period_s|allow_unstamped)'):
        EchoParameters(**wrong)


def test_plain_bytes_serve_as_data():
    message = SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0), frame_id=''), height=1,
                              width=2, encoding='16SC1', is_bigendian=0, step=4, data=b'\x01\x00\xff\xff')
    ping = ping_from_message(message, IMAGE, EchoParameters(type=IMAGE, sample_period_s=1e-6), 0)
    assert ping.samples.tolist() == [1.0, -1.0]
