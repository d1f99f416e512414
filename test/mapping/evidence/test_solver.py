"""The evidence solver through the mapper, on samples: right, as sure as it says, the same again, and never silent."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import hilbert

from polymap_ros.acoustics.ping import Ping
from polymap_ros.mapping.comparison import compare
from polymap_ros.mapping.evidence import search
from polymap_ros.mapping.evidence.search import Search
from polymap_ros.mapping.lines import iou, polygon_lines
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.pose import Pose
from polymap_ros.parameters import Parameters, PulseParameters, SensorParameters
from polymap_ros.simulation.doubtful_scenes import KINDS
from polymap_ros.simulation.random_scenes import air_filled, lossy, random_scene
from polymap_ros.simulation.scenes import Scene, clearance
from polymap_ros.simulation.trajectories import legs
from polymap_ros.simulation.waveforms import simulate


@pytest.fixture(scope='module')
def listen(feed):
    """A mapper that has heard a scene, or the first pings of it."""

    def mapper_of(scene, samples=None, count=None, changes=None):
        mapper = PolygonMapper(scene.parameters(Parameters()).replaced(changes or {}))
        samples = simulate(scene).astype(np.float32) if samples is None else samples
        part = dataclasses.replace(scene, poses=scene.poses[:count])
        feed(mapper, part, samples[:count])
        return mapper

    return mapper_of


@pytest.fixture(scope='module')
def hexagon(listen):
    """A scene of six edges, its samples, its first answer (by sixty pings) and the mapper's state before that."""
    scene = random_scene(107, 6)
    samples = simulate(scene).astype(np.float32)
    mapper = listen(scene, samples)
    state = mapper.state()
    return scene, samples, mapper.solve(), state


def codes(estimate):
    return [caution.code for caution in estimate.cautions]


def written(estimate):
    """All that an answer says, as bytes."""
    edges = np.array([dataclasses.astuple(edge) for edge in estimate.polygon.edges])
    return estimate.polygon.vertices.tobytes(), edges.tobytes(), estimate.cost, estimate.stamp_ns, estimate.cautions


def errors(estimate, scene):
    """Offsets at the true edges' middles [m], and the errors of r and theta over their standard deviations.

    The latter in the frame whose origin is the first position, about which the path is.
    """
    origin = Pose(*scene.positions[0], 0.0).inverse()
    moved, truth = estimate.polygon.moved(origin), polygon_lines(origin.apply(scene.vertices))
    edges = [min(moved.edges, key=lambda edge: abs(np.angle(np.exp(1j * (edge.theta - theta))))) for _, theta in truth]
    r = [(edge.r - line[0]) / edge.r_std for edge, line in zip(edges, truth, strict=True)]
    theta = [np.angle(np.exp(1j * (edge.theta - line[1]))) / edge.theta_std
             for edge, line in zip(edges, truth, strict=True)]
    return compare(estimate.polygon.vertices, scene.vertices).offsets_m, np.array(r), np.array(theta)


@pytest.mark.parametrize(('seed', 'edges', 'snr_db'), [
    (101, 3, 0.0), (103, 4, 0.0), (105, 5, 0.0), (107, 6, 0.0), (109, 7, 0.0), (111, 8, 0.0), (113, 4, -10.0),
    (115, 7, -10.0)])
def test_random_rooms_are_right_and_as_exact_as_they_say(seed, edges, snr_db, listen):
    scene = dataclasses.replace(random_scene(seed, edges), snr_db=snr_db)
    estimate = listen(scene).solve()
    assert (estimate.status, estimate.method, codes(estimate)) == ('closed', 'evidence', [])
    comparison = compare(estimate.polygon.vertices, scene.vertices)
    assert comparison.right
    assert comparison.iou > 0.999
    offsets, r, theta = errors(estimate, scene)
    assert np.abs(offsets).max() < (0.15e-3 if snr_db == 0.0 else 0.5e-3)
    assert max(np.abs(r).max(), np.abs(theta).max()) < 5.0
    assert np.sqrt(np.mean(np.concatenate((r, theta)) ** 2)) < 2.0
    for edge in estimate.polygon.edges:
        assert edge.likelihood > 0.95
        assert edge.pings > 0
    origin = estimate.polygon.moved(Pose(*scene.positions[0], 0.0).inverse())
    assert all(3e-6 < edge.r_std < 5e-4 for edge in origin.edges)
    assert all(3e-6 < edge.theta_std < 2e-3 for edge in origin.edges)
    assert 0.1 < estimate.iou_free_area < 1.0


def test_the_same_evidence_gives_the_same_bytes_in_slices_of_any_size(hexagon):
    scene, _, first, state = hexagon
    parameters = scene.parameters(Parameters())
    assert written(PolygonMapper.from_state(parameters, state).solve()) == written(first)
    sliced = PolygonMapper.from_state(parameters, state)
    sliced.begin_solve()
    assert sliced.preview().status == 'open'
    assert codes(sliced.preview()) == ['unfinished']
    steps = 1
    while not sliced.advance(1):
        steps += 1
    assert steps > 20
    assert written(sliced.estimate) == written(first)


def test_one_ping_more_is_cheap_and_still_right(hexagon, listen):
    scene, samples, full, _ = hexagon
    mapper = listen(scene, samples, 59)
    steps = []
    for count in (59, 60):
        if count == 60:
            stamp_ns = int(scene.stamps_ns[59])
            mapper.add_pose(stamp_ns, Pose(*scene.poses[59].tolist()))
            mapper.add_ping(Ping(stamp_ns, samples[59], scene.period_s))
        mapper.begin_solve()
        steps.append(1)
        while not mapper.advance(1):
            steps[-1] += 1
        assert compare(mapper.estimate.polygon.vertices, scene.vertices).right
    assert steps[1] < 0.5 * steps[0]
    assert mapper.estimate.stamp_ns == full.stamp_ns
    np.testing.assert_allclose(mapper.estimate.polygon.vertices, full.polygon.vertices, atol=5e-5)
    assert codes(mapper.estimate) == []


def test_moving_the_odometrys_frame_moves_the_answer(hexagon, listen):
    scene, samples, here, _ = hexagon
    shift = Pose(-40.0, 7.0, 2.1)
    poses = np.column_stack((shift.apply(scene.poses[:, :2]), scene.poses[:, 2] + shift.yaw))
    there = listen(dataclasses.replace(scene, vertices=shift.apply(scene.vertices), poses=poses), samples).solve()
    assert there.status == 'closed'
    expected = shift.apply(here.polygon.vertices)
    nearest = np.hypot(*(there.polygon.vertices[:, None] - expected).T).min(axis=0)
    assert len(there.polygon.edges) == 6
    assert nearest.max() < 1e-6
    assert sorted(edge.theta_std for edge in there.polygon.edges) == pytest.approx(
        sorted(edge.theta_std for edge in here.polygon.edges), rel=1e-3)


@pytest.mark.parametrize('factor', [2.0**-20, 1e6])
def test_the_loudness_does_not_matter(factor, hexagon, listen):
    scene, samples, expected, _ = hexagon
    estimate = listen(scene, samples * np.float32(factor)).solve()
    np.testing.assert_allclose(estimate.polygon.vertices, expected.polygon.vertices, atol=1e-6)


def test_a_room_seen_in_a_mirror_gives_the_mirror_image(hexagon, listen):
    scene, samples, expected, _ = hexagon
    mirrored = dataclasses.replace(scene, vertices=scene.vertices * (1.0, -1.0), poses=scene.poses * (1.0, -1.0, -1.0))
    estimate = listen(mirrored, samples).solve()
    assert compare(estimate.polygon.vertices, mirrored.vertices).right
    assert iou(estimate.polygon.vertices * (1.0, -1.0), expected.polygon.vertices) > 0.9999


def test_walls_that_turn_the_sign_and_absorb_are_found_too(listen):
    reflection = np.array([0.9, -0.6, 1.0, -0.8, 0.7])
    scene = dataclasses.replace(random_scene(117, 5), reflection=reflection)
    estimate = listen(scene).solve()
    assert compare(estimate.polygon.vertices, scene.vertices).right
    assert np.abs(errors(estimate, scene)[0]).max() < 0.15e-3


def test_a_wall_that_is_hardly_heard_at_first_order_is_found_by_trying_all_lines(listen):
    scene = dataclasses.replace(random_scene(36, 7), snr_db=-10.0)
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices).right


@pytest.mark.parametrize(('seed', 'negative'), [(0, 4), (2, 1)])
def test_rooms_that_turn_the_sign_are_heard_in_phase(seed, negative, listen):
    """Whichever sign most walls have."""
    scene = lossy(random_scene(seed, 6))
    assert np.sum(scene.reflection < 0.0) == negative
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices).right
    assert np.abs(errors(estimate, scene)[0]).max() < 0.15e-3


def test_emitter_and_receiver_apart_are_no_error(listen):
    scene = dataclasses.replace(random_scene(5, 5), sensor=SensorParameters(baseline_x_m=0.06, baseline_z_m=0.1))
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices).right
    assert np.abs(errors(estimate, scene)[0]).max() < 0.15e-3


def lengths(estimate):
    vertices = estimate.polygon.vertices
    return np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1)


def test_a_chirp_in_air_is_heard_without_slivers(listen):
    """No edge is shorter than half a wavelength: it would reflect as a point does."""
    scene = air_filled(random_scene(0, 5), 'chirp')
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices, 0.01).right
    assert lengths(estimate).min() > 0.5 * 343.0 / 20e3


def test_a_chirp_in_a_plate_is_right(listen):
    pulse = PulseParameters(kind='chirp', frequency_hz=1e5, bandwidth_hz=6e4, duration_s=5e-5)
    scene = dataclasses.replace(random_scene(3, 4), pulse=pulse)
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices).right


def test_magnitudes_are_enough_without_phase(listen):
    """``echo.kind: envelope``: by power alone, and no word of phases."""
    scene = air_filled(random_scene(0, 4))
    magnitudes = np.abs(hilbert(simulate(scene), axis=1)).astype(np.float32)
    estimate = listen(scene, magnitudes, changes={'echo.kind': 'envelope'}).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices, 0.01).right
    assert all(edge.likelihood > 0.9 for edge in estimate.polygon.edges)


def test_a_second_mode_is_told_as_what_is_not_explained(listen):
    """S0 10 dB below A0: the polygon is right, and a tenth of what was heard is something else."""
    doubtful = KINDS['mode_-10db'].make(0, 4)
    scene = dataclasses.replace(doubtful.scene, poses=doubtful.scene.poses[:20])
    estimate = listen(scene, simulate(scene, doubtful.clean[:20]).astype(np.float32)).solve()
    assert (estimate.status, codes(estimate)) == ('closed', ['unexplained'])
    assert compare(estimate.polygon.vertices, scene.vertices).right


def test_what_is_unexplained_may_need_more_edges_than_are_allowed(hexagon, listen):
    scene, samples, _, _ = hexagon
    estimate = listen(scene, samples, changes={'solver.max_edges': 5}).solve()
    told, = [caution.text for caution in estimate.cautions if caution.code == 'unexplained']
    assert told.endswith('it has all the edges that solver.max_edges allows (5)')


def test_a_search_that_failed_waits_for_a_tenth_more_pings(hexagon, listen, monkeypatch):
    """Where no lines close, every ping would else cost a whole search."""
    scene, samples, _, _ = hexagon
    searched = []
    monkeypatch.setattr(Search, 'start', lambda self, strength: searched.append(len(self.data.positions)))
    mapper = listen(scene, samples, 20)
    for k in range(20, 25):
        assert mapper.solve().status == 'open'
        stamp_ns = int(scene.stamps_ns[k])
        mapper.add_pose(stamp_ns, Pose(*scene.poses[k]))
        mapper.add_ping(Ping(stamp_ns, samples[k], scene.period_s))
    first, second = dict.fromkeys(searched)
    assert first == 20
    assert 22 <= second <= 23


@pytest.mark.parametrize('count', [0, 1, 2])
def test_too_few_pings_are_said_to_be_too_few(count, hexagon, listen):
    scene, samples, _, _ = hexagon
    mapper = listen(scene, samples, count) if count else PolygonMapper(Parameters())
    estimate = mapper.solve()
    assert (estimate.status, codes(estimate)) == ('open', ['too_few_pings'])
    assert estimate.polygon is None


def is_wall(edge, truth, offset_m=0.01, angle_rad=0.02):
    """Which true lines an edge is close to."""
    turn = np.abs(np.angle(np.exp(1j * (edge.theta - truth[:, 1]))))
    return (np.abs(edge.r - truth[:, 0]) < offset_m) & (turn < angle_rad)


@pytest.mark.parametrize('count', [3, 5, 8, 12])
def test_few_pings_are_not_sure_of_more_than_they_heard(count, hexagon, listen):
    """What is called certain is a wall; on a straight path none is, for it may be its own mirror image."""
    scene, samples, _, _ = hexagon
    estimate = listen(scene, samples, count).solve()
    truth = polygon_lines(scene.vertices)
    found = estimate.walls + (estimate.polygon.edges if estimate.polygon else ())
    sure = [edge for edge in found if edge.likelihood >= 0.9]
    assert all(np.any(is_wall(edge, truth)) for edge in sure)
    if 'straight_path' in codes(estimate):  # whether so few pings name any wall at all is a matter of rounding
        assert all(edge.likelihood <= 0.5 for edge in found)
    else:
        assert sure
    assert (estimate.status == 'closed') == (count >= 8)


def straight(scene, length=0.5):
    middle = scene.vertices.mean(axis=0)
    start = (*(middle - (length / 2.0, 0.0)), 0.0)
    return dataclasses.replace(scene, poses=legs(start, [0.0], [length], length / 40.0))


@pytest.mark.parametrize('edges', [3, 5])
def test_a_straight_path_cannot_tell_sides(edges, listen):
    scene = straight(random_scene(119, edges))
    estimate = listen(scene).solve()
    assert 'straight_path' in codes(estimate)
    assert estimate.polygon is None
    assert estimate.status in ('ambiguous', 'open')
    if estimate.status == 'ambiguous':
        assert sum(compare(each.vertices, scene.vertices).right for each in estimate.alternatives) == 1
    else:
        assert estimate.walls


@pytest.mark.parametrize('silent', range(3))
def test_a_wall_that_is_not_heard_leaves_the_polygon_open(silent, listen):
    scene = dataclasses.replace(random_scene(121, 3), reflection=np.where(np.arange(3) == silent, 0.0, 1.0))
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)[0]) == ('open', 'not_closed')
    assert estimate.polygon is None
    found = np.any([is_wall(wall, polygon_lines(scene.vertices)) for wall in estimate.walls], axis=0)
    assert set(np.flatnonzero(found)) == {0, 1, 2} - {silent}
    assert len(estimate.walls) == 2


def test_parallel_walls_do_not_meet(listen):
    """A rectangle of which three walls are heard: the sides, off by 0.1 mrad, meet kilometres away."""
    vertices = np.array([(0.0, 0.0), (1.1, 0.0), (1.1, 0.8), (0.0, 0.8)])
    scene = Scene('silent', vertices, legs((0.3, 0.2, 0.3), [0.0, 1.4, 2.3], [0.5, 0.4, 0.4], 0.03),
                  reflection=np.array([1.0, 1.0, 0.0, 1.0]), seed=121)
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)[0]) == ('open', 'not_closed')
    truth = polygon_lines(vertices)[[0, 1, 3]]
    assert np.all(np.any([is_wall(wall, truth) for wall in estimate.walls], axis=0))


@pytest.mark.parametrize(('n_samples', 'range_max_m'), [(800, np.inf), (2048, 1.2)])
def test_pings_that_end_before_the_range_axis_are_no_silence(n_samples, range_max_m, hexagon):
    scene, samples, _, _ = hexagon
    mapper = PolygonMapper(scene.parameters(Parameters()))
    for stamp_ns, pose, row in zip(scene.stamps_ns.tolist(), scene.poses.tolist(), samples, strict=True):
        mapper.add_pose(stamp_ns, Pose(*pose))
        mapper.add_ping(Ping(stamp_ns, row[:n_samples], scene.period_s, range_max_m=range_max_m))
    estimate = mapper.solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices).right


@pytest.mark.parametrize('changes', [{'grid.range_max_m': 0.03}, {'echo.blanking_m': 2.99}, {'grid.range_max_m': 0.1}])
def test_what_is_heard_too_near_or_not_at_all_is_no_room(changes, hexagon, feed):
    scene, samples, _, _ = hexagon
    mapper = PolygonMapper(scene.parameters(Parameters()).replaced(changes))
    feed(mapper, dataclasses.replace(scene, poses=scene.poses[:12]), samples[:12])
    estimate = mapper.solve()
    assert estimate.status == 'open'
    assert estimate.polygon is None


def test_noise_alone_is_no_room():
    generator = np.random.default_rng(5)
    mapper = PolygonMapper(Parameters())
    for i in range(30):
        mapper.add_pose(10**8 * i, Pose(*generator.uniform(0.0, 0.5, 2), 0.0))
        mapper.add_ping(Ping(10**8 * i, generator.normal(size=2048).astype(np.float32), 1e-6))
    estimate = mapper.solve()
    assert estimate.status == 'open'
    assert estimate.polygon is None
    assert estimate.walls == ()


def test_forgetting_starts_from_scratch(hexagon, listen):
    """Another room after a reset: the first one is no hint."""
    scene, samples, expected, _ = hexagon
    mapper = listen(random_scene(103, 4))
    mapper.solve()
    mapper.reset()
    for stamp_ns, pose, row in zip(scene.stamps_ns.tolist(), scene.poses.tolist(), samples, strict=True):
        mapper.add_pose(stamp_ns, Pose(*pose))
        mapper.add_ping(Ping(stamp_ns, row, scene.period_s))
    assert written(mapper.solve()) == written(expected)


@pytest.mark.parametrize(('edges', 'seed'), [(5, 410), (6, 411), (4, 415)])
def test_one_ping_aside_of_a_straight_path_does_not_tell_sides(edges, seed, listen):
    """The other 59 explain the mirror image as well as anything has to be explained."""
    scene = KINDS['straight'].make(seed, edges).scene
    poses = scene.poses.copy()
    first, last = poses[0, :2], poses[-1, :2]
    across = np.array([first[1] - last[1], last[0] - first[0]])
    poses[30, :2] += 0.025 * across
    estimate = listen(dataclasses.replace(scene, poses=poses)).solve()
    assert estimate.status != 'closed'
    assert 'straight_path' in codes(estimate)


@pytest.mark.parametrize(('edges', 'seed', 'width'), [(5, 410, 0.05), (6, 411, 0.03), (4, 415, 0.03), (3, 408, 0.03)])
def test_of_a_polygon_and_its_mirror_image_the_better_one_is_found(edges, seed, width, listen):
    """A path hardly wider than a straight one: power cannot tell the two apart, phase can."""
    scene = KINDS['straight'].make(seed, edges).scene
    poses = scene.poses.copy()
    along = poses[-1, :2] - poses[0, :2]
    poses[:, :2] += 0.5 * width * np.outer(np.sin(np.linspace(0.0, 3.0 * np.pi, len(poses))), (-along[1], along[0]))
    estimate = listen(dataclasses.replace(scene, poses=poses)).solve()
    assert codes(estimate) == []
    assert compare(estimate.polygon.vertices, scene.vertices).right


@pytest.mark.parametrize(('edges', 'seed'), [(5, 223), (7, 400), (4, 415), (5, 416)])
def test_a_wall_that_is_silent_is_missed_by_magnitudes_too(edges, seed, listen):
    scene = air_filled(KINDS['unheard'].make(seed, edges).scene)
    magnitudes = np.abs(hilbert(simulate(scene), axis=1)).astype(np.float32)
    estimate = listen(scene, magnitudes, changes={'echo.kind': 'envelope'}).solve()
    assert estimate.status == 'open'
    assert 'not_closed' in codes(estimate)


@pytest.mark.parametrize(('places', 'seed'), [(3, 602), (3, 611), (4, 614), (4, 600)])
def test_places_that_repeat_make_no_wall_certain_that_is_not_there(places, seed, listen):
    scene = random_scene(seed, (3, 4, 5, 6, 7, 8)[seed % 6])
    chosen = np.repeat(np.linspace(0, 59, places).astype(int), 60 // places)
    estimate = listen(dataclasses.replace(scene, poses=scene.poses[chosen])).solve()
    truth = polygon_lines(scene.vertices)
    assert estimate.polygon is None or compare(estimate.polygon.vertices, scene.vertices).right
    assert all(np.any(is_wall(edge, truth)) for edge in estimate.walls)


@pytest.mark.parametrize(('edges', 'seed'), [(4, 902), (6, 908), (8, 914), (7, 900), (7, 910)])
def test_beside_a_straight_path_a_silent_wall_leaves_the_polygon_open(edges, seed, listen):
    """Not two polygons of which neither is true, and no wall that may be its own mirror image."""
    scene = KINDS['straight'].make(seed, edges).scene
    reflection = np.where(np.arange(edges) == seed // 2 % edges, 0.0, 1.0)
    estimate = listen(dataclasses.replace(scene, reflection=reflection)).solve()
    assert (estimate.status, estimate.alternatives) == ('open', ())
    assert codes(estimate)[:2] == ['straight_path', 'not_closed']
    truth = polygon_lines(scene.vertices)
    assert all(np.any(is_wall(wall, truth, 0.02, 2.0 * wall.theta_std)) for wall in estimate.walls)


@pytest.mark.parametrize(('edges', 'seed'), [(3, 6002), (4, 6004), (7, 6004)])
def test_an_edge_as_short_as_two_pulses_is_found(edges, seed, listen):
    """A corner cut off by 3 cm, on which hardly a ping has its foot."""
    scene = random_scene(seed, edges)
    vertices = None
    for corner in np.random.default_rng([seed, edges]).permutation(edges):
        before, at, after = scene.vertices[[corner - 1, corner, (corner + 1) % edges]]
        ends = [(to - at) / np.linalg.norm(to - at) for to in (before, after)]
        ends = at + 0.03 / np.linalg.norm(ends[0] - ends[1]) * np.array(ends)
        vertices = np.vstack((scene.vertices[:corner], ends, scene.vertices[corner + 1:]))
        if clearance(vertices, scene.positions).min() > 0.02:
            break
    estimate = listen(dataclasses.replace(scene, vertices=vertices, reflection=1.0)).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert len(estimate.polygon.edges) == edges + 1
    assert compare(estimate.polygon.vertices, vertices).right


def test_an_edge_that_brings_next_to_nothing_is_weak(hexagon, listen, monkeypatch):
    """What is predicted a little wrong can buy an edge: were all of it that uncertain, no edge would be sure."""
    scene, samples, _, _ = hexagon
    monkeypatch.setattr(search, '_MISFIT', 1.0)
    estimate = listen(scene, samples).solve()
    assert codes(estimate) == ['weak_edge']
    assert all(edge.likelihood < 0.01 for edge in estimate.polygon.edges)
