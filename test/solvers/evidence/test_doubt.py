"""What the evidence solver does not know, it says: no wall that is not there is certain, nothing silently wrong."""

import dataclasses
import re

import numpy as np
import pytest
from heard_scenes import feed, listen
from scipy.signal import hilbert

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.doubtful_scenes import KINDS
from polymap_ros.simulation.random_scenes import Recipe, air_filled, random_scene
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.trajectories import legs
from polymap_ros.simulation.waveforms import simulate
from polymap_ros.solvers.evidence import ground
from polymap_ros.solvers.evidence.answer import CERTAIN

EXACT = {'slam.mode': 'off'}
"""Where the odometry is not what is in question, it is not looked into, which takes tens of seconds where nothing else
explains the echoes either."""


def codes(estimate):
    return [caution.code for caution in estimate.cautions]


def test_a_second_mode_is_told_as_what_is_not_explained():
    """S0 10 dB below A0: the polygon is right, and a tenth of what was heard is something else."""
    doubtful = KINDS['mode_-10db'].make(0, 4)
    scene = dataclasses.replace(doubtful.scene, poses=doubtful.scene.poses[:20])
    estimate = listen(scene, simulate(scene, doubtful.clean[:20]).astype(np.float32)).solve()
    assert (estimate.status, codes(estimate)) == ('closed', ['unexplained'])
    assert compare(estimate.polygon.vertices, scene.vertices).right


def test_what_is_unexplained_may_need_more_edges_than_are_allowed(hexagon):
    scene, samples, _, _ = hexagon
    estimate = listen(scene, samples, changes={'solver.max_edges': 5, **EXACT}).solve()
    told, = [caution.text for caution in estimate.cautions if caution.code == 'unexplained']
    assert told.endswith(' with all the edges that solver.max_edges allows (5); raise solver.max_edges')


def test_that_more_edges_are_certain_than_are_allowed_is_told():
    """Five walls are heard by themselves, and no polygon of four explains half of the echoes."""
    estimate = listen(load_scene('pentagon'), changes={'solver.max_edges': 4, **EXACT}).solve()
    assert estimate.status == 'open'
    assert len(estimate.walls) == 5
    told, = [caution.text for caution in estimate.cautions if caution.code == 'not_closed']
    assert told == '5 walls are certain, but solver.max_edges allows 4; raise solver.max_edges'


@pytest.mark.parametrize('count', [0, 1, 2])
def test_too_few_pings_are_said_to_be_too_few(count, hexagon):
    scene, samples, _, _ = hexagon
    mapper = listen(scene, samples, count) if count else PolygonMapper(Parameters())
    estimate = mapper.solve()
    assert (estimate.status, codes(estimate)) == ('open', ['too_few_pings'])
    assert estimate.polygon is None


def is_wall(edge, truth, offset_m=0.01, angle_rad=0.02):
    """Which true lines an edge is close to."""
    turn = np.abs(np.angle(np.exp(1j * (edge.theta - truth[:, 1]))))
    return (np.abs(edge.r - truth[:, 0]) < offset_m) & (turn < angle_rad)


@pytest.mark.parametrize('count', [3, 5, 10, 12])
def test_few_pings_are_not_sure_of_more_than_they_heard(count, hexagon):
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
    assert (estimate.status == 'closed') == (count >= 10)


def straight(scene, length=0.5):
    middle = scene.vertices.mean(axis=0)
    start = (*(middle - (length / 2.0, 0.0)), 0.0)
    return dataclasses.replace(scene, poses=legs(start, [0.0], [length], length / 40.0))


@pytest.mark.parametrize('edges', [3, 5])
def test_a_straight_path_cannot_tell_sides(edges):
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
def test_a_wall_that_is_not_heard_leaves_the_polygon_open(silent):
    scene = dataclasses.replace(random_scene(121, 3), reflection=np.where(np.arange(3) == silent, 0.0, 1.0))
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)[0]) == ('open', 'not_closed')
    assert estimate.polygon is None
    found = np.any([is_wall(wall, polygon_lines(scene.vertices)) for wall in estimate.walls], axis=0)
    assert set(np.flatnonzero(found)) == {0, 1, 2} - {silent}
    assert len(estimate.walls) == 2


def test_parallel_walls_do_not_meet():
    """A rectangle of which three walls are heard: the sides, off by 0.1 mrad, meet kilometres away."""
    vertices = np.array([(0.0, 0.0), (1.1, 0.0), (1.1, 0.8), (0.0, 0.8)])
    scene = Scene('silent', vertices, legs((0.3, 0.2, 0.3), [0.0, 1.4, 2.3], [0.5, 0.4, 0.4], 0.03),
                  reflection=np.array([1.0, 1.0, 0.0, 1.0]), seed=121)
    estimate = listen(scene).solve()
    assert (estimate.status, codes(estimate)[0]) == ('open', 'not_closed')
    truth = polygon_lines(vertices)[[0, 1, 3]]
    assert np.all(np.any([is_wall(wall, truth) for wall in estimate.walls], axis=0))


@pytest.mark.parametrize('changes', [{'grid.range_max_m': 0.03}, {'echo.blanking_m': 2.99}, {'grid.range_max_m': 0.1}])
def test_what_is_heard_too_near_or_not_at_all_is_no_room(changes, hexagon):
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


@pytest.mark.parametrize(('edges', 'seed'), [(5, 410), (6, 411), (4, 415)])
def test_one_ping_aside_of_a_straight_path_does_not_tell_sides(edges, seed):
    """The other 59 explain the mirror image as well as anything has to be explained."""
    scene = KINDS['straight'].make(seed, edges).scene
    poses = scene.poses.copy()
    first, last = poses[0, :2], poses[-1, :2]
    across = np.array([first[1] - last[1], last[0] - first[0]])
    poses[30, :2] += 0.025 * across
    estimate = listen(dataclasses.replace(scene, poses=poses)).solve()
    assert estimate.status != 'closed'
    assert 'straight_path' in codes(estimate)


@pytest.mark.parametrize(('edges', 'seed', 'slam'), [(5, 223, EXACT), (7, 400, {}), (4, 415, {}), (5, 416, {})])
def test_a_wall_that_is_silent_is_missed_by_magnitudes_too(edges, seed, slam):
    scene = air_filled(KINDS['unheard'].make(seed, edges).scene)
    magnitudes = np.abs(hilbert(simulate(scene), axis=1)).astype(np.float32)
    estimate = listen(scene, magnitudes, changes={'echo.kind': 'envelope', **slam}).solve()
    assert estimate.status == 'open'
    assert 'not_closed' in codes(estimate)


@pytest.mark.parametrize(('edges', 'seed'), [(3, 600), (4, 600), (5, 602), (5, 604)])
def test_magnitudes_of_a_plate_prove_no_edge(edges, seed):
    """Dispersion draws echoes out, which is not what the likelihood looks for: a polygon may be wrong altogether."""
    scene = random_scene(seed, edges)
    magnitudes = np.abs(hilbert(simulate(scene), axis=1)).astype(np.float32)
    estimate = listen(scene, magnitudes, changes={'echo.kind': 'envelope'}).solve()
    assert 'dispersion' in codes(estimate)
    assert estimate.walls == ()
    assert max(edge.likelihood for edge in estimate.polygon.edges) < CERTAIN


@pytest.mark.parametrize(('places', 'seed', 'slam'), [(3, 602, {}), (3, 611, EXACT), (4, 614, EXACT), (4, 600, {})])
def test_places_that_repeat_make_no_wall_certain_that_is_not_there(places, seed, slam):
    scene = random_scene(seed, (3, 4, 5, 6, 7, 8)[seed % 6])
    chosen = np.repeat(np.linspace(0, 59, places).astype(int), 60 // places)
    estimate = listen(dataclasses.replace(scene, poses=scene.poses[chosen]), changes=slam).solve()
    truth = polygon_lines(scene.vertices)
    assert estimate.polygon is None or compare(estimate.polygon.vertices, scene.vertices).right
    assert all(np.any(is_wall(edge, truth)) for edge in estimate.walls)


@pytest.mark.parametrize(('edges', 'seed'), [(4, 902), (6, 908), (8, 914), (7, 900), (7, 910)])
def test_beside_a_straight_path_a_silent_wall_leaves_the_polygon_open(edges, seed):
    """Not two polygons of which neither is true, and no wall that may be its own mirror image."""
    scene = KINDS['straight'].make(seed, edges).scene
    reflection = np.where(np.arange(edges) == seed // 2 % edges, 0.0, 1.0)
    estimate = listen(dataclasses.replace(scene, reflection=reflection)).solve()
    assert (estimate.status, estimate.alternatives) == ('open', ())
    assert codes(estimate)[:2] == ['straight_path', 'not_closed']
    truth = polygon_lines(scene.vertices)
    assert all(np.any(is_wall(wall, truth, 0.02, 2.0 * wall.theta_std)) for wall in estimate.walls)


def test_an_edge_that_brings_next_to_nothing_is_weak(hexagon, monkeypatch):
    """What is predicted a little wrong can buy an edge: were all of it that uncertain, no edge would be sure."""
    scene, samples, _, _ = hexagon
    monkeypatch.setattr(ground, 'MISFIT', 1.0)
    estimate = listen(scene, samples).solve()
    assert codes(estimate) == ['weak_edge']
    assert all(edge.likelihood < 0.01 for edge in estimate.polygon.edges)


@pytest.mark.parametrize('seed', [4, 12])
def test_a_tip_that_no_echo_comes_from_is_not_vouched_for(seed):
    """Cut off askew by 5 cm, it gives the same echoes, of five orders, as whole: the answer is one of the two."""
    whole = random_scene(seed, 3, Recipe(shape='needle'))
    sides = np.roll(whole.vertices, -1, axis=0) - whole.vertices
    tip = int(np.argmax([a @ b / np.linalg.norm(a) / np.linalg.norm(b)
                         for a, b in zip(sides, -np.roll(sides, 1, axis=0), strict=True)]))
    one, other = sides[tip] / np.linalg.norm(sides[tip]), -sides[tip - 1] / np.linalg.norm(sides[tip - 1])
    ends = whole.vertices[tip] + 0.05 / np.linalg.norm(other - 2.0 * one) * np.array([other, 2.0 * one])
    cut = dataclasses.replace(whole, reflection=1.0, vertices=np.vstack((
        whole.vertices[:tip], ends, whole.vertices[tip + 1:])))
    for scene in (whole, cut):
        estimate = listen(scene).solve()
        assert estimate.status == 'closed'
        assert codes(estimate) == ['unheard_corner']
        told = re.search(r'corner (\d) \(up to ([\d.]+) (mm|m) of it', estimate.cautions[0].text)
        corner, up_to, unit = told.groups()
        assert np.linalg.norm(whole.vertices[tip] - estimate.polygon.vertices[int(corner)]) < 0.01
        assert float(up_to) * {'mm': 1e-3, 'm': 1.0}[unit] > 0.03
