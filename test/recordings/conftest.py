"""Small real recordings for the tests of this folder."""

from pathlib import Path

import numpy as np
import pytest

from polymap_ros.recordings.writing import RecordingWriter, make

SCAN = 'sensor_msgs/msg/LaserScan'


def stamped(ns):
    stamp = make('builtin_interfaces/msg/Time', sec=ns // 10**9, nanosec=ns % 10**9)
    return make('std_msgs/msg/Header', stamp=stamp, frame_id='odom')


def odometry(ns, x=0.0):
    pose = make('geometry_msgs/msg/Pose', position=make('geometry_msgs/msg/Point', x=x))
    return make('nav_msgs/msg/Odometry', header=stamped(ns),
                pose=make('geometry_msgs/msg/PoseWithCovariance', pose=pose))


def echo(ns, seed=0):
    samples = np.random.default_rng(seed).normal(size=256).astype(np.float32)
    return make(SCAN, header=stamped(ns), time_increment=1e-6, intensities=samples)


@pytest.fixture
def write_recording(tmp_path):
    """Write 41 odometry messages and 20 echoes over two seconds from 100 s on."""

    def write(name='run', storage='mcap', odom_topic='/odom', echo_topic='/echo', extra=()) -> Path:
        with RecordingWriter(tmp_path / name, storage) as writer:
            for k in range(41):
                ns = 100 * 10**9 + k * 50_000_000
                writer.write(odom_topic, odometry(ns, 0.01 * k), ns)
                if k % 2:
                    writer.write(echo_topic, echo(ns, k), ns)
            for topic, message in extra:
                writer.write(topic, message, 100 * 10**9)
        return tmp_path / name

    return write
