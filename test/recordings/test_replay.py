"""A replay feeds the mapper what the recording holds, in order, and accounts for every message."""

import sqlite3

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import RecordingError
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.replay import Replay
from polymap_ros.recordings.writing import make

PARAMETERS = Parameters().replaced({
    'medium.model': 'constant', 'medium.speed_m_s': 1500.0, 'grid.range_max_m': 0.2, 'grid.angle_step_deg': 10.0,
    'echo.blanking_m': 0.0})


def replayed(path, parameters=PARAMETERS, **interval):
    mapper = PolygonMapper(parameters)
    with Recording.open(path) as recording:
        replay = Replay(recording, mapper, parameters, **interval)
        topics = [entry.topic for entry in replay]
        return mapper, replay, topics


def test_the_mapper_has_what_it_would_have_been_given_by_hand(write_recording):
    mapper, replay, topics = replayed(write_recording())
    by_hand = PolygonMapper(PARAMETERS)
    for k in range(41):
        ns = 100 * 10**9 + k * 50_000_000
        by_hand.add_pose(ns, Pose(0.01 * k, 0.0), 'odom')
        if k % 2:
            samples = np.random.default_rng(k).normal(size=256).astype(np.float32)
            by_hand.add_ping(Ping(ns, samples, float(np.float32(1e-6))))
    assert (mapper.counts.received, mapper.counts.used) == (20, 20)
    assert by_hand.counts == mapper.counts
    np.testing.assert_array_equal(mapper.beam_map.values, by_hand.beam_map.values)
    assert (replay.total, len(topics)) == (61, 61)
    assert (replay.odometry.received, replay.odometry.used, replay.odometry.dropped) == (41, 41, {})
    assert replay.cautions() == []


def test_an_interval(write_recording):
    mapper, replay, _ = replayed(write_recording(), start_s=0.5, end_s=1.0)
    assert (replay.odometry.received, replay.echoes) == (10, 5)
    assert mapper.counts.received == mapper.counts.used + sum(mapper.counts.dropped.values()) == 5
    assert replay.cautions() == []


def test_echoes_that_end_the_recording_are_not_left_waiting(write_recording):
    mapper, _, _ = replayed(write_recording(), end_s=1.96)  # the last echo at 1.95 s, with its pose
    assert (mapper.counts.waiting, mapper.counts.used) == (0, 20)
    parameters = PARAMETERS.replaced({'echo.t0_s': -1e-5})  # emitted after the last pose
    mapper, _, _ = replayed(write_recording('other'), parameters, end_s=1.96)
    assert (mapper.counts.waiting, mapper.counts.used, mapper.counts.dropped) == (0, 19, {'no_pose': 1})


def test_messages_that_cannot_be_decoded_are_counted_and_said(write_recording):
    path = write_recording(storage='sqlite3')
    with sqlite3.connect(next(path.glob('*.db3'))) as connection:
        connection.execute('UPDATE messages SET data = substr(data, 1, 40) WHERE id < 10')
    connection.close()
    mapper, replay, _ = replayed(path)
    assert mapper.counts.received == 20
    assert mapper.counts.dropped['bad_shape'] == 3
    assert (replay.odometry.received, replay.odometry.used) == (41, 35)
    assert replay.odometry.dropped == {'undecodable': 6}
    assert [caution.code for caution in replay.cautions()] == [
        'recording_damaged', 'recording_damaged', 'odometry_dropped']


def test_odometry_that_cannot_be_used_is_counted_by_reason(write_recording):
    spoilt = make('nav_msgs/msg/Odometry')
    spoilt.pose.pose.position.x = np.nan
    other_frame = make('nav_msgs/msg/Odometry')
    other_frame.header.frame_id = 'map'
    _, replay, _ = replayed(write_recording(extra=[('/odom', spoilt), ('/odom', make('nav_msgs/msg/Odometry')),
                                                   ('/odom', other_frame)]))
    assert (replay.odometry.received, replay.odometry.used) == (44, 41)
    assert replay.odometry.dropped == {'bad_pose': 1, 'other_frame': 2}
    (caution,) = replay.cautions()
    assert caution.finding == '/odom: of 44 messages dropped: 1 bad_pose, 2 other_frame'


def test_stamps_that_go_back_are_counted(write_recording):
    late = stamped_odometry(99.5)
    _, replay, _ = replayed(write_recording(extra=[('/odom', late)]))
    assert replay.odometry.dropped == {'out_of_order': 1}


def stamped_odometry(stamp_s):
    message = make('nav_msgs/msg/Odometry')
    message.header.frame_id, message.header.stamp.sec = 'odom', int(stamp_s)
    message.header.stamp.nanosec = round(stamp_s % 1.0 * 1e9)
    return message


def test_one_stamp_far_ahead_costs_no_ping_and_is_said(write_recording):
    mapper, replay, _ = replayed(write_recording(extra=[('/odom', stamped_odometry(2e9))]))
    assert (mapper.counts.used, mapper.counts.dropped) == (20, {})
    assert (replay.odometry.received, replay.odometry.used) == (42, 41)
    (caution,) = replay.cautions()
    assert caution.finding == '/odom: of 42 messages dropped: 1 stamped_ahead'


def test_a_stamp_never_filled_in_costs_no_ping(write_recording):
    mapper, _, _ = replayed(write_recording(extra=[('/odom', stamped_odometry(0.0))]))
    assert (mapper.counts.used, mapper.counts.dropped) == (20, {})


def test_odometry_of_which_nothing_can_be_used(write_recording, tmp_path):
    path = write_recording()
    with pytest.raises(RecordingError, match=r'no message of /odom between --start and --end; .* 2\.000 s long'):
        replayed(path, start_s=3.0)
    with pytest.raises(RecordingError, match='no message of /echo between'):
        replayed(path, end_s=0.05)


def test_a_type_that_is_not_the_parameters_is_refused_before_anything_is_read(write_recording):
    parameters = PARAMETERS.replaced({'echo.type': 'sensor_msgs/msg/PointCloud2'})
    with pytest.raises(RecordingError, match='topic /echo is of type sensor_msgs/msg/LaserScan'):
        replayed(write_recording(), parameters)
