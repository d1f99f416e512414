"""Numbers that no robot and no converter means: refused and counted, and all else goes on as if they had not been."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import BadOdometry, StateError
from polymap_ros.geometry.plane import SpatialPose
from polymap_ros.geometry.pose import FARTHEST_M, Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.odometry import stamped_pose
from polymap_ros.messages.outputs import odometry_message
from polymap_ros.parameters import Parameters
from polymap_ros.recordings.writing import make

PARAMETERS = Parameters().replaced({
    'medium.model': 'constant', 'medium.speed_m_s': 1500.0, 'grid.range_max_m': 0.2, 'grid.angle_step_deg': 10.0,
    'echo.blanking_m': 0.0})
WILD = [1e20, -1e20, 1e154, 1e308, -1e308, np.inf, np.nan]


def ping(k, scale=1.0, dtype=np.float64):
    samples = np.random.default_rng(k).normal(size=256)
    return Ping(k * 10**8, (samples * scale).astype(dtype), 1e-6)


def mapped(poses=None, pings=None, extra=()):
    """A mapper after six pings; `poses` and `pings` replace some, `extra` poses come besides."""
    mapper = PolygonMapper(PARAMETERS)
    for k in range(6):
        mapper.add_pose(k * 10**8, (poses or {}).get(k, Pose(0.01 * k, 0.001 * k * k, 0.1 * k)))
        for pose in extra:
            assert not mapper.add_pose(k * 10**8 + 1, pose)
        mapper.add_ping((pings or {}).get(k, ping(k)))
    mapper.finish()
    return mapper


@pytest.mark.parametrize('value', WILD)
@pytest.mark.parametrize('where', ['x', 'y', 'yaw'])
def test_a_pose_that_cannot_be_is_not_taken(value, where):
    wild = dataclasses.replace(Pose(0.0, 0.0), **{where: value})
    np.testing.assert_array_equal(mapped(extra=[wild]).beam_map.values, mapped().beam_map.values)


@pytest.mark.parametrize('value', WILD)
def test_a_pose_in_space_that_cannot_be_is_not_taken(value):
    mapper = mapped(extra=[SpatialPose((value, 0.0, 0.0)), SpatialPose((0.0, -value, 0.0))])
    np.testing.assert_array_equal(mapper.beam_map.values, mapped().beam_map.values)


@pytest.mark.parametrize('value', [2e9, 1e308, -1e308, np.nan])
def test_odometry_beyond_the_earth_is_refused(value):
    message = odometry_message(make, 0, 'odom', Pose(0.0, value))
    with pytest.raises(BadOdometry):
        stamped_pose(message)


@pytest.mark.parametrize('method', ['evidence', 'paper', 'rectangle'])
def test_one_pose_as_far_away_as_is_allowed_costs_no_more_than_its_ping(method):
    mapper = mapped(poses={3: Pose(FARTHEST_M, -FARTHEST_M)})
    mapper.configure(PARAMETERS.replaced({'solver.method': method}))
    assert mapper.solve().status in ('open', 'ambiguous', 'closed')
    assert np.isfinite(mapper.beam_map.values).all()


@pytest.mark.parametrize('scale', [1e-320, 1e-300, 1e-101, 1e101, 1e300, np.inf, np.nan])
def test_samples_whose_energy_is_no_number_are_dropped(scale):
    with np.errstate(all='raise', under='ignore'):
        mapper = mapped(pings={2: ping(2, scale)})
        assert mapper.counts.dropped == {'bad_samples': 1}
        mapper.solve()


@pytest.mark.parametrize(('scale', 'dtype'), [
    (1e-40, np.float32), (1e-30, np.float32), (1e37, np.float32), (1e-99, np.float64), (1e98, np.float64)])
def test_the_scale_of_the_samples_does_not_matter(scale, dtype):
    """Not even where float32 is subnormal, but for the digits it has left there."""
    scaled = mapped(pings={k: ping(k, scale, dtype) for k in range(6)}).beam_map.values
    np.testing.assert_allclose(scaled, mapped().beam_map.values, atol=1e-4 if scale < 1e-37 else 2e-6)


def test_a_state_with_numbers_that_cannot_be_is_refused():
    state = mapped().state()
    numbers = [name for name, array in state.items() if array.dtype.kind == 'f' and array.size
               and name.partition('.')[2] in ('places', 'poses', 'start', 'total', 'echoes')]
    assert len(numbers) >= 4
    for name in numbers:
        for value in (1e308, np.inf, np.nan):
            wild = {**state, name: state[name].copy()}
            wild[name].flat[0] = value
            if name == 'beam_map.total' and value == 1e308:
                continue  # a finite map, however high
            with pytest.raises(StateError):
                PolygonMapper.from_state(PARAMETERS, wild)


@pytest.mark.parametrize('sec', [-2**31, -1, 2**31 - 1])
def test_any_stamp_and_an_empty_frame_of_a_message_can_be_mapped_and_saved(sec):
    message = odometry_message(make, 0, '', Pose(0.0, 0.0))
    message.header.stamp.sec, message.header.stamp.nanosec = sec, 2**32 - 1
    stamp_ns, frame_id, pose = stamped_pose(message)
    mapper = PolygonMapper(PARAMETERS)
    for k in range(3):
        assert mapper.add_pose(stamp_ns + k * 10**8, pose, frame_id)
        mapper.add_ping(dataclasses.replace(ping(k), stamp_ns=stamp_ns + k * 10**8))
    assert mapper.counts.used == 3
    again = PolygonMapper.from_state(PARAMETERS, mapper.state())
    assert (again.frame_id, again.intake.newest_ns) == ('', stamp_ns + 2 * 10**8)


def test_ten_million_samples_are_too_long():
    mapper = mapped(pings={2: dataclasses.replace(ping(2), samples=np.ones(10**7, np.float32))})
    assert mapper.counts.dropped == {'too_long': 1}
