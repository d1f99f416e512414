"""Stamps of different clocks, and stamps that nobody filled, are called so wherever pings are dropped for them."""

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import BadPing
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.clocks import apart
from polymap_ros.hearing.listening import Listener
from polymap_ros.hearing.ping_queue import PingQueue
from polymap_ros.hearing.pose_track import PoseTrack
from polymap_ros.parameters import OdometryParameters, Parameters

S = 10**9
EPOCH_NS = 1_764_427_304 * S
OTHER = 'the echo is stamped 12.500 s, the odometry 1764427304.500 s: that is another clock'


def texts(ping_ns, odometry_ns, size=200):
    """Sentences of the drops of ten pings and twenty poses in the order of their log time."""
    track = PoseTrack(OdometryParameters())
    queue = PingQueue(track, size)
    for k in range(10):
        queue.put(Ping(ping_ns[k], np.ones(3, np.float32), 1e-6))
        for half in (0, 1):
            track.add(odometry_ns[2 * k + half], Pose(0.01 * k, 0.0))
        assert list(queue.placed()) == []
    queue.finish()
    assert sum(queue.counts.dropped.values()) == 10
    return queue.last_texts


def rising(start_ns, number=20, step_ns=S // 20):
    return [start_ns + k * step_ns for k in range(number)]


def test_stamps_since_boot_beside_stamps_since_1970():
    found = texts(rising(12 * S + S // 2), rising(EPOCH_NS))
    assert found.keys() <= {'no_pose', 'stale'}
    assert all('the echo is stamped 1' in text and text.endswith(
        'that is another clock; both are to be stamped by one') for text in found.values())
    found = texts(rising(EPOCH_NS), rising(12 * S))
    assert 'the odometry 12.950 s: that is another clock' in found['no_pose']
    assert 'that is another clock' in texts(rising(EPOCH_NS), rising(12 * S), size=3)['queue_full']


def test_both_values_are_told():
    assert apart(12 * S + S // 2, EPOCH_NS + S // 2).startswith(OTHER)
    assert apart(EPOCH_NS, EPOCH_NS + 60 * S) == ''
    assert apart(EPOCH_NS, None) == ''


def test_stamps_that_are_all_0():
    found = texts([0] * 10, rising(EPOCH_NS))
    assert 'stamps are all 0: its driver does not fill header.stamp' in found['duplicate']
    assert 'the echo has stamps of 0, its driver does not fill header.stamp' in apart(0, EPOCH_NS)
    assert 'the odometry has stamps of 0' in texts(rising(EPOCH_NS), [0] * 20)['no_pose']


@pytest.mark.parametrize(('period_s', 'reason', 'words'), [
    (1.0, 'bad_shape', '1 looks like microseconds'), (1000.0, 'bad_shape', '1000 looks like nanoseconds'),
    (1e6, 'bad_shape', '1e+06 looks like a sample rate in Hz'), (1e-5, 'bad_shape', '10 times too long'),
    (1e-9, 'too_short', '1000 times too short')])
def test_a_period_in_another_unit_is_called_by_it(period_s, reason, words):
    listener = Listener(Parameters(), np.arange(0.0, 3.001, 0.005))
    with pytest.raises(BadPing) as caught:
        listener.admission.check(Ping(0, np.ones(1200, np.float32), period_s))
    assert caught.value.reason == reason
    assert words in str(caught.value)
