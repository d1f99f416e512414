"""Taking out what all pings have in common, while the robot drives: when it is known, and when it is not."""

import io

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import Pose
from polymap_ros.hearing.common_removal import CommonRemoval

N, PULSE_M = 256, 0.03
GENERATOR = np.random.default_rng(5)
NOISE = GENERATOR.normal(size=(100, N)).astype(np.float32)
CLUTTER = np.zeros(N, np.float32)
CLUTTER[30:60] = 20.0 * np.sin(np.arange(30))
EVERYWHERE = [Pose(*place) for place in GENERATOR.uniform(-0.5, 0.5, (100, 2)).tolist()]
ALONG = [Pose(0.01 * k, 0.001 * (k % 3)) for k in range(100)]


def removal(pings=16):
    return CommonRemoval(pings, 2e-5, PULSE_M)


def ping(k, samples=None):
    return Ping(k, NOISE[k] + CLUTTER if samples is None else samples, 1e-6)


def fed(common, places, first=0):
    return [[(out.stamp_ns, place) for out, place in common.take(ping(k), places[k])]
            for k in range(first, len(places))]


def clutter_left(out):
    return float((out.samples - NOISE[out.stamp_ns]) @ CLUTTER / (CLUTTER @ CLUTTER))


def test_off_lets_pings_pass_as_they_are():
    common = removal(0)
    sent = ping(0)
    assert common.take(sent, EVERYWHERE[0]) == [(sent, EVERYWHERE[0])]
    assert (common.finish(), common.cautions) == ([], ())


def test_pings_wait_until_it_is_known_and_come_in_order_without_it():
    common = removal()
    out = []
    for k in range(30):
        given = common.take(ping(k), EVERYWHERE[k])
        assert len(given) == (0 if k < 15 else 16 if k == 15 else 1)
        out += given
    assert [each.stamp_ns for each, _ in out] == list(range(30))
    assert [place for _, place in out] == EVERYWHERE[:30]
    assert max(abs(clutter_left(each)) for each, _ in out) < 0.1
    assert out[0][0].samples.dtype == np.float32
    assert common.cautions == ()


def test_a_robot_that_stands_or_drives_one_straight_line_loses_no_echo():
    for places in ([Pose(0.0, 0.0)] * 100, ALONG):
        common = removal()
        out = [given for k in range(70) for given in common.take(ping(k), places[k])]
        assert [each.stamp_ns for each, _ in out] == list(range(70))  # patience has an end
        np.testing.assert_array_equal([each.samples for each, _ in out], NOISE[:70] + CLUTTER)
        [caution] = common.cautions
        assert caution.code == 'common_unknown'


def test_a_turn_after_a_straight_line_makes_it_known():
    common = removal()
    out = [given for k in range(100) for given in common.take(ping(k), (ALONG[:50] + EVERYWHERE)[k])]
    assert len(out) == 100
    assert max(abs(clutter_left(each)) for each, _ in out) < 0.1


def test_the_end_lets_out_what_waits_with_what_is_known():
    few, enough = removal(), removal()
    assert not any(fed(few, EVERYWHERE[:7]))
    assert not any(fed(enough, EVERYWHERE[:12]))
    assert 'wait' in few.cautions[0].text
    assert [abs(clutter_left(each)) > 0.9 for each, _ in few.finish()] == [True] * 7
    assert [abs(clutter_left(each)) < 0.2 for each, _ in enough.finish()] == [True] * 12
    assert (few.finish(), enough.finish()) == ([], [])


def test_pings_of_another_shape_pass_as_they_are():
    common = removal()
    fed(common, EVERYWHERE[:20])
    other = Ping(0, NOISE[0][:200], 1e-6)
    [(out, _)] = common.take(other, EVERYWHERE[50])
    assert out is other


@pytest.mark.parametrize('cut', [0, 5, 16, 40])
def test_a_copy_and_a_saved_one_go_on_alike_and_on_their_own(cut):
    whole = removal()
    fed(whole, EVERYWHERE[:cut])
    file = io.BytesIO()
    np.savez(file, **whole.state())
    file.seek(0)
    saved = removal()
    with np.load(file, allow_pickle=False) as state:
        saved.restore(dict(state))
    copied = whole.copy()
    expected = fed(whole, EVERYWHERE, cut)
    assert fed(copied, EVERYWHERE, cut) == fed(saved, EVERYWHERE, cut) == expected


def test_a_damaged_state_is_refused():
    common = removal()
    fed(common, EVERYWHERE[:5])
    with pytest.raises(StateError, match='places'):
        removal().restore(common.state() | {'waiting_places': np.zeros((2, 3))})
