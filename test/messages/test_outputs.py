"""Outputs as they arrive: built by either factory, read back from their bytes."""

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.echo_parameters import EchoParameters
from polymap_ros.messages import outputs
from polymap_ros.messages.echoes import ping_from_message

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])


def test_polygon_arrives_with_its_corners(make, transported):
    message = outputs.polygon_message(make, 5_000_000_001, 'odom', SQUARE)
    received = transported(message, 'geometry_msgs/msg/PolygonStamped')
    assert [[p.x, p.y, p.z] for p in received.polygon.points] == [[x, y, 0.0] for x, y in SQUARE]
    assert (received.header.stamp.sec, received.header.stamp.nanosec) == (5, 1)
    assert received.header.frame_id == 'odom'


def test_polygon_after_a_reset_has_no_points(make, transported):
    message = outputs.polygon_message(make, 0, 'odom', [])
    assert transported(message, 'geometry_msgs/msg/PolygonStamped').polygon.points == []


def test_beam_map_is_a_float_image_of_rows_theta(make, transported):
    values = np.arange(6.0).reshape(2, 3)
    received = transported(outputs.beam_map_message(make, 0, 'node/start', values), 'sensor_msgs/msg/Image')
    assert (received.height, received.width, received.encoding, received.step) == (2, 3, '32FC1', 12)
    assert received.header.frame_id == 'node/start'
    assert np.array_equal(np.frombuffer(received.data, '<f4').reshape(2, 3), values)


def test_occupancy_grid_has_row_zero_at_the_bottom(make, transported):
    cells = np.array([[0, 100, -1], [1, 2, 3]], np.int8)
    message = outputs.occupancy_grid_message(make, 3_000_000_000, 'odom', cells, 0.25, (-1.0, 2.0))
    received = transported(message, 'nav_msgs/msg/OccupancyGrid')
    assert received.data.tolist() == [0, 100, -1, 1, 2, 3]
    assert (received.info.width, received.info.height, received.info.resolution) == (3, 2, 0.25)
    assert (received.info.origin.position.x, received.info.origin.position.y) == (-1.0, 2.0)
    assert received.info.origin.orientation.w == 1.0


def test_map_after_a_reset_is_one_unknown_cell(make, transported):
    received = transported(outputs.no_map_message(make, 'odom'), 'nav_msgs/msg/OccupancyGrid')
    assert received.data.tolist() == [-1]
    assert (received.info.width, received.info.height) == (1, 1)
    assert received.info.resolution > 0.0


@pytest.mark.parametrize('dtype', [np.float32, np.float64])
def test_written_echo_reads_back(make, transported, dtype):
    ping = Ping(1_700_000_000_000_000_123, np.array([0.5, -1.0], dtype), 1e-6, range_min_m=0.25, range_max_m=2.0,
                frame_id='sonar')
    message = transported(outputs.echo_message(make, ping, scan_time_s=0.5), 'sensor_msgs/msg/LaserScan')
    read = ping_from_message(message, 'sensor_msgs/msg/LaserScan', EchoParameters(), 0)
    assert (read.stamp_ns, read.frame_id, read.range_min_m, read.range_max_m) == (
        ping.stamp_ns, 'sonar', 0.25, 2.0)
    assert read.samples.tolist() == [0.5, -1.0]
    assert message.scan_time == 0.5
    assert len(message.ranges) == 0
