"""The evidence solver through the mapper, on samples: right, as sure as it says, the same again, and never silent."""

import dataclasses

import numpy as np
import pytest
from heard_scenes import listen
from scipy.signal import hilbert

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.lines import iou, polygon_lines
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters, PulseParameters, SensorParameters
from polymap_ros.simulation.clearance import clearance
from polymap_ros.simulation.doubtful_scenes import KINDS
from polymap_ros.simulation.random_scenes import air_filled, lossy, random_scene
from polymap_ros.simulation.waveforms import simulate
from polymap_ros.solvers.evidence import drift
from polymap_ros.solvers.evidence.search import Search


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
def test_random_rooms_are_right_and_as_exact_as_they_say(seed, edges, snr_db):
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


def test_the_same_evidence_gives_the_same_bytes_whether_watched_or_not(hexagon):
    scene, _, first, state = hexagon
    parameters = scene.parameters(Parameters())
    assert written(PolygonMapper.from_state(parameters, state).solve()) == written(first)
    steps = []
    watched = PolygonMapper.from_state(parameters, state).solve(lambda: steps.append(1))
    assert len(steps) > 20
    assert written(watched) == written(first)


def test_one_ping_more_is_cheap_and_still_right(hexagon):
    scene, samples, full, _ = hexagon
    mapper = listen(scene, samples, 59)
    steps = []
    for count in (59, 60):
        if count == 60:
            stamp_ns = int(scene.stamps_ns[59])
            mapper.add_pose(stamp_ns, Pose(*scene.poses[59].tolist()))
            mapper.add_ping(Ping(stamp_ns, samples[59], scene.period_s))
        steps.append(0)

        def one_more(steps=steps):
            steps[-1] += 1

        mapper.solve(one_more)
        assert compare(mapper.estimate.polygon.vertices, scene.vertices).right
    assert steps[1] < 0.5 * steps[0]
    assert mapper.estimate.stamp_ns == full.stamp_ns
    np.testing.assert_allclose(mapper.estimate.polygon.vertices, full.polygon.vertices, atol=5e-5)
    assert codes(mapper.estimate) == []


def test_moving_the_odometrys_frame_moves_the_answer(hexagon):
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
def test_the_loudness_does_not_matter(factor, hexagon):
    scene, samples, expected, _ = hexagon
    estimate = listen(scene, samples * np.float32(factor)).solve()
    np.testing.assert_allclose(estimate.polygon.vertices, expected.polygon.vertices, atol=1e-6)


def test_a_room_seen_in_a_mirror_gives_the_mirror_image(hexagon):
    scene, samples, expected, _ = hexagon
    mirrored = dataclasses.replace(scene, vertices=scene.vertices * (1.0, -1.0), poses=scene.poses * (1.0, -1.0, -1.0))
    estimate = listen(mirrored, samples).solve()
    assert compare(estimate.polygon.vertices, mirrored.vertices).right
    assert iou(estimate.polygon.vertices * (1.0, -1.0), expected.polygon.vertices) > 0.9999


def test_walls_that_turn_the_sign_and_absorb_are_found_too():
    reflection = np.array([0.9, -0.6, 1.0, -0.8, 0.7])
    scene = dataclasses.replace(random_scene(117, 5), reflection=reflection)
    estimate = listen(scene).solve()
    assert compare(estimate.polygon.vertices, scene.vertices).right
    assert np.abs(errors(estimate, scene)[0]).max() < 0.15e-3


def test_a_wall_that_is_hardly_heard_at_first_order_is_found_by_trying_all_lines():
    scene = dataclasses.replace(random_scene(36, 7), snr_db=-10.0)
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices).right


@pytest.mark.parametrize(('seed', 'negative'), [(0, 4), (2, 1)])
def test_rooms_that_turn_the_sign_are_heard_in_phase(seed, negative):
    """Whichever sign most walls have."""
    scene = lossy(random_scene(seed, 6))
    assert np.sum(scene.reflection < 0.0) == negative
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices).right
    assert np.abs(errors(estimate, scene)[0]).max() < 0.15e-3


@pytest.mark.parametrize(('edges', 'order', 'reflection'), [(5, 4, 1.0), (6, 8, 0.85)])
def test_no_answer_hinges_on_where_a_simulator_stops(edges, order, reflection):
    scene = dataclasses.replace(random_scene(100, edges), order=order, reflection=reflection)
    estimate = listen(scene).solve()
    assert compare(estimate.polygon.vertices, scene.vertices).right
    assert {caution.code for caution in estimate.cautions} <= {'unheard_corner'}


def test_emitter_and_receiver_apart_are_no_error():
    scene = dataclasses.replace(random_scene(5, 5), sensor=SensorParameters(baseline_x_m=0.06, baseline_z_m=0.1))
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices).right
    assert np.abs(errors(estimate, scene)[0]).max() < 0.15e-3


def lengths(estimate):
    vertices = estimate.polygon.vertices
    return np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1)


def test_a_chirp_in_air_is_heard_without_slivers():
    """No edge is shorter than half a wavelength: it would reflect as a point does."""
    scene = air_filled(random_scene(0, 5), 'chirp')
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices, 0.01).right
    assert lengths(estimate).min() > 0.5 * 343.0 / 20e3


def test_a_chirp_in_a_plate_is_right():
    pulse = PulseParameters(kind='chirp', frequency_hz=1e5, bandwidth_hz=6e4, duration_s=5e-5)
    scene = dataclasses.replace(random_scene(3, 4), pulse=pulse)
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices).right


def test_magnitudes_are_enough_without_phase():
    """``echo.kind: envelope``: by power alone, and no word of phases."""
    scene = air_filled(random_scene(0, 4))
    magnitudes = np.abs(hilbert(simulate(scene), axis=1)).astype(np.float32)
    estimate = listen(scene, magnitudes, changes={'echo.kind': 'envelope'}).solve()
    assert (estimate.status, codes(estimate)) == ('closed', [])
    assert compare(estimate.polygon.vertices, scene.vertices, 0.01).right
    assert all(edge.likelihood > 0.9 for edge in estimate.polygon.edges)


def test_a_search_that_failed_waits_for_a_tenth_more_pings(hexagon, monkeypatch):
    """Where no lines close, every ping would else cost a whole search."""
    scene, samples, _, _ = hexagon
    searched = []
    monkeypatch.setattr(Search, 'polygons', lambda self, *_: iter([searched.append(len(self.data.positions))]))
    monkeypatch.setattr(Search, 'not_convex', lambda *_: iter(()))
    monkeypatch.setattr(drift, 'windows', lambda *_: iter(()))
    mapper = listen(scene, samples, 20)
    for k in range(20, 25):
        assert mapper.solve().status == 'open'
        stamp_ns = int(scene.stamps_ns[k])
        mapper.add_pose(stamp_ns, Pose(*scene.poses[k]))
        mapper.add_ping(Ping(stamp_ns, samples[k], scene.period_s))
    first, second = dict.fromkeys(searched)
    assert first == 20
    assert 22 <= second <= 23


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


def test_forgetting_starts_from_scratch(hexagon):
    """Another room after a reset: the first one is no hint."""
    scene, samples, expected, _ = hexagon
    mapper = listen(random_scene(103, 4))
    mapper.solve()
    mapper.reset()
    for stamp_ns, pose, row in zip(scene.stamps_ns.tolist(), scene.poses.tolist(), samples, strict=True):
        mapper.add_pose(stamp_ns, Pose(*pose))
        mapper.add_ping(Ping(stamp_ns, row, scene.period_s))
    assert written(mapper.solve()) == written(expected)


@pytest.mark.parametrize(('edges', 'seed', 'width'), [(5, 410, 0.05), (6, 411, 0.03), (4, 415, 0.03), (3, 408, 0.03)])
def test_of_a_polygon_and_its_mirror_image_the_better_one_is_found(edges, seed, width):
    """A path hardly wider than a straight one: power cannot tell the two apart, phase can."""
    scene = KINDS['straight'].make(seed, edges).scene
    poses = scene.poses.copy()
    along = poses[-1, :2] - poses[0, :2]
    poses[:, :2] += 0.5 * width * np.outer(np.sin(np.linspace(0.0, 3.0 * np.pi, len(poses))), (-along[1], along[0]))
    estimate = listen(dataclasses.replace(scene, poses=poses)).solve()
    assert codes(estimate) == []
    assert compare(estimate.polygon.vertices, scene.vertices).right


@pytest.mark.parametrize(('edges', 'seed'), [(3, 6002), (4, 6004), (8, 6006)])
def test_an_edge_as_short_as_two_pulses_is_found(edges, seed):
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
