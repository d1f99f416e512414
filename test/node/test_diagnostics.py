"""The reasons that the diagnostics give in words are true, and what is no polygon is never published as one."""

import contextlib
import dataclasses
import itertools
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip('rclpy')

import pinging

from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import odometry_message
from polymap_ros.node.factory import make, message_class
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

RELIABLE = [part for topic in ('odom', 'echo')
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]
PAPER = ['-p', 'solver.method:=paper']
SECOND_NS = 10**9


def says(peer, values, text):
    peer.spin_until(lambda: text in values().get('message', ''), f'{text!r} in the diagnostics')
    return values()


def test_queue_overflow_and_missing_odometry(peer, start, riding):
    node = start('--ros-args', *RELIABLE, '-p', 'odometry.queue_size:=3')
    values, ride = peer.diagnostics(), riding()
    stamps = iter(range(SECOND_NS, 2 * SECOND_NS))

    def known():  # the first may be sent before the reader knows its writer
        ride.pose(next(stamps), 0)
        return values().get('odometry received', '0') != '0'

    peer.spin_until(known, 'a pose')
    for k in range(5):
        ride.ping((k + 2) * SECOND_NS, ride.samples[k])
    found = says(peer, values, 'queue_full: 3 pings wait for their odometry (odometry.queue_size)')
    assert (found['level'], found['pings waiting'], found['pings dropped: queue_full']) == ('2', '3', '2')
    assert '[ERROR]' in node.wait_for_line('queue_full')
    says(peer, values, '/odom has a publisher, but no message comes any more')
    node.wait_for_line('/odom has a publisher, but no message comes any more')
    peer.node.destroy_publisher(ride.odometry)
    says(peer, values, 'no publisher on /odom')


def test_a_topic_of_another_name_is_found_by_its_type(peer, start):
    peer.node.create_publisher(message_class('sensor_msgs/msg/LaserScan'), '/echo', 10)
    node = start('--ros-args', '-r', 'echo:=/sonar/echo')
    says(peer, peer.diagnostics(), 'no publisher on /sonar/echo; sensor_msgs/msg/LaserScan is published on /echo: '
         'remap it (--ros-args -r echo:=/echo)')
    node.wait_for_line('no publisher on /sonar/echo')


def test_two_publishers_on_one_input_are_told_as_the_cause(peer, start):
    _, other = (peer.node.create_publisher(message_class('nav_msgs/msg/Odometry'), '/odom', 10) for _ in range(2))
    start('--ros-args', *RELIABLE)
    values = peer.diagnostics()
    found = says(peer, values, '2 publishers on /odom (/peer), whose messages are mixed: stop all but one')
    assert found['level'] == '2'
    peer.node.destroy_publisher(other)
    peer.spin_until(lambda: 'publishers on' not in values()['message'], 'the end of it')


def test_pings_older_than_the_odometry_and_within_its_gaps(peer, start, riding):
    start('--ros-args', *RELIABLE, '-p', 'odometry.buffer_s:=20.0')
    values, ride = peer.diagnostics(), riding()
    for second in (90.0, 90.5, 91.0, 99.5, 100.0, 100.5):
        ride.pose(round(second * SECOND_NS), 0)
    peer.spin_until(lambda: values().get('odometry received') == '6', 'the poses')
    ride.ping(200 * SECOND_NS, ride.samples[3])
    says(peer, values, '1 pings wait for odometry: is it late, or are the clocks of the two apart?')
    ride.ping(10 * SECOND_NS, ride.samples[0])
    says(peer, values, 'stale: emitted 90.500 s before the newest odometry; odometry.buffer_s keeps 20 s')
    ride.ping(95 * SECOND_NS, ride.samples[1])
    says(peer, values, 'pose_gap: emitted within a gap of 8.500 s')
    ride.ping(89 * SECOND_NS, ride.samples[2])
    says(peer, values, 'no_pose: emitted 1.000 s before the first odometry')


def test_refused_odometry_is_told_and_waiting_pings_are_logged_once(peer, start, riding):
    node = start('--ros-args', *RELIABLE)
    values, ride = peer.diagnostics(), riding()
    ride.pose(SECOND_NS, 0)
    for k in range(4):
        ride.ping((k + 2) * SECOND_NS, ride.samples[k])
        says(peer, values, f'{k + 1} pings wait for odometry')
    bad = odometry_message(make, 3 * SECOND_NS, 'odom', Pose(0.0, 0.0))
    bad.pose.pose.orientation.w = 0.0

    def refused():  # once the good pose is longer ago than what is still told
        ride.odometry.publish(bad)
        return 'odometry is refused: ' in values()['message']

    peer.spin_until(refused, 'refused odometry in the diagnostics')
    assert 'orientation' in values()['message']
    assert values()['level'] == '2'
    assert node.stop() == 0
    assert sum('pings wait for odometry' in line for line in node.lines) == 1


def test_a_dropped_ping_is_told_for_seconds(peer, start, riding):
    start('--ros-args', *RELIABLE)
    looks, ride = peer.listen('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', 10), riding()
    ride.ping(SECOND_NS, [])

    def told():
        return ['pings dropped' in look.status[0].message for look in looks]

    peer.spin_until(lambda: True in told() and not told()[-1], 'the drop, and then no more')
    assert 4 <= sum(told()) <= 6
    assert told()[told().index(True):].index(False) == sum(told()), 'without a break'


def test_after_a_reset_what_was_dropped_before_is_no_longer_told(peer, start, riding):
    start('--ros-args', *RELIABLE)
    values, ride = peer.diagnostics(), riding()
    for _ in range(3):
        ride.ping(SECOND_NS, ride.samples[0][:3])
    peer.spin_until(lambda: 'too_short' in values().get('message', ''), 'the drops')
    assert peer.call('/polymap_node/reset', 'std_srvs/srv/Trigger').success
    ride.ping(SECOND_NS, np.zeros(2048))
    peer.spin_until(lambda: 'bad_samples' in values()['message'], 'the drop after the reset')
    assert 'too_short' not in values()['message']


@pytest.mark.parametrize('method', ['evidence', 'paper'])
def test_straight_path_is_told_and_gives_no_polygon_and_no_map(peer, start, riding, method):
    start('--ros-args', *RELIABLE, '-p', f'solver.method:={method}', '-p', 'solver.period_s:=0.2')
    values, ride = peer.diagnostics(), riding()
    outputs = [peer.listen(f'/polymap_node/{name}', kind) for name, kind in (
        ('polygon', 'geometry_msgs/msg/PolygonStamped'), ('map', 'nav_msgs/msg/OccupancyGrid'))]
    markers = peer.listen('/polymap_node/markers', 'visualization_msgs/msg/MarkerArray')
    scene = load_scene('triangle')
    along = np.linspace(0.0, 1.0, 30)[:, None]
    poses = np.hstack(((1.0 - along) * (0.3, 0.2) + along * (0.6, 0.4), np.full((30, 1), np.arctan2(0.2, 0.3))))
    ride.poses, ride.samples = poses, simulate(dataclasses.replace(scene, poses=poses))
    ride.publish(0, 30)
    found = says(peer, values, 'one straight line')
    peer.spin_until(lambda: values()['pings used'] == '30' and markers[-1:] and 'outline' not in [
        marker.ns for marker in markers[-1].markers], 'markers of the last answer')
    assert found['level'] == '1'
    assert values()['status'] in ('open', 'ambiguous')
    assert outputs == [[], []]


def test_solver_that_is_behind_is_told(peer, start, riding):
    start('--ros-args', *RELIABLE, *PAPER, '-p', 'solver.period_s:=0.01', '-p', 'solver.iterations:=1000000')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 10)
    peer.until_used(values, 10)
    ride.publish(10, 20)
    found = says(peer, values, 'the solver is behind: a solve was not done after ')
    peer.until_used(values, 20)
    assert found['level'] == '1'
    assert ' after 0.00 s' not in found['message']
    assert 'one is due every 0.01 s (solver.period_s)' in found['message']
    reset = peer.call('/polymap_node/reset', 'std_srvs/srv/Trigger')
    assert reset.success, 'a reset does not wait for the solver'
    peer.spin_until(lambda: values()['pings used'] == '0', 'the reset')


class Pings:
    """A process that sends pings; where the middleware takes it down, another one goes on."""

    def __init__(self, stamp_ns):
        self.stamp_ns, self._process = stamp_ns, None

    def sent(self, count):
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen([sys.executable, pinging.__file__, str(self.stamp_ns)], text=True,
                                             stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        with contextlib.suppress(BrokenPipeError):
            print(count, file=self._process.stdin, flush=True)
        self.stamp_ns = int(self._process.stdout.readline() or self.stamp_ns + count)

    def end(self):
        if self._process is not None:
            self._process.kill()
            self._process.communicate()


@pytest.fixture
def pings():
    made = Pings(2 * SECOND_NS)
    yield made
    made.end()


def test_messages_that_the_middleware_lost_are_counted(peer, start, riding, pings):
    """Best effort, and a node that is stopped for longer than its socket's buffer lasts.

    On a loaded machine that may be longer than the lease of its discovery, too, and then nothing of it was lost: again.
    What is sent before the node has met the publisher never comes: a pose is sent until one did.
    """
    node = start()
    values, ride = peer.diagnostics(), riding()
    before = iter(range(SECOND_NS))

    def met():
        ride.pose(next(before), 0)
        return values().get('odometry received', '0') != '0'

    peer.spin_until(met, 'a pose')
    odometry_lost = values()['odometry lost']

    def stopped():
        os.kill(node.popen.pid, signal.SIGSTOP)
        pings.sent(400)
        os.kill(node.popen.pid, signal.SIGCONT)
        return itertools.repeat(1, 100)

    rounds = iter(())

    def noticed():  # with the next message that comes through
        nonlocal rounds
        if next(rounds, None) is None:
            rounds = stopped()
        pings.sent(1)
        return values()['echoes lost'] != '0'

    peer.spin_until(noticed, 'lost echoes in the diagnostics')
    node.wait_for_line('messages lost on /echo: ')  # the message tells of what is worse, if as many pings wait as may
    assert values()['odometry lost'] == odometry_lost
