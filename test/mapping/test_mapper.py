"""The whole way from pings and poses to the polygon, on simulated signals."""

import dataclasses
import io
import itertools

import numpy as np
import pytest
from heard_scenes import feed

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import StateError
from polymap_ros.geometry.lines import iou
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.geometry.poses import in_frame
from polymap_ros.hearing.odometry_error import OdometryError
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.warm_up import warm_up
from polymap_ros.parameters import Parameters, SensorParameters
from polymap_ros.simulation.trajectories import legs
from polymap_ros.simulation.waveforms import pings, simulate
from polymap_ros.solvers.checkpoint import Stopped

S = 1_000_000_000
START = 1_700_000_000 * S
NOISE = np.random.default_rng(0).normal(size=(20, 2048)).astype(np.float32)
SMALL = Parameters().replaced({
    'grid.range_step_m': 0.02, 'grid.angle_step_deg': 5.0, 'solver.iterations': 20, 'solver.method': 'paper'})


def adds_up(mapper):
    counts = mapper.counts
    return counts.received == counts.used + sum(counts.dropped.values()) + counts.waiting


def circling(mapper, count=12, frame_id='odom', first=0):
    """Feed a robot that drives in a circle and hears noise; a ping halfway between two poses."""
    for i in range(first, count):
        angle = 0.5 * i
        mapper.add_pose(START + i * S // 2, Pose(0.3 * np.cos(angle), 0.3 * np.sin(angle), angle), frame_id)
        mapper.add_ping(Ping(START + i * S // 2 + S // 4, NOISE[i], 1e-6))


def everything(mapper):
    """All that a mapper knows, comparable bit by bit."""
    return (
        mapper.beam_map.values.tobytes(), mapper.free_area.area, mapper.start_pose, mapper.frame_id,
        dataclasses.astuple(mapper.counts), mapper.parameters.flat(),
        [(each.stamp_ns, each.x, each.y, each.rho if each.rho == each.rho else None, each.echo.tobytes(),
          each.envelope.tobytes()) for each in mapper.soundings])


def driven(scene, reported, values):
    """A mapper that has taken a scene's pings with other poses than the true ones."""
    mapper = PolygonMapper(scene.parameters(Parameters()).replaced(values))
    for ping, pose in zip(pings(scene), reported, strict=True):
        mapper.add_pose(ping.emission_ns, Pose(*pose))
        mapper.add_ping(ping)
    mapper.finish()
    return mapper


@pytest.mark.parametrize(('error', 'told'), [
    (OdometryError(1.03), {'odometry.scale': 1.03}),
    (OdometryError(1.0, 3.0), {'odometry.yaw_drift_deg_m': 3.0}),
])
def test_what_is_known_of_the_odometry_is_taken_out_of_places_and_path(quadrilateral, error, told):
    scene, _ = quadrilateral
    scene = dataclasses.replace(scene, poses=scene.poses[::2], sensor=SensorParameters(x_m=0.03, y_m=-0.02))
    reported = _reported(scene.poses, error)
    wrong = driven(scene, reported, {'slam.mode': 'off'}).solve()
    assert wrong.cautions or wrong.polygon is None
    mapper = driven(scene, reported, {'slam.mode': 'off', **told})
    estimate = mapper.solve()
    assert (estimate.status, estimate.cautions) == ('closed', ())
    assert compare(estimate.polygon.vertices, scene.vertices).right
    np.testing.assert_allclose(mapper.path().poses[:, :2], scene.poses[:, :2], atol=1e-9)


def _reported(poses, error):
    """What an odometry with a steady error reports, pose by pose."""
    reported, turned = [poses[0]], 0.0
    for before, after in itertools.pairwise(poses):
        step = after[:2] - before[:2]
        more = np.deg2rad(error.yaw_drift_deg_m) * np.hypot(*step)
        turn = turned + 0.5 * more
        c, s = np.cos(turn), np.sin(turn)
        turned += more
        place = reported[-1][:2] + error.scale * np.array([[c, -s], [s, c]]) @ step
        reported.append(np.array((*place, after[2] + turned)))
    return np.array(reported)


def test_a_map_frame_that_begins_at_the_first_ping_keeps_coordinates_small(quadrilateral):
    scene, _ = quadrilateral
    utm = Pose(448_262.5, 5_411_932.0, 0.7)
    reported = in_frame(scene.poses[::2], utm)
    scene = dataclasses.replace(scene, poses=scene.poses[::2])
    near = driven(scene, reported, {'slam.map_frame': 'map', 'slam.map_origin': 'first_ping'})
    again = PolygonMapper.from_state(near.parameters, near.state())
    for mapper in (near, again):
        vertices = mapper.solve().polygon.vertices
        first = Pose(*scene.poses[0])
        np.testing.assert_allclose(first.apply(vertices), driven(scene, scene.poses, {}).solve().polygon.vertices,
                                   atol=1e-5)
        there = mapper.map_to_odom.inverse()
        np.testing.assert_allclose((there.x, there.y, there.yaw), reported[0], atol=1e-6)
        np.testing.assert_allclose(mapper.path().poses[0], 0.0, atol=1e-9)
    with pytest.raises(StateError, match=r'slam\.map_origin .first_ping., now it is .odom.'):
        PolygonMapper.from_state(near.parameters.replaced({'slam.map_origin': 'odom'}), near.state())


def test_what_an_earlier_version_did_not_know_counts_as_its_default(heard):
    state = heard.state()
    rows = state['parameters']
    state['parameters'] = rows[rows[:, 0] != 'slam.map_origin']
    del state['frame.origin']
    assert PolygonMapper.from_state(heard.parameters, state).origin == Pose(0.0, 0.0)


def test_a_plate_is_found_in_the_odometrys_frame(heard, quadrilateral):
    scene, _ = quadrilateral
    mapper = PolygonMapper.from_state(heard.parameters, heard.state())
    estimate = mapper.solve()
    assert (estimate.status, len(estimate.polygon.edges)) == ('closed', 4)
    comparison = compare(estimate.polygon.vertices, scene.vertices, offset_tolerance_m=0.01, angle_tolerance_rad=0.03)
    assert comparison.right
    assert comparison.iou > 0.97
    assert mapper.estimate is estimate
    assert (mapper.counts.received, mapper.counts.used, mapper.counts.dropped) == (60, 60, {})
    assert sum(edge.pings for edge in estimate.polygon.edges) >= 24


def test_the_start_frame_is_the_sensor_at_the_first_used_ping(heard, quadrilateral):
    scene, _ = quadrilateral
    x, y, yaw = scene.poses[0]
    assert dataclasses.astuple(heard.start_pose) == pytest.approx((x, y, yaw))
    assert (heard.soundings[0].x, heard.soundings[0].y) == pytest.approx((0.0, 0.0))
    back = heard.start_pose.apply(np.array([(each.x, each.y) for each in heard.soundings]))
    np.testing.assert_allclose(back, scene.poses[:, :2], atol=1e-12)


def test_a_moved_world_moves_the_answer_and_changes_nothing_inside(heard, quadrilateral):
    scene, samples = quadrilateral
    shift = Pose(-40.0, 7.0, 2.1)
    poses = np.column_stack((shift.apply(scene.poses[:, :2]), scene.poses[:, 2] + shift.yaw))
    moved = dataclasses.replace(scene, vertices=shift.apply(scene.vertices), poses=poses)
    mapper = PolygonMapper(heard.parameters)
    feed(mapper, moved, samples)
    np.testing.assert_allclose(mapper.beam_map.values, heard.beam_map.values, atol=1e-5)
    there, here = (PolygonMapper.from_state(each.parameters, each.state()).solve() for each in (mapper, heard))
    np.testing.assert_allclose(there.polygon.vertices, shift.apply(here.polygon.vertices), atol=1e-6)


def test_the_loudness_does_not_matter(heard, quadrilateral):
    scene, samples = quadrilateral
    mapper = PolygonMapper(heard.parameters)
    feed(mapper, scene, samples * np.float32(2.0**-20))
    np.testing.assert_allclose(mapper.beam_map.values, heard.beam_map.values, rtol=1e-5)


def test_the_sensor_is_placed_with_the_heading_at_the_ping():
    mapper = PolygonMapper(SMALL.replaced({'sensor.x_m': 0.2, 'sensor.y_m': -0.1}))
    for i in range(3):
        mapper.add_pose(START + i * S, Pose(1.0, 1.0, i * np.pi / 2))
    for i in range(3):
        mapper.add_ping(Ping(START + i * S, NOISE[i], 1e-6))
    mapper.add_ping(Ping(START + S // 2, NOISE[4], 1e-6))
    assert dataclasses.astuple(mapper.start_pose) == pytest.approx((1.2, 0.9, 0.0))
    places = [(each.x, each.y) for each in mapper.soundings]
    # In the odometry's frame (1.2, 0.9), turned by 90 degrees (1.1, 1.2), by 180 (0.8, 1.1), and by 45 in between.
    between = np.sqrt(0.5) * np.array((0.3, 0.1)) - (0.2, -0.1)
    np.testing.assert_allclose(places, [(0.0, 0.0), (-0.1, 0.3), (-0.4, 0.2), between], atol=1e-12)


def test_the_pose_is_taken_at_emission():
    mapper = PolygonMapper(SMALL)
    mapper.add_pose(START, Pose(0.0, 0.0))
    mapper.add_pose(START + S, Pose(1.0, 0.0))
    for stamp_s, t0_s in ((0.0, 0.0), (0.5, 0.0001), (0.5, -0.0001)):
        mapper.add_ping(Ping(START + round(stamp_s * S), NOISE[0], 1e-6, t0_s))
    assert [each.x for each in mapper.soundings] == pytest.approx([0.0, 0.4999, 0.5001], abs=1e-9)


def test_pings_ahead_of_their_odometry_wait_and_give_the_same_map():
    early, late = PolygonMapper(SMALL), PolygonMapper(SMALL)
    circling(early)
    for i in range(12):
        late.add_ping(Ping(START + i * S // 2 + S // 4, NOISE[i], 1e-6))
    assert (late.counts.waiting, late.start_pose, late.frame_id) == (12, None, '')
    for i in range(12):
        angle = 0.5 * i
        late.add_pose(START + i * S // 2, Pose(0.3 * np.cos(angle), 0.3 * np.sin(angle), angle))
    assert everything(late) == everything(early)
    assert late.counts.waiting == 1
    late.finish()
    assert (late.counts.dropped, late.counts.waiting) == ({'no_pose': 1}, 0)


def test_every_bad_ping_is_counted_under_its_reason_and_the_good_ones_are_used():
    mapper = PolygonMapper(SMALL)
    circling(mapper, 3)
    before = mapper.counts.used
    nan = NOISE[0].copy()
    nan[5] = np.nan
    for bad in (Ping(START + 1, nan, 1e-6), Ping(START + 2, 0.0 * NOISE[0], 1e-6), Ping(START + 3, NOISE[:2], 1e-6),
                Ping(START + 4, NOISE[0], 0.0), Ping(START + 5, NOISE[0, :9], 1e-6),
                Ping(START + 6, np.ones(2_000_000, np.float32), 1e-6), Ping(START - 7, NOISE[0], 1e-6),
                Ping(START + S // 4, NOISE[0], 1e-6), Ping(START + 500 * S, NOISE[0], 1e-6)):
        mapper.add_ping(bad)
    mapper.drop('wrong_type', 'a lidar scan')
    mapper.drop('paused')
    assert mapper.counts.dropped == {'bad_samples': 2, 'bad_shape': 2, 'too_short': 1, 'too_long': 1, 'no_pose': 1,
                                     'duplicate': 1, 'wrong_type': 1, 'paused': 1}
    assert mapper.counts.used == before
    assert mapper.counts.waiting == 2
    assert adds_up(mapper)
    assert mapper.intake.last_drop_texts['wrong_type'] == 'a lidar scan'
    told = mapper.intake.last_drop_texts['bad_samples']
    assert '1 of 2048' in told or 'zero' in told


def test_poses_out_of_order_or_of_another_frame_are_not_taken():
    mapper = PolygonMapper(SMALL)
    assert mapper.add_pose(START, Pose(0.0, 0.0), 'odom')
    assert not mapper.add_pose(START, Pose(0.0, 0.0), 'odom')
    assert not mapper.add_pose(START + S, Pose(0.0, 0.0), 'map')
    assert mapper.add_pose(START + S, Pose(0.0, 0.0), 'odom')
    assert mapper.frame_id == 'odom'


def test_nothing_heard_is_an_answer_too():
    for feed_first in (False, True):
        mapper = PolygonMapper(SMALL)
        if feed_first:
            circling(mapper, 3)
        estimate = mapper.solve()
        assert (estimate.status, [caution.code for caution in estimate.cautions]) == ('open', ['too_few_pings'])
        assert estimate.stamp_ns == (START + 3 * S // 4 if feed_first else 0)


@pytest.mark.parametrize('method', ['paper', 'rectangle'])
def test_a_straight_path_is_ambiguous_and_one_of_the_two_answers_may_be_the_truth(quadrilateral, method):
    scene, _ = quadrilateral
    middle = scene.vertices.mean(axis=0)
    straight = dataclasses.replace(scene, poses=legs((*(middle - (0.25, 0.0)), 0.0), [0.0], [0.5], 0.025))
    mapper = PolygonMapper(scene.parameters(Parameters()).replaced({'solver.method': method}))
    feed(mapper, straight, simulate(straight).astype(np.float32))
    estimate = mapper.solve()
    assert estimate.status == 'ambiguous'
    assert [caution.code for caution in estimate.cautions] == ['straight_path']
    assert estimate.polygon is None
    one, other = (candidate.vertices for candidate in estimate.alternatives)
    mirrored = other * (1.0, -1.0) + (0.0, 2.0 * middle[1])
    assert iou(one, mirrored) == pytest.approx(1.0)


def test_a_solve_can_be_watched_stopped_and_another_method_chosen(heard):
    mapper = PolygonMapper.from_state(heard.parameters, heard.state())
    seen = []

    def third_time():
        seen.append(mapper.estimate)
        if len(seen) == 3:
            raise Stopped

    with pytest.raises(Stopped):
        mapper.solve(third_time)
    assert seen == [None] * 3
    assert mapper.estimate is None
    assert mapper.solve().method == 'paper'
    mapper.configure(mapper.parameters.replaced({'solver.method': 'rectangle'}))
    assert mapper.estimate.method == 'paper'
    assert mapper.solve().method == 'rectangle'
    assert len(mapper.estimate.polygon.edges) == 4


def test_pings_during_a_solve_belong_to_the_next_one(heard, quadrilateral):
    scene, samples = quadrilateral
    mapper = PolygonMapper.from_state(heard.parameters, heard.state())
    expected = mapper.solve()
    stamp_ns = int(scene.stamps_ns[-1]) + S

    def one_more():
        mapper.add_pose(stamp_ns, Pose(*scene.poses[0].tolist()))
        if mapper.counts.received == 60:
            mapper.add_ping(Ping(stamp_ns, samples[0], 1e-6))

    mapper.solve(one_more)
    assert mapper.counts.used == 61
    np.testing.assert_array_equal(mapper.estimate.polygon.vertices, expected.polygon.vertices)
    assert mapper.estimate.stamp_ns == expected.stamp_ns
    assert mapper.solve().stamp_ns == stamp_ns


def test_reset_is_as_new():
    used, fresh = PolygonMapper(SMALL), PolygonMapper(SMALL)
    circling(used, 12, 'map')
    used.solve()
    used.reset()
    assert everything(used) == everything(fresh)
    assert used.estimate is None
    circling(used)
    circling(fresh)
    assert everything(used) == everything(fresh)


@pytest.mark.parametrize('cut', [0, 1, 2, 7, 12])
def test_a_saved_and_continued_map_is_that_of_an_uninterrupted_run(cut):
    whole, first = PolygonMapper(SMALL), PolygonMapper(SMALL)
    for mapper in (whole, first):
        mapper.drop('wrong_type', 'a lidar scan')
        mapper.add_ping(Ping(START + 100 * S, NOISE[0], 1e-6, frame_id='sensor'))
        circling(mapper, cut)
    file = io.BytesIO()
    np.savez(file, **first.state())
    file.seek(0)
    with np.load(file, allow_pickle=False) as saved:
        second = PolygonMapper.from_state(SMALL, dict(saved))
    assert everything(second) == everything(whole)
    circling(whole, 20, first=cut)
    circling(second, 20, first=cut)
    assert everything(second) == everything(whole)
    for one, other in zip(second.state().values(), whole.state().values(), strict=True):
        assert one.tobytes() == other.tobytes()
    solved, expected = second.solve(), whole.solve()
    assert (solved.cost, solved.status) == (expected.cost, expected.status)


def test_a_state_goes_on_under_a_clock_that_began_anew():
    """The map stays, the same stamps may come again; a ping that waits when the clock begins anew is lost."""
    mapper = PolygonMapper(SMALL)
    circling(mapper, 12)
    assert dataclasses.astuple(mapper.counts) == (12, 11, {}, 1)
    again = PolygonMapper.from_state(SMALL, mapper.state())
    circling(again, 11)
    assert dataclasses.astuple(again.counts) == (23, 21, {'no_pose': 1}, 1)
    assert again.beam_map.count == 21
    assert again.start_pose == mapper.start_pose
    assert again.places.last_ns == START + 9 * S // 2 + S // 4 < mapper.places.last_ns


def test_pings_wait_for_the_first_pose_after_a_restored_state():
    """The poses there may be of another clock: taken at once, the ping would be heard at a wrong place."""
    mapper = PolygonMapper(SMALL)
    circling(mapper, 4)
    again = PolygonMapper.from_state(SMALL, mapper.state())
    again.add_ping(Ping(START + S // 8, NOISE[5], 1e-6))
    assert (again.counts.used, again.counts.waiting) == (4 - 1, 2)
    again.add_pose(START + 2 * S, Pose(0.0, 0.0))
    assert (again.counts.used, again.counts.waiting) == (5, 0)


@pytest.mark.parametrize('anew', [False, True])
def test_a_ping_before_the_first_pose_of_a_restored_state_is_of_that_poses_clock(anew):
    """It has the stamp of one of the map's pings: under a clock that began anew it is another one."""
    mapper = PolygonMapper(SMALL)
    circling(mapper, 12)
    again = PolygonMapper.from_state(SMALL, mapper.state())
    again.add_ping(Ping(START + S // 8, NOISE[5], 1e-6))
    again.add_ping(Ping(START + S // 4, NOISE[6], 1e-6))
    twin = again.twin()
    for each in (again, twin):
        assert (each.counts.used, each.counts.waiting, each.counts.dropped) == (11, 3, {})
        for stamp_ns in (0, S // 4) if anew else (6 * S, 6 * S + S // 4):
            each.add_pose(START + stamp_ns, Pose(0.0, 0.0))
        expected = (14, 13, {'no_pose': 1}, 0) if anew else (14, 13, {'duplicate': 1}, 0)
        assert dataclasses.astuple(each.counts) == expected


def test_where_jumps_back_are_ignored_a_restored_state_takes_what_is_newer():
    ignoring = SMALL.replaced({'odometry.on_jump_back': 'ignore'})
    mapper, whole = PolygonMapper(ignoring), PolygonMapper(ignoring)
    circling(mapper, 12)
    circling(whole, 16)
    again = PolygonMapper.from_state(ignoring, mapper.state())
    circling(again, 16)
    assert everything(again)[:4] == everything(whole)[:4]
    assert again.counts.used == whole.counts.used == 15
    assert again.counts.dropped == {'duplicate': 12}


@pytest.mark.parametrize('change', [
    {'grid.range_step_m': 0.01}, {'medium.thickness_m': 0.005}, {'pulse.cycles': 3.0}, {'sensor.x_m': 0.1},
    {'echo.kind': 'envelope'}, {'echo.blanking_m': 0.1}, {'echo.t0_s': 1e-5}])
def test_a_state_of_other_parameters_is_refused_by_name(change):
    mapper = PolygonMapper(SMALL)
    circling(mapper, 3)
    name, value = next(iter(change.items()))
    with pytest.raises(StateError, match=f'{name} .*{value}'):
        PolygonMapper.from_state(SMALL.replaced(change), mapper.state())


def test_a_state_outlives_changes_that_do_not_matter():
    mapper = PolygonMapper(SMALL)
    circling(mapper, 3)
    changed = SMALL.replaced({'solver.method': 'rectangle', 'map.margin_m': 1.0, 'odometry.max_gap_s': 2.0})
    assert len(PolygonMapper.from_state(changed, mapper.state()).soundings) == 2


@pytest.mark.parametrize('damage', [
    lambda state: state.pop('version'), lambda state: state.update(version=np.array(99)),
    lambda state: state.pop('soundings.echoes'), lambda state: state.update({'soundings.echoes': np.zeros((2, 3))}),
    lambda state: state.update({'soundings.places': np.full((2, 3), np.inf)}),
    lambda state: state.update({'frame.start': np.zeros((2, 3))}),
    lambda state: state.update({'frame.start': np.full((1, 3), np.nan)}),
    lambda state: state.update({'parameters': np.zeros(3)}),
    lambda state: state.update({'queue.counts': np.array(['x', 'y'])}),
    lambda state: state.update({'queue.counts': np.array([9, 9, 9])}),
    lambda state: state.update({'queue.counts': np.full(2, 2**63 - 1)}),
    lambda state: state.update({'track.outliers': np.array(1e308)}),
    lambda state: state.update({'free_area.discs': np.full((2, 3), 5e-324)}),
    lambda state: state.update({'places.last_ns': np.array(2**63 - 1)}),
    lambda state: state.update({'queue.waiting_ends': np.array([-5])}),
    lambda state: state.update({'track.stamps_ns': np.array(['a'])}),
    lambda state: state.update({'beam_map.total': np.zeros((3, 3))}),
    lambda state: state.update({'beam_map.count': np.zeros(2)}),
    lambda state: state.update({'free_area.united': np.zeros(0, np.uint8)}),
    lambda state: [state.pop(name) for name in list(state) if name.startswith('track.')],
])
def test_a_damaged_state_is_refused(damage):
    mapper = PolygonMapper(SMALL)
    circling(mapper, 3)
    state = mapper.state()
    damage(state)
    with pytest.raises(StateError):
        PolygonMapper.from_state(SMALL, state)


def test_a_recorded_pulse_is_used():
    parameters = SMALL.replaced({'pulse.kind': 'file', 'pulse.path': 'pulse.npy'})
    pulse = np.sin(2 * np.pi * 0.1 * np.arange(20)) * np.hanning(20)
    burst, recorded = PolygonMapper(SMALL), PolygonMapper(parameters, pulse)
    circling(burst)
    circling(recorded)
    ratio = recorded.beam_map.normalised() / burst.beam_map.normalised()
    assert np.median(ratio) == pytest.approx(1.0, abs=0.2)
    assert everything(recorded) != everything(burst)


@pytest.mark.parametrize('changes', [
    {}, {'echo.kind': 'envelope', 'medium.model': 'constant', 'solver.method': 'rectangle'},
    {'grid.range_max_m': 0.09, 'grid.range_step_m': 5e-5, 'grid.angle_min_deg': 80.0, 'grid.angle_max_deg': 100.0,
     'medium.model': 'constant', 'medium.speed_m_s': 1480.0, 'pulse.frequency_hz': 1.9e6, 'echo.blanking_m': 0.03}])
def test_after_warming_up_nothing_is_left_to_compile(changes, heard):
    numba = pytest.importorskip('numba')
    parameters = Parameters().replaced(changes)
    warm_up(parameters)
    from polymap_ros.geometry import overlap
    from polymap_ros.maps import beamforming
    from polymap_ros.solvers.paper import annealing

    kernels = [each for module in (annealing, beamforming, overlap) for each in vars(module).values()
               if isinstance(each, numba.core.dispatcher.Dispatcher)]
    before = [len(each.signatures) for each in kernels]
    assert sum(before) > 3
    mapper = PolygonMapper(Parameters())
    circling(mapper)
    mapper.solve()
    assert [len(each.signatures) for each in kernels] == before
