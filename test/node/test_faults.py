"""Cycles of random faults against a live node: it does not crash, nothing leaks, and its counters add up."""

import os
import subprocess
import sys
from itertools import count
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.duration import Duration

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, odometry_message
from polymap_ros.node.factory import make
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

ODOMETRY, SCAN = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan'
TRIGGER, SWITCH, SET = 'std_srvs/srv/Trigger', 'std_srvs/srv/SetBool', 'rcl_interfaces/srv/SetParameters'
NODE, QUEUE, S = '/polymap_node', 50, 10**9
CHANGES = (
    ('solver.method', ('evidence', 'paper', 'rectangle', 'magic')), ('solver.max_edges', (3, 5, 10, 2)),
    ('solver.period_s', (0.1, 1.0, 0.0)), ('solver.iterations', (20, 300, 0)), ('solver.iou_weight', (0.0, 3.0, -1.0)),
    ('map.margin_m', (0.0, 0.5, -0.1)), ('odometry.on_jump_back', ('reset', 'ignore', 'panic')),
    ('grid.range_max_m', (2.0,)), ('output.autosave_s', (0.0, 0.5, -1.0)),
)
"""Parameters and what they are set to; the last value of each is refused."""


class Faults:
    """A drive round the triangle that goes wrong in every way it can; the methods are the faults."""

    def __init__(self, peer, seed):
        scene = load_scene('triangle', None)
        self.poses, self.samples = scene.poses, simulate(scene).astype(np.float32)
        self.peer, self.random, self.numbers = peer, np.random.default_rng(seed), count()
        self.now_ns, self.shift, self.frame = 1000 * S, np.zeros(2), 'odom'
        self.sent = {'odometry': 0, 'echoes': 0}
        self.odometry = peer.publisher('/odom', ODOMETRY, subscribers=2)
        self.echo = peer.publisher('/echo', SCAN, subscribers=2)
        self.kinds = [getattr(self, name) for name in (
            'drive', 'restart_odometry', 'restart_echoes', 'silence', 'silence_of_odometry', 'burst', 'back', 'ahead',
            'duplicates', 'jump', 'wild_poses', 'wild_pings', 'another_frame', 'change', 'pause', 'reset', 'save')]

    def pose(self, ns=None, place=None):
        x, y, yaw = self.poses[next(self.numbers) % len(self.poses)] if place is None else place
        pose = Pose(x + self.shift[0], y + self.shift[1], yaw)
        self.odometry.publish(odometry_message(make, max(self.now_ns if ns is None else ns, 0), self.frame, pose))
        self.sent['odometry'] += 1

    def ping(self, ns=None, samples=None, period_s=1e-6):
        if samples is None:
            samples = self.samples[next(self.numbers) % len(self.samples)]
        ns = max(self.now_ns if ns is None else ns, 0)
        self.echo.publish(echo_message(make, Ping(ns, np.asarray(samples, np.float32), period_s)))
        self.sent['echoes'] += 1

    def drive(self, pings=4):
        for _ in range(pings):
            self.now_ns += S // 4
            k = next(self.numbers) % len(self.poses)
            self.pose(place=self.poses[k])
            self.ping(samples=self.samples[k])
        self.pose(self.now_ns + S // 8)
        self.now_ns += S // 8

    def _again(self, publisher, topic, type_name):
        """What was sent before has arrived, so that the counts stay known."""
        assert publisher.wait_for_all_acked(Duration(seconds=10.0))
        self.peer.node.destroy_publisher(publisher)
        return self.peer.publisher(topic, type_name, subscribers=2)

    def restart_odometry(self):
        self.odometry = self._again(self.odometry, '/odom', ODOMETRY)

    def restart_echoes(self):
        self.echo = self._again(self.echo, '/echo', SCAN)

    def silence(self):
        self.now_ns += int(self.random.integers(1, 20)) * S
        self.peer.executor.spin_once(timeout_sec=0.2)

    def silence_of_odometry(self):
        for _ in range(QUEUE + 10):
            self.now_ns += S // 20
            self.ping()

    def burst(self):
        """Ten times as many as in a drive, as fast as they go."""
        self.drive(40)

    def back(self):
        self.now_ns = max(self.now_ns - int(self.random.integers(1, 100 * S)), 0)

    def ahead(self):
        self.now_ns += int(self.random.integers(1, 10_000 * S))

    def duplicates(self):
        for _ in range(5):
            self.pose()
            self.ping()

    def jump(self):
        self.shift = self.random.uniform(-5.0, 5.0, 2)

    def wild_poses(self):
        for place in ((np.nan, 0.0, 0.0), (1e300, 0.0, 0.0), (0.0, -np.inf, 0.0)):
            self.pose(place=place)
        self.pose(ns=2**31 * S - 1)

    def wild_pings(self):
        for samples in ([], [np.nan] * 100, np.zeros(5000), [1e38] * 3000, [1e-45] * 3000, np.ones(200_000)):
            self.now_ns += 1
            self.ping(samples=samples)
        for period_s in (0.0, -1.0, np.nan, 1e30, 1e-30):
            self.ping(period_s=period_s, samples=self.samples[0])

    def another_frame(self):
        self.frame = str(self.random.choice(['odom', 'map', '']))

    def change(self):
        name, values = CHANGES[self.random.integers(len(CHANGES))]
        value = values[self.random.integers(len(values))]
        kind, field = {str: (4, 'string_value'), int: (2, 'integer_value'), float: (3, 'double_value')}[type(value)]
        entry = make('rcl_interfaces/msg/Parameter', name=name,
                     value=make('rcl_interfaces/msg/ParameterValue', type=kind, **{field: value}))
        answer = self.peer.call(f'{NODE}/set_parameters', SET, parameters=[entry])
        assert answer.results[0].successful == (value != values[-1]), (name, value, answer.results[0].reason)

    def pause(self):
        self.peer.call(f'{NODE}/pause', SWITCH, data=True)
        self.drive()
        self.peer.call(f'{NODE}/pause', SWITCH, data=False)

    def reset(self):
        assert self.peer.call(f'{NODE}/reset', TRIGGER).success

    def save(self):
        answer = self.peer.call(f'{NODE}/save', TRIGGER)
        assert answer.success, answer.message
        assert (Path(answer.message) / 'polygon.json').exists()


class Watch:
    """What the process takes, and what it says of itself."""

    def __init__(self, peer, process, reference):
        self.peer, self.values = peer, peer.diagnostics()
        self.folder, self.beside = (Path('/proc') / str(each.pid) for each in (process.popen, reference))

    def takes(self):
        """Resident memory [MB] beyond that of a node that does nothing with the same messages, threads, open files.

        What grows in both is the middleware's: it keeps memory for each message that once had to wait.
        """
        memory, other = (int((folder / 'statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6
                         for folder in (self.folder, self.beside))
        return memory - other, *(len(list((self.folder / name).iterdir())) for name in ('task', 'fd'))

    def settled(self, faults):
        """All that was sent has come, and is accounted for.

        Beside those that wait for odometry there are for a moment those that have their pose and wait for their turn.
        """
        received = {f'{name} received': str(number) for name, number in faults.sent.items()}
        self.peer.spin_until(lambda: received.items() <= self.values().items()
                             and int(self.values()['pings waiting']) <= QUEUE, f'{received} in {self.values()}')
        values = self.values()
        counts = {name: int(number) for name, number in values.items() if name.startswith('pings ')}
        dropped = sum(number for name, number in counts.items() if name.startswith('pings dropped'))
        assert counts['pings received'] == counts['pings used'] + dropped + counts['pings waiting'], values
        assert 'failed' not in values['message'], values['message']


@pytest.fixture
def reference():
    """A node that subscribes to the same, as reliably and as deep, and does nothing."""
    process = subprocess.Popen([sys.executable, '-m', 'polymap_ros.node.reference'], stderr=subprocess.DEVNULL)
    yield process
    process.kill()
    process.wait()


@pytest.mark.parametrize(('cycles', 'seed'), [
    (30, 1), pytest.param(1000, 2, marks=pytest.mark.slow)])
def test_a_node_under_random_faults_neither_crashes_nor_leaks_nor_loses_count(
    peer, start, reference, tmp_path, cycles, seed
):
    process = start('--ros-args', '-p', f'odometry.queue_size:={QUEUE}', '-p', f'output.dir:={tmp_path}', *(
        part for topic in ('odom', 'echo') for part in (
            '-p', f'qos_overrides./{topic}.subscription.reliability:=reliable',
            '-p', f'qos_overrides./{topic}.subscription.depth:=1000')))
    watch, faults, taken = Watch(peer, process, reference), Faults(peer, seed), []
    rounds = [faults.kinds[k] for _ in range(1 + cycles // len(faults.kinds))
              for k in faults.random.permutation(len(faults.kinds))]
    for number, fault in enumerate(rounds[:cycles], 1):
        faults.drive()
        fault()
        if number % 15 == 0:
            watch.settled(faults)
            taken.append((number, *watch.takes()))
    faults.reset()
    faults.frame, faults.shift = 'odom', np.zeros(2)
    watch.settled(faults)
    assert process.stop() == 0
    print(*taken, sep='\n')
    assert not any('Traceback' in line for line in process.lines)
    assert [path for path in tmp_path.iterdir() if path.name.startswith('.')] == []
    if cycles >= 1000:
        first, last = (np.median(rows, axis=0) for rows in (taken[len(taken) // 4:len(taken) // 2], taken[-15:]))
        assert last[1] < first[1] + 30.0, f'memory {first[1]:.0f} MB, later {last[1]:.0f} MB'
        assert tuple(last[2:]) <= tuple(first[2:] + 2), f'threads and files {first[2:]}, later {last[2:]}'
