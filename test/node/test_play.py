"""polymap_play over real DDS: everything, in order, at its pace, with /clock."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.odometry import stamped_pose
from polymap_ros.messages.outputs import echo_message, odometry_message
from polymap_ros.node.factory import message_class
from polymap_ros.recordings.writing import RecordingWriter, make

START_NS = 1_700_000_000_000_000_000
N_ODOMETRY, N_ECHOES = 50, 10
ODOMETRY, SCAN = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan'


@pytest.fixture(scope='module')
def recording(tmp_path_factory) -> Path:
    """One second: odometry at 50 Hz, echoes at 10 Hz."""
    path = tmp_path_factory.mktemp('play') / 'second.mcap'
    with RecordingWriter(path) as writer:
        for k in range(N_ODOMETRY):
            stamp = START_NS + k * 20_000_000
            writer.write('/odom', odometry_message(make, stamp, 'odom', Pose(k, 0.0)), stamp)
            if k % 5 == 0:
                ping = Ping(stamp, np.full(8, k, np.float32), 1e-6)
                writer.write('/sonar/raw', echo_message(make, ping), stamp + 1)
    return path


def play(start, recording, *arguments, ready=''):
    fixed = [str(recording), '-p', 'topics.echo:=/sonar/raw', '--wait', '20']
    return start(*fixed, *arguments, command='play', ready=ready)


def test_everything_arrives_once_and_in_order(peer, start, recording):
    odometry = peer.listen('odom', ODOMETRY, 1000)
    echoes = peer.listen('echo', SCAN, 1000)
    clock = peer.listen('/clock', 'rosgraph_msgs/msg/Clock', 1000)
    process = play(start, recording, '--rate', '2')
    peer.spin_until(lambda: len(odometry) == N_ODOMETRY and len(echoes) == N_ECHOES, 'all messages')
    assert process.end() == 0
    assert [stamped_pose(message)[2].position[0] for message in odometry] == list(range(N_ODOMETRY))
    assert [message.intensities[0] for message in echoes] == list(range(0, N_ODOMETRY, 5))
    stamps = [message.clock.sec * 10**9 + message.clock.nanosec for message in clock]
    assert stamps == sorted(stamps)
    assert stamps[0] == START_NS
    assert len(stamps) >= 45


def test_rate_sets_the_pace(peer, start, recording):
    arrivals = []
    peer.node.create_subscription(
        message_class(ODOMETRY), 'odom', lambda message: arrivals.append(time.monotonic()), 1000)
    peer.listen('echo', SCAN, 1000)
    play(start, recording, '--rate', '0.5')
    peer.spin_until(lambda: len(arrivals) == N_ODOMETRY, 'all odometry')
    assert arrivals[-1] - arrivals[0] == pytest.approx(2 * 0.98, abs=0.2)


def test_loop_starts_again_until_ctrl_c(peer, start, recording):
    odometry = peer.listen('odom', ODOMETRY, 1000)
    peer.listen('echo', SCAN, 1000)
    process = play(start, recording, '--rate', '5', '--loop')
    peer.spin_until(lambda: len(odometry) > N_ODOMETRY, 'a second round')
    assert process.stop(signal.SIGINT) == 130
    assert stamped_pose(odometry[N_ODOMETRY])[0] == START_NS
    assert not any('Traceback' in line for line in process.lines)


def test_topics_are_remapped_and_namespaced(peer, start, recording):
    odometry = peer.listen('/robot/wheels', ODOMETRY, 1000)
    echoes = peer.listen('/robot/echo', SCAN, 1000)
    play(start, recording, '--rate', '10', '--ros-args', '-r', '__ns:=/robot', '-r', 'odom:=wheels')
    peer.spin_until(lambda: len(odometry) == N_ODOMETRY and len(echoes) == N_ECHOES, 'all messages')


@pytest.mark.parametrize(('arguments', 'says'), [
    (['nowhere.mcap'], 'nowhere.mcap: no such recording'), (['{recording}'], 'no topic /echo'),
    (['{recording}', '--rate', '-1'], '--rate -1'), (['{recording}', '--rate', '1e-9'], '--rate 1e-09; allowed: 1e-06'),
    (['{recording}', '--rate', '1e308'], '--rate 1e+308'), (['{recording}', '--wait', '-1'], '--wait -1'),
    (['{recording}', '--speed', '2'], '--speed'),
    (['{recording}', '-p', 'topics.eco:=x'], 'did you mean topics.echo'),
    (['{recording}', '-p', 'topics.echo:=/sonar/raw', '--ros-args', '-r', 'odom:=1st'], "remap rule: '-r odom:=1st'"),
    (['{recording}', '-p', 'topics.echo:=/sonar/raw', '--ros-args', '--odom'], "unknown ROS arguments: ['--odom']"),
])
def test_wrong_use_is_one_line_and_status_2(start, recording, arguments, says):
    process = start(*(argument.format(recording=recording) for argument in arguments), command='play', ready='')
    assert process.end() == 2
    assert len(process.lines) == 1
    assert says in process.lines[0]


@pytest.mark.parametrize(('ros', 'says'), [
    (['-p', 'use_sim_time:=5'], 'use_sim_time'), (['-r', 'odom:=x', '-r', 'echo:=x'], 'type'),
    (['-r', 'odom:=/clock'], 'type'),
])
def test_what_rcl_refuses_is_told_without_a_traceback(start, recording, ros, says):
    process = play(start, recording, '--ros-args', *ros)
    assert process.end() == 2
    assert process.lines[-1].startswith('polymap_play: error: ')
    assert says in process.lines[-1]
    assert not any('Traceback' in line for line in process.lines)


def test_messages_beyond_the_end_of_clock_are_not_played(start, tmp_path):
    path = tmp_path / 'late.mcap'
    with RecordingWriter(path) as writer:
        for topic, message in (('/odom', odometry_message(make, 0, 'odom', Pose(0.0, 0.0))),
                               ('/sonar/raw', echo_message(make, Ping(0, np.ones(8, np.float32), 1e-6)))):
            writer.write(topic, message, 2**31 * 10**9)
    process = start(str(path), '-p', 'topics.echo:=/sonar/raw', '--wait', '0', command='play', ready='')
    assert process.end() == 2
    assert 'late.mcap: a message on /odom was logged at 2.14748365e+09 s, which is beyond /clock' in process.lines[-1]


def test_it_waits_for_a_subscriber_to_each_topic_and_says_for_which(peer, start, recording):
    odometry = peer.listen('/robot/odom', ODOMETRY, 1000)
    process = play(start, recording, '--rate', '10', '--ros-args', '-r', '__ns:=/robot')
    assert process.wait_for_line('waiting for').startswith('polymap_play: waiting for a subscriber to /robot/echo: ')
    assert odometry == []
    echoes = peer.listen('/robot/echo', SCAN, 1000)
    peer.spin_until(lambda: len(odometry) == N_ODOMETRY and len(echoes) == N_ECHOES, 'all messages')
    assert process.end() == 0


def test_where_nobody_comes_it_says_so_and_plays_all_the_same(peer, start, recording):
    peer.listen('odom', SCAN, 1000)
    process = start(str(recording), '-p', 'topics.echo:=/sonar/raw', '--wait', '1.5', '--rate', '20', command='play',
                    ready='nobody has subscribed to /odom and /echo after 1.5 s')
    assert 'the subscriber to /odom wants another type or QoS: playing all the same' in process.lines[-1]
    assert process.end() == 0
    assert process.lines[-1] == '60 messages played'


def test_it_does_not_wait_where_it_is_not_to(start, recording):
    process = start(str(recording), '-p', 'topics.echo:=/sonar/raw', '--wait', '0', '--rate', '20', command='play',
                    ready='')
    assert process.end() == 0
    assert process.lines == ['60 messages played']
