"""What the node says of its own times: callbacks, and pings on their way."""

import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.node.latency import Latency
from polymap_ros.node.stopwatch import Stopwatch
from polymap_ros.parameters import Parameters


def busy_until(end_s):
    while time.monotonic() < end_s:
        pass


def test_the_longest_callback_is_known_by_name_even_if_it_fails():
    watch = Stopwatch()
    short = watch.timed('short', lambda: 'answer')

    def fails(duration_s):
        busy_until(time.monotonic() + duration_s)
        raise ZeroDivisionError

    assert short() == 'answer'
    with pytest.raises(ZeroDivisionError):
        watch.timed('long', fails)(0.02)
    assert watch.longest == 'long'
    assert watch.longest_s >= 0.02
    assert watch.recent_s() == watch.longest_s
    short()
    assert 0.0 < watch.recent_s() < 0.02
    assert watch.recent_s() == 0.0
    assert watch.longest_s >= 0.02


def test_latency_is_from_the_reception_to_the_map():
    """Pings that were received 1, 2, ... 100 ms ago and are placed by the odometry now."""
    mapper = PolygonMapper(Parameters())
    latency = Latency()
    mapper.placed = latency.placed
    assert np.isnan(latency.percentile_s(50))
    samples = np.random.default_rng(1).normal(size=2048).astype(np.float32)
    mapper.add_pose(0, Pose(0.0, 0.0))
    mapper.add_ping(Ping(1, samples, 1e-6))
    mapper.add_pose(2, Pose(0.0, 0.0))  # the filter of this length is there from here on
    now_ns = time.time_ns()
    for k in range(1, 101):
        latency.arrived(2 + k, now_ns - k * 1_000_000)
        mapper.add_ping(Ping(2 + k, samples, 1e-6))
    assert np.isnan(latency.percentile_s(50)), 'no odometry yet'
    mapper.add_pose(10**6, Pose(0.0, 0.0))
    since_s = (time.time_ns() - now_ns) * 1e-9
    assert 0.0505 <= latency.percentile_s(50) <= 0.0505 + since_s
    assert 0.099 <= latency.percentile_s(99) <= 0.1 + since_s
