"""polymap_evaluate live and cpu: what they publish, and that a short run tells what became of it."""

import csv
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip('rclpy')

from polymap_ros.commands.live import Stream, cpu_of, cpu_table
from polymap_ros.evaluation.round_trip import RoundTrip
from polymap_ros.messages.echoes import stamp_to_ns
from polymap_ros.simulation.clearance import clearance
from polymap_ros.simulation.scene_file import load_scene

SHORT = ['--odom-hz', '50', '--ping-hz', '10', '--samples', '2048', '-p', 'solver.method:=paper']


def live(minutes, folder):
    code = 'import sys; from polymap_ros.commands.evaluate import main; sys.exit(main(sys.argv[1:]))'
    subprocess.run([sys.executable, '-c', code, 'live', '--minutes', minutes, '--output', str(folder), *SHORT],
                   check=True, timeout=180)
    with (folder / 'results.csv').open() as file:
        return list(csv.DictReader(file)), (folder / 'table.md').read_text()


def test_the_drive_closes_upon_itself_inside_the_plate():
    drive = RoundTrip(10.0, 2048)
    times_s = np.arange(0.0, 60.0, 0.02)
    poses = drive.poses(times_s)
    assert clearance(load_scene('pentagon').vertices, poses[:, :2]).min() > 0.079
    assert poses[1500:, :2] == pytest.approx(poses[:1500, :2], abs=1e-9)
    moves = np.diff(poses, axis=0)
    assert np.arctan2(moves[:, 1], moves[:, 0]) == pytest.approx(
        np.angle(np.exp(1j * (poses[:-1, 2] + poses[1:, 2]) / 2)), abs=1e-3), 'it looks where it goes'


def test_the_stream_is_in_order_and_as_long_as_it_says():
    stream = Stream(50.0, 10.0, 2048)
    entries = list(stream.messages(3.0, stream.pings()[:7]))
    times = [ns for *_, ns in entries]
    assert times == sorted(times)
    counts = tuple(sum(topic == name for topic, *_ in entries) for name in ('odom', 'echo'))
    assert counts == stream.expected(3.0) == (151, 30)
    first_ns = stamp_to_ns(entries[0][2].header.stamp)
    last = [message for topic, _, message, _ in entries if topic == 'echo'][-1]
    assert stamp_to_ns(last.header.stamp) - first_ns == 2_900_000_000


def test_live_loses_nothing_and_tells_by_the_second(tmp_path):
    rows, table = live('0.1', tmp_path)
    assert '| odometry sent, received, lost | 301, 301, 0 |' in table
    assert '| pings sent, received, used | 60, 60, 60 |' in table
    assert '| exit status of the node | 0 |' in table
    assert float(rows[-1]['pings_used']) == 60
    assert all(float(row['memory_mb']) > 50.0 and float(row['cpu_share']) >= 0.0 for row in rows)
    assert 0.0 < float(rows[-1]['latency_p50_ms']) <= float(rows[-1]['latency_p99_ms'])


def test_cpu_of_the_node_that_only_subscribes():
    stream = Stream(50.0, 10.0, 2048)
    row = cpu_of('polymap_ros.node.reference', [], stream, 1.0, stream.pings())
    # The clock of CPU ticks by a hundredth of this second: beside other work a tick may fall either way.
    assert 0.0 <= row['idle_share'] < row['share'] + 0.02 < 1.0
    # The third round is twice as slow for both; the ratios of the other node are 3, 5 and 2.
    lines = cpu_table([each for factor, slow in ((3.0, 1.0), (5.0, 1.0), (2.0, 2.0)) for each in (
        {'node': 'one', **row, 'ping_us': 100.0 * slow},
        {'node': 'other', **row, 'ping_us': 100.0 * slow * factor})]).splitlines()
    assert len(lines) == 4
    assert lines[2].count('1.00x') == 2
    assert '| 100 us, 1.00x |' in lines[2]
    assert '| 400 us, 3.00x |' in lines[3]
