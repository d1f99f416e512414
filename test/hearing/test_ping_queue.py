"""Pings that wait for their pose: the order, the bounds, and counters that add up."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.ping_queue import PingQueue
from polymap_ros.hearing.pose_track import PoseTrack
from polymap_ros.parameters import OdometryParameters

MS = 1_000_000


def ping(stamp_ms, t0_s=0.0):
    return Ping(stamp_ms * MS, np.arange(3, dtype=np.float32) + stamp_ms, 1e-6, t0_s, 0.1, 2.0, 'sensor')


def queue(size=200, **parameters):
    track = PoseTrack(OdometryParameters(**parameters))
    return track, PingQueue(track, size)


def stamps(queue):
    return [placed.stamp_ns // MS for placed, _ in queue.placed()]


def adds_up(queue):
    counts = queue.counts
    return counts.received == counts.used + sum(counts.dropped.values()) + counts.waiting


def test_a_ping_waits_until_it_is_bracketed_and_pings_come_in_order_of_emission():
    track, pings = queue()
    track.add(0, Pose(0.0, 0.0))
    for stamp_ms in (30, 10, 50):
        pings.put(ping(stamp_ms))
    assert stamps(pings) == []
    assert pings.counts.waiting == 3
    track.add(40 * MS, Pose(4.0, 0.0))
    assert [(placed.stamp_ns // MS, pose.x) for placed, pose in pings.placed()] == [
        (10, pytest.approx(1.0)), (30, pytest.approx(3.0))]
    track.add(50 * MS, Pose(5.0, 0.0))
    assert stamps(pings) == [50]
    assert (pings.counts.used, pings.counts.waiting, pings.counts.dropped) == (3, 0, {})


def test_the_time_of_emission_counts_not_the_stamp():
    track, pings = queue()
    track.add(0, Pose(0.0, 0.0))
    pings.put(ping(12, t0_s=0.002))
    track.add(10 * MS, Pose(1.0, 0.0))
    assert [(placed.stamp_ns // MS, pose.x) for placed, pose in pings.placed()] == [(12, 1.0)]


def test_what_will_never_be_placed_is_dropped_with_its_reason():
    track, pings = queue(max_gap_s=0.1, buffer_s=1.0)
    pings.put(ping(-5))
    track.add(0, Pose(0.0, 0.0))
    assert stamps(pings) == []
    pings.put(ping(100))
    track.add(200 * MS, Pose(0.0, 0.0))
    track.add(201 * MS, Pose(0.0, 0.0))
    assert stamps(pings) == []
    track.add(1500 * MS, Pose(0.0, 0.0))
    track.add(1501 * MS, Pose(0.0, 0.0))
    pings.put(ping(300))
    assert stamps(pings) == []
    assert pings.counts.dropped == {'no_pose': 1, 'pose_gap': 1, 'stale': 1}
    assert set(pings.last_texts) == {'no_pose', 'pose_gap', 'stale'}
    assert adds_up(pings)


def test_a_second_ping_of_the_same_time_is_a_duplicate_used_or_waiting():
    track, pings = queue()
    track.add(0, Pose(0.0, 0.0))
    pings.put(ping(5))
    pings.put(ping(5))
    track.add(10 * MS, Pose(0.0, 0.0))
    assert stamps(pings) == [5]
    pings.put(ping(5))
    assert stamps(pings) == []
    assert pings.counts.dropped == {'duplicate': 2}


def test_a_full_queue_drops_the_oldest_which_may_come_again():
    track, pings = queue(size=2)
    for stamp_ms in (2, 1, 3):
        pings.put(ping(stamp_ms))
    assert pings.counts.dropped == {'queue_full': 1}
    pings.put(ping(1))
    assert pings.counts.dropped == {'queue_full': 2}
    track.add(0, Pose(0.0, 0.0))
    track.add(10 * MS, Pose(0.0, 0.0))
    assert stamps(pings) == [1, 3]


def test_a_ping_that_has_its_pose_waits_for_its_turn_beside_the_queue_and_beyond_the_buffer():
    track, pings = queue(size=2, buffer_s=0.01)
    track.add(0, Pose(0.0, 0.0))
    for stamp_ms in range(1, 1001):
        pings.put(ping(stamp_ms))
        track.add(stamp_ms * MS, Pose(float(stamp_ms), 0.0))
        pings.place()
        assert adds_up(pings)
    assert (len(track) < 300, pings.counts.waiting, pings.counts.dropped) == (True, 1000, {})
    assert [(placed.stamp_ns // MS, pose.x) for placed, pose in pings.placed()] == [(k, k) for k in range(1, 1001)]
    assert adds_up(pings)


def test_what_waits_for_its_turn_is_bounded_by_memory():
    track = PoseTrack(OdometryParameters())
    pings = PingQueue(track, 200, backlog_bytes=3 * 12)
    track.add(0, Pose(0.0, 0.0))
    for stamp_ms in range(1, 6):
        pings.put(ping(stamp_ms))
        track.add(stamp_ms * MS, Pose(0.0, 0.0))
        pings.place()
    assert (pings.counts.waiting, pings.counts.dropped) == (3, {'queue_full': 2})
    assert pings.last_texts['queue_full'] == '0 MB of pings wait for their turn'
    pings.put(ping(1))
    assert pings.counts.dropped == {'queue_full': 2}, 'the oldest may come again'
    assert stamps(pings) == [4, 5, 1]
    assert adds_up(pings)


def test_under_a_clock_that_began_anew_what_has_its_pose_still_gets_its_turn():
    track, pings = queue()
    track.add(0, Pose(1.0, 0.0))
    for stamp_ms in (0, 5):
        pings.put(ping(stamp_ms))
    pings.place()
    pings.restart(track.emptied())
    assert pings.counts.dropped == {'no_pose': 1}
    assert stamps(pings) == [0]
    assert adds_up(pings)


def test_a_sensor_whose_place_never_became_known_is_named_at_the_end():
    track, pings = queue()
    track.add(0, Pose(1.0, 0.0))
    pings.put(ping(0))
    assert list(pings.placed(lambda _: False)) == []
    pings.finish()
    assert pings.last_texts['no_pose'] == "the place of its frame 'sensor' on the robot never became known"
    assert (pings.counts.waiting, adds_up(pings)) == (0, True)


def test_the_end_drops_what_waits():
    _, pings = queue()
    pings.put(ping(1))
    pings.put(ping(2))
    pings.finish()
    assert (pings.counts.dropped, pings.counts.waiting) == ({'no_pose': 2}, 0)


def test_memory_is_bounded_and_late_duplicates_are_still_known():
    track, pings = queue(buffer_s=1.0)
    track.add(0, Pose(0.0, 0.0))
    for i in range(1, 20_000):
        pings.put(ping(i))
        track.add(i * MS, Pose(float(i), 0.0))
        assert stamps(pings) == [i]
    assert len(pings.state()['taken_ns']) < 5000
    pings.put(ping(19_500))
    assert stamps(pings) == []
    pings.put(ping(10))
    assert stamps(pings) == []
    assert pings.counts.dropped == {'duplicate': 1, 'stale': 1}


KINDS = st.sampled_from(['ping', 'ping', 'pose', 'refuse', 'hold', 'hold', 'finish'])
EVENTS = st.lists(st.tuples(KINDS, st.integers(0, 60)), max_size=60)


@settings(max_examples=60, deadline=None)
@given(EVENTS, st.integers(0, 60))
def test_counters_always_add_up_and_a_restored_queue_goes_on_alike(events, cut):
    def run(restored):
        track, pings = queue(size=3, buffer_s=0.03, max_gap_s=0.01)
        used = []
        for i, (kind, stamp_ms) in enumerate(events):
            if restored and i == cut:
                fresh, again = queue(size=3, buffer_s=0.03, max_gap_s=0.01)
                fresh.restore(track.state())
                again.restore(pings.state())
                track, pings = fresh, again
            if kind == 'ping':
                pings.put(ping(stamp_ms))
            elif kind == 'pose':
                track.add(stamp_ms * MS, Pose(stamp_ms, 0.0, 0.1 * stamp_ms))
            elif kind == 'refuse':
                pings.refuse('bad_shape', 'broken')
            elif kind == 'finish':
                pings.finish()
            if kind == 'hold':  # what comes until the next event waits for its turn
                pings.place()
                assert adds_up(pings)
                continue
            used += [(placed.stamp_ns, placed.samples.tolist(), placed.period_s, placed.t0_s, placed.range_min_m,
                      placed.range_max_m, placed.frame_id, pose) for placed, pose in pings.placed()]
            assert adds_up(pings)
            assert len(used) == pings.counts.used
        return used, pings.counts

    assert run(True) == run(False)


@pytest.mark.parametrize('change', [
    {'counts': np.array([1, 2])}, {'dropped': np.array([5])}, {'waiting_ends': np.array([3, 6])},
    {'placed_poses': np.ones((1, 3))},
])
def test_counts_that_do_not_add_up_are_refused(change):
    _, pings = queue()
    pings.put(ping(1))
    pings.refuse('bad_shape', '')
    with pytest.raises((StateError, ValueError)):
        queue()[1].restore({**pings.state(), **change})
