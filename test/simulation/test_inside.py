"""Holes and inner walls of simulated scenes: what a file may say of them, and echoes against the mapper's tracer."""

import dataclasses

import numpy as np
import pytest
import shapely

from polymap_ros.errors import SceneError
from polymap_ros.geometry.lines import polygon_lines
from polymap_ros.geometry.path_room import room_for_paths
from polymap_ros.geometry.paths import trace_paths
from polymap_ros.geometry.sides import Interior, sides_of
from polymap_ros.geometry.storey import Storey
from polymap_ros.parameters import SensorParameters
from polymap_ros.simulation.inside import Hole, Partition
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.scenes import Scene
from polymap_ros.simulation.waveforms import Synthesis, emitted, make_medium, noise_free

OUTLINE = np.array([[0.0, 0.0], [1.5, 0.1], [1.4, 1.2], [0.2, 1.0]])
HOLE = np.array([[0.6, 0.4], [0.55, 0.7], [0.9, 0.75], [0.95, 0.45]])  # clockwise
SEAM = Partition([1.0, 0.2], [1.1, 1.0], -0.6, 0.7)
POSES = np.array([[0.3, 0.3, 0.0], [1.25, 0.9, 1.0], [0.4, 0.85, 2.0], [1.2, 0.3, -2.0]])
ROOM = 'vertices: [[0, 1], [1, 1], [1, 0], [0, 0]]\n'
HERE = 'poses: [[0.2, 0.2, 0]]\n'


def scene_with(**changes):
    return Scene('inside', OUTLINE, POSES, order=3, reflection=(0.9, 0.8, -0.7, 1.0), **changes)


def echoes_of_the_mapper_s_tracer(scene):
    """Samples (T, n) by `trace_paths`, which knows sides of walls instead of every sequence."""
    holes, inner = scene.holes, scene.inner_walls
    lines = [polygon_lines(scene.vertices), *(polygon_lines(hole.vertices) for hole in holes)]
    reflection = np.concatenate([scene.reflection, *(hole.reflection for hole in holes)])
    spans = []
    for wall in inner:
        (r, theta), = polygon_lines([wall.start, wall.end])[:1]
        lines.append([(r, theta)])
        spans.append([*(y * np.cos(theta) - x * np.sin(theta) for x, y in (wall.start, wall.end)), wall.transmission])
    reflection = np.append(reflection, [wall.reflection for wall in inner])
    interior = Interior(np.array([len(hole.vertices) for hole in holes], np.int64), np.reshape(spans, (-1, 3)))
    bound, sides = sides_of(np.vstack(lines), interior, 1e-9)
    assert bound
    synthesis, samples = Synthesis(make_medium(scene.medium), emitted(scene), scene.n_samples, scene.period_s), []
    for emitter, receiver in zip(*scene.ends, strict=True):
        paths, ends = room_for_paths(scene.order), np.array([*emitter, *receiver, scene.sensor.baseline_z_m])
        count = trace_paths(sides, ends, scene.order, 10.0, 1e-9, False, Storey().images(scene.order), paths)
        length, amplitude = 2.0 * paths.half[:count], paths.weight[:count].copy()
        for m in range(count):
            amplitude[m] *= reflection[paths.walls[m, :paths.hits[m]]].prod()
        samples.append(synthesis(length, amplitude))
    return np.array(samples)


@pytest.mark.parametrize(('holes', 'inner_walls'), [
    ((Hole(HOLE, (0.5, 0.9, -0.8, 1.0)),), ()),
    ((), (SEAM,)),
    ((Hole(HOLE),), (SEAM, Partition([0.2, 0.5], [0.45, 0.6], 0.4))),
], ids=['hole', 'inner wall', 'both'])
@pytest.mark.parametrize('sensor', [SensorParameters(), SensorParameters(
    x_m=0.02, baseline_x_m=0.05, baseline_y_m=-0.03, baseline_z_m=0.04)], ids=['at the emitter', 'beside it'])
def test_echoes_are_those_of_the_mapper_s_tracer(holes, inner_walls, sensor):
    scene = scene_with(holes=holes, inner_walls=inner_walls, sensor=sensor)
    found, expected = noise_free(scene), echoes_of_the_mapper_s_tracer(scene)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())
    plain = noise_free(dataclasses.replace(scene, holes=(), inner_walls=()))
    assert np.abs(found - plain).max(axis=1).min() > 0.05 * np.abs(plain).max()


def test_every_key_of_holes_and_inner_walls_arrives(tmp_path):
    path = tmp_path / 'plate.yaml'
    path.write_text(ROOM + HERE + '''
holes:
- [[0.4, 0.4], [0.5, 0.4], [0.5, 0.5]]
- {vertices: [[0.6, 0.4], [0.6, 0.5], [0.8, 0.4]], reflection: [0.1, 0.2, 0.3]}
- {centre: [0.7, 0.8], radius_m: 0.05, reflection: -0.5}
- {centre: [0.5, 0.8], radius_m: 0.05}
inner_walls:
- {start: [0.3, -5.0], end: [0.3, 0.9], reflection: -0.6}
- {end: [0.7, 0.7], start: [0.9, 0.7], reflection: 0.5, transmission: 0.25}
''')
    scene = load_scene(path)
    np.testing.assert_array_equal(scene.holes[0].vertices, [[0.5, 0.5], [0.5, 0.4], [0.4, 0.4]])
    np.testing.assert_array_equal(scene.holes[0].reflection, [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(scene.holes[1].vertices, [[0.6, 0.4], [0.6, 0.5], [0.8, 0.4]])
    np.testing.assert_array_equal(scene.holes[1].reflection, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(scene.circles, [[0.7, 0.8, 0.05, -0.5], [0.5, 0.8, 0.05, 1.0]])
    assert shapely.Polygon(scene.holes[2].vertices).area == pytest.approx(np.pi * 0.05**2)
    long, short = scene.inner_walls
    np.testing.assert_allclose([long.start, long.end], [[0.3, 0.0], [0.3, 0.9]])  # cut off at the outline
    assert (long.reflection, long.transmission) == (-0.6, pytest.approx(0.8))
    np.testing.assert_array_equal([short.start, short.end], [[0.9, 0.7], [0.7, 0.7]])
    assert (short.reflection, short.transmission) == (0.5, 0.25)
    again = dataclasses.replace(scene, seed=5)
    np.testing.assert_array_equal(noise_free(scene), noise_free(again))


def test_an_inner_wall_ends_at_a_hole():
    scene = scene_with(holes=(HOLE,), inner_walls=(Partition([0.7, 0.6], [0.7, 0.8], 0.5),))
    wall, = scene.inner_walls
    assert shapely.Polygon(HOLE).distance(shapely.Point(wall.start)) < 1e-9
    np.testing.assert_array_equal(wall.end, [0.7, 0.8])


def test_a_drawn_way_goes_round_holes_and_over_inner_walls(tmp_path):
    path = tmp_path / 'plate.yaml'
    path.write_text(ROOM + '''
holes: [[[0.4, 0.4], [0.6, 0.4], [0.6, 0.6], [0.4, 0.6]]]
inner_walls: [{start: [0.0, 0.7], end: [1.0, 0.7], reflection: 0.4}]
trajectory: {pings: 40, step_m: 0.1, clearance_m: 0.06}
''')
    scene = load_scene(path)
    assert shapely.LineString(scene.positions).distance(shapely.Polygon(scene.holes[0].vertices)) > 0.05
    assert 5 < np.sum(scene.positions[:, 1] > 0.7) < 35


SQUARE = '[[0.4, 0.4], [0.6, 0.4], [0.6, 0.6], [0.4, 0.6]]'
WALL = 'start: [0.4, 0.3], end: [0.6, 0.3]'


@pytest.mark.parametrize(('text', 'word'), [
    ('holes: 3', 'holes must be a list'),
    ('holes: [3]', r'holes\[0\]: vertices must be at least 3'),
    ('holes: [[[0.4, 0.4], [0.6, 0.4]]]', r'holes\[0\]: vertices must be at least 3'),
    ('holes: [[[0.4, 0.4], [0.6, 0.6], [0.6, 0.4], [0.4, 0.6]]]', r'holes\[0\]: edges of the polygon cross'),
    ('holes: [{reflection: 0.3}]', r'holes\[0\] needs vertices'),
    (f'holes: [{{vertices: {SQUARE}, reflektion: 0.3}}]', 'no key reflektion; did you mean reflection'),
    (f'holes: [{{vertices: {SQUARE}, reflection: 1.3}}]', r'holes\[0\]: reflection must be'),
    ('holes: [[[1.4, 1.4], [1.6, 1.4], [1.6, 1.6]]]', r'holes\[0\]: is not inside the outline, or meets it; move it'),
    ('holes: [[[0.4, 0.4], [1.6, 0.4], [0.6, 0.6]]]', r'holes\[0\]: is not inside'),
    ('holes: [[[0.0, 0.4], [0.6, 0.4], [0.6, 0.6]]]', r'holes\[0\]: is not inside'),
    (f'holes: [{SQUARE}, [[0.5, 0.5], [0.8, 0.5], [0.8, 0.8]]]', r'holes\[1\]: meets holes\[0\]; move one'),
    (f'holes: [{SQUARE}, [[0.45, 0.45], [0.55, 0.45], [0.5, 0.55]]]', r'holes\[1\]: meets holes\[0\]'),
    ('holes: [[[0.1, 0.1], [0.3, 0.1], [0.3, 0.3], [0.1, 0.3]]]', r'the sensor is in holes\[0\] at pose 0; move'),
    ('inner_walls: {start: 1}', 'inner_walls must be a list'),
    ('inner_walls: [3]', r'inner_walls\[0\] must be a mapping'),
    ('inner_walls: [{start: [0.4, 0.3]}]', r'inner_walls\[0\] needs end and reflection'),
    (f'inner_walls: [{{{WALL}, reflection: 0.3, through: 1}}]', r'inner_walls\[0\] has no key through'),
    (f'inner_walls: [{{{WALL}, reflection: -1.1}}]', r'inner_walls\[0\]: reflection must be from -1 to 1'),
    (f'inner_walls: [{{{WALL}, reflection: 0.1, transmission: 1.1}}]', r'\[0\]: transmission must be'),
    (f'inner_walls: [{{{WALL}, reflection: a}}]', r'inner_walls\[0\]: reflection must be a number'),
    ('inner_walls: [{start: [0.4], end: [0.6, 0.3], reflection: 0.3}]', r'\[0\]: start must be a finite pair'),
    ('inner_walls: [{start: [0.4, 0.3], end: [0.4, 0.3], reflection: 0.3}]', r'\[0\]: start and end are one'),
    ('inner_walls: [{start: [1.4, 0.3], end: [2.4, 0.3], reflection: 0.3}]', r'\[0\]: is not inside'),
    (f'holes: [{SQUARE}]\ninner_walls: [{{start: [0.5, 0.1], end: [0.5, 0.9], reflection: 0.3}}]', 'in one piece'),
    ('inner_walls: [{start: [0, 0.1], end: [0, 0.9], reflection: 0.3}]', r'inner_walls\[0\]: lies on an edge'),
    ('inner_walls: [{start: [0.1, 0.2], end: [0.9, 0.2], reflection: 0.3}]', r'on inner_walls\[0\] at pose 0; move'),
    ('holes: [{centre: [0.5, 0.5]}]', r'holes\[0\] needs radius_m'),
    ('holes: [{radius_m: 0.1, vertices: 1, centre: 0}]', r'holes\[0\] has no key vertices'),
    ('holes: [{centre: [0.5], radius_m: 0.1}]', r'holes\[0\]: centre must be a finite pair'),
    ('holes: [{centre: [0.5, 0.5], radius_m: 0}]', r'holes\[0\]: radius_m must be above 0'),
    ('holes: [{centre: [0.5, 0.5], radius_m: 0.1, reflection: 2}]', r'holes\[0\]: reflection of a round hole must be'),
    ('holes: [{centre: [0.5, 0.5], radius_m: 0.6}]', r'holes\[0\]: is not inside'),
    ('holes: [{centre: [0.3, 0.2], radius_m: 0.15}]', r'the sensor is in holes\[0\] at pose 0; move'),
    ('edge_fading: fresnel\nholes: [{centre: [0.5, 0.5], radius_m: 0.1}]', 'edge_fading does not go with round holes'),
    (f'holes: [{SQUARE}]\nedges: {{kind: free}}', 'edges acts in scenes without holes'),
    (f'holes: [{SQUARE}]\nmedium: {{model: constant}}\nheight: {{floor_m: 1}}', 'height acts in scenes without holes'),
    (f'inner_walls: [{{{WALL}, reflection: 0.1}}]\norder: 30', 'order 30 makes .* sequences of 5 walls.*lower order'),
])
def test_what_is_wrong_with_what_is_inside_is_said(tmp_path, text, word):
    path = tmp_path / 'plate.yaml'
    path.write_text(f'{ROOM}{HERE}{text}\n')
    with pytest.raises(SceneError, match=word) as caught:
        load_scene(path)
    assert 'plate.yaml' in str(caught.value)


def test_a_recorded_way_is_not_fitted_round_holes(tmp_path):
    path = tmp_path / 'plate.yaml'
    path.write_text(f'{ROOM}holes: [{SQUARE}]\ntrajectory: {{recording: drive, pings: 9, clearance_m: 0.1}}\n')
    with pytest.raises(SceneError, match='rooms without holes only; give legs'):
        load_scene(path, lambda *_: np.zeros((3, 3)))
