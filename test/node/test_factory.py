"""rclpy's messages built and converted: the same content, the right array types."""

import array

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, odometry_message, polygon_message
from polymap_ros.node.factory import converted, make, message_class

STORE = get_typestore(Stores.ROS2_JAZZY)
PING = Ping(1_000_000_002, np.array([1.0, -2.0, 0.5], np.float32), float(np.float32(1e-6)),
            range_max_m=3.0, frame_id='sonar')


def make_rosbags(type_name, /, **fields):
    return STORE.types[type_name](**fields)


MESSAGES = [
    ('nav_msgs/msg/Odometry', lambda make: odometry_message(make, 5_000_000_001, 'odom', Pose(1.0, 2.0, 0.5))),
    ('sensor_msgs/msg/LaserScan', lambda make: echo_message(make, PING, 0.5)),
    ('geometry_msgs/msg/PolygonStamped', lambda make: polygon_message(make, 7, 'odom', [[0, 0], [1, 0], [0, 1]])),
]


@pytest.mark.parametrize(('type_name', 'build'), MESSAGES)
def test_dataclass_converts_to_what_rclpy_builds(type_name, build):
    assert converted(build(make_rosbags), type_name) == build(make)


@pytest.mark.parametrize(('type_name', 'build'), MESSAGES)
def test_serialised_by_rclpy_reads_in_rosbags(type_name, build):
    read = STORE.deserialize_cdr(serialize_message(build(make)), type_name)
    assert converted(read, type_name) == build(make)


def test_numbers_become_arrays_of_the_fields_type():
    message = echo_message(make, PING)
    assert isinstance(message.intensities, array.array)
    assert message.intensities.typecode == 'f'


def test_message_of_rclpy_is_left_alone():
    message = echo_message(make, PING)
    assert converted(message, 'sensor_msgs/msg/LaserScan') is message


def test_nested_sequences_convert():
    field = make_rosbags('sensor_msgs/msg/PointField', name='t', offset=4, datatype=8, count=1)
    header = make_rosbags('std_msgs/msg/Header', stamp=make_rosbags('builtin_interfaces/msg/Time', sec=1, nanosec=2),
                          frame_id='a')
    cloud = make_rosbags('sensor_msgs/msg/PointCloud2', header=header, height=1, width=1, fields=[field],
                         is_bigendian=False, point_step=12, row_step=12, data=np.arange(12, dtype=np.uint8),
                         is_dense=True)
    message = converted(cloud, 'sensor_msgs/msg/PointCloud2')
    assert message.fields == [message_class('sensor_msgs/msg/PointField')(name='t', offset=4, datatype=8, count=1)]
    assert message.data.tolist() == list(range(12))
