import numpy as np
import pytest

from polymap_ros.errors import SceneError
from polymap_ros.simulation.clearance import audible_feet, clearance
from polymap_ros.simulation.scene_file import built_in_scenes, load_scene

ROOM = 'vertices: [[0, 1], [1, 1], [1, 0], [0, 0]]\n'


def write(folder, text, name='room.yaml'):
    (folder / name).write_text(text)
    return str(folder / name)


def test_every_key_of_a_scene_file_arrives(tmp_path):
    scene = load_scene(write(tmp_path, ROOM + '''
poses: [[0.5, 0.5, 0.0], [0.6, 0.5, 1.5]]
medium: {model: constant, speed_m_s: 343}
pulse: {kind: chirp, frequency_hz: 20000.0, bandwidth_hz: 10000.0, duration_s: 0.001}
told_medium: {model: constant, speed_m_s: 340}
sensor: {x_m: 0.1, baseline_x_m: 0.05}
grid: {range_max_m: 2.0}
sample_rate_hz: 2e5
n_samples: 512
t0_s: 1.0e-5
echo_kind: envelope
snr_db: null
order: 3
reflection: [1.0, -0.5, 0.25, 0.125]
seed: 7
ping_period_s: 0.1
odometry_rate_hz: 30
gain_range_db: 6.0
position_noise_m: 0.005
faults: {missing_first: 0.2, clutter: 10}
'''))
    assert scene.name == 'room'
    np.testing.assert_array_equal(scene.vertices, [[0, 0], [1, 0], [1, 1], [0, 1]])
    np.testing.assert_array_equal(scene.reflection, [0.25, -0.5, 1.0, 0.125])
    np.testing.assert_array_equal(scene.poses, [[0.5, 0.5, 0.0], [0.6, 0.5, 1.5]])
    assert (scene.medium.model, scene.medium.speed_m_s, scene.pulse.duration_s) == ('constant', 343.0, 0.001)
    assert (scene.sensor.x_m, scene.grid.range_max_m, scene.sample_rate_hz, scene.n_samples) == (0.1, 2.0, 2e5, 512)
    assert (scene.t0_s, scene.snr_db, scene.order, scene.seed, scene.ping_period_s) == (1e-5, None, 3, 7, 0.1)
    assert (scene.odometry_rate_hz, scene.gain_range_db, scene.position_noise_m) == (30.0, 6.0, 0.005)
    parameters = scene.parameters()
    assert (scene.faults.missing_first, scene.faults.clutter) == (0.2, 10.0)
    assert parameters['medium.speed_m_s'] == 340.0
    assert parameters['sensor.baseline_x_m'] == 0.05
    assert parameters['pulse.kind'] == 'chirp'
    assert (parameters['echo.t0_s'], parameters['echo.kind']) == (1e-5, 'envelope')
    assert parameters['sensor.x_m'] == 0.1
    assert parameters['grid.range_max_m'] == 2.0


def test_a_trajectory_of_legs(tmp_path):
    path = write(tmp_path, ROOM + 'trajectory: {start: [0.2, 0.3, 90], legs: [[-90, 0.2], [90, 0.1]], step_m: 0.1}')
    np.testing.assert_allclose(load_scene(path).poses, [
        [0.2, 0.3, 0.0], [0.3, 0.3, 0.0], [0.4, 0.3, 0.0], [0.4, 0.4, np.pi / 2]], atol=1e-12)


def test_a_drawn_trajectory_follows_from_the_seed(tmp_path):
    text = ROOM + 'trajectory: {pings: 30, step_m: 0.1, clearance_m: 0.1}\n'
    first, again = (load_scene(write(tmp_path, text + 'seed: 3')) for _ in range(2))
    np.testing.assert_array_equal(first.poses, again.poses)
    assert first.poses.shape == (30, 3)
    assert clearance(first.vertices, first.positions).min() >= 0.1 - 1e-9
    assert not np.allclose(load_scene(write(tmp_path, text + 'seed: 4')).poses, first.poses)


def test_a_recorded_trajectory_fills_the_room(tmp_path):
    asked = []

    def read_path(path, topic):
        asked.append((path, topic))
        return np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 1.0, 1.5], [5.0, 8.0, 1.0]])

    scene = load_scene(write(tmp_path, ROOM + '''
trajectory: {recording: drive, topic: /wheels, pings: 20, clearance_m: 0.1, turn_deg: 30}
'''), read_path)
    assert asked == [(tmp_path / 'drive', '/wheels')]
    assert len(scene.poses) == 20
    assert clearance(scene.vertices, scene.positions).min() == pytest.approx(0.1)


@pytest.mark.parametrize(('text', 'word'), [
    ('vertices: [[0, 0', 'YAML'),
    ('- 1', 'mapping'),
    (ROOM, 'poses or trajectory'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\ntrajectory: {pings: 3, step_m: 0.1, clearance_m: 0.1}', 'either'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nsnr: 3', 'did you mean snr_db'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nmedium: {thicknes_m: 3}', 'did you mean thickness_m'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nmedium: {thickness_m: -3}', 'medium.thickness_m'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nmedium: 3', 'medium must be a mapping'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nfaults: {cluter: 3}', 'did you mean clutter'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nfaults: {missing_first: 20}', 'faults.missing_first'),
    (ROOM + 'poses: [[0.01, 0.5, 0]]\nsensor: {baseline_x_m: 0.05}', 'not inside the polygon at pose 0'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\norder: 1.5', 'order must be an integer'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\norder: 0', 'order'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nn_samples: .inf', 'n_samples must be an integer'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nsample_rate_hz: fast', 'sample_rate_hz must be a number'),
    (ROOM + 'poses: [[0.5, 0.5, 0], [0.5]]', 'poses must be numbers'),
    (ROOM + 'poses: [[0.5, .nan, 0]]', 'poses must be finite'),
    (ROOM + 'poses: [[2.5, 0.5, 0]]', 'not inside the polygon at pose 0'),
    ('vertices: [[0, 1], [1, 1]]\ntrajectory: {pings: 3, step_m: 0.1, clearance_m: 0.1}', 'vertices'),
    (ROOM + 'trajectory: {pings: 30, step_m: 0.1, clearance_m: 0.6}', 'no path of 30 pings'),
    (ROOM + 'trajectory: {pings: 30, step_m: 0.1}', 'clearance_m must be a number'),
    (ROOM + 'trajectory: {pings: 3, step_m: 0.1, clearence_m: 0.1}', 'no key clearence_m; did you mean clearance_m'),
    (ROOM + 'trajectory: {leg: [[0, 0.2]], start: [0.5, 0.5, 0], step_m: 0.1}', 'no key leg; did you mean legs'),
    (ROOM + 'trajectory: {recording: drive, pings: 30, clearance_m: 0.1}', 'recording cannot be read'),
    (ROOM + 'trajectory: {legs: [[0, 1]], start: [0.5, 0.5], step_m: 0.1}', 'start must be'),
    (ROOM + 'trajectory: {legs: [[0, -1]], start: [0.5, 0.5, 0], step_m: 0.1}', 'lengths above 0'),
    (ROOM + 'trajectory: {legs: [[0, 0.2]], start: [0.5, 0.5, 0], step_m: 1e-9}', r'a trajectory of 2e\+08 pings'),
    (ROOM + 'trajectory: {legs: [[0, 1e300]], start: [0.5, 0.5, 0], step_m: 0.1}', 'a trajectory of'),
    (ROOM + 'trajectory: {pings: -3, step_m: 0.1, clearance_m: 0.1}', 'a trajectory of -3 pings'),
    (ROOM + 'trajectory: {pings: 1000000000, step_m: 0.1, clearance_m: 0.1}', r'a trajectory of 1e\+09 pings'),
    (ROOM + 'trajectory: {pings: 3, step_m: 0, clearance_m: 0.1}', 'step_m must be above 0'),
    (ROOM + 'trajectory: {pings: 3, step_m: .nan, clearance_m: 0.1}', 'step_m must be a number'),
    (ROOM + 'trajectory: {recording: drive, pings: 0, clearance_m: 0.1}', 'a trajectory of 0 pings'),
    (ROOM + 'trajectory: {recording: drive, pings: 3, clearance_m: 0.1, turn_deg: .inf}', 'recording|turn_deg'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nseed: -1', 'seed must be from 0'),
    (ROOM + 'trajectory: {pings: 3, step_m: 0.1, clearance_m: 0.1}\nseed: -1', 'seed must be from 0'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nsnr_db: -1e5', 'snr_db must be from -300 to 300'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nsample_rate_hz: 1e-300', 'sample_rate_hz must be from'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nn_samples: 1000000000000', 'n_samples must be from'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\norder: 1000000000', 'order must be from'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nping_period_s: 1e12', 'ping_period_s must be from'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nodometry_rate_hz: 1.0e+300', 'odometry_rate_hz must be from'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nodometry_rate_hz: 1.0e+9', r'makes 5e\+08 messages'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nt0_s: 1.0e+300', 't0_s must be from'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nt0_s: -50.0', 'would stamp the first ping -48.5 s'),
    (ROOM + f'poses: {[[0.5, 0.5, 0]] * 3000}\nping_period_s: 1e6\nodometry_rate_hz: 1e-6', 'no stamp of ROS'),
    (ROOM + f'poses: {[[0.5, 0.5, 0]] * 3000}\nn_samples: 1000000', '3000 pings of 1000000 samples'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\ngain_range_db: 1.0e+300', 'gain_range_db must be from'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nposition_noise_m: 1.0e+300', 'position_noise_m must be from'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nfaults: {direct_wave: 1.0e+308}', 'faults.direct_wave'),
    (ROOM + 'poses: [[0.5, 0.5, 0]]\nfaults: {odometry_scale: 1.0e+300}', 'faults.odometry_scale'),
    ('vertices: [[0, 0], [1e200, 0], [0, 1e200]]\nposes: [[1e199, 1e199, 0]]', 'polygon|within'),
])
def test_what_is_wrong_with_a_scene_file_is_said(tmp_path, text, word):
    with pytest.raises(SceneError, match=word) as caught:
        load_scene(write(tmp_path, text))
    assert 'room.yaml' in str(caught.value)
    assert '\n' not in str(caught.value)


def test_an_unknown_scene_lists_the_built_in_ones():
    with pytest.raises(SceneError, match=r'nowhere: .*l_shape, pentagon, quadrilateral, rectangle, room, triangle'):
        load_scene('nowhere')


@pytest.mark.parametrize(('name', 'edges'), [('triangle', 3), ('quadrilateral', 4), ('rectangle', 4), ('pentagon', 5)])
def test_built_in_scenes_hear_every_wall(name, edges):
    assert name in built_in_scenes()
    scene = load_scene(name)
    assert (scene.name, len(scene.vertices), len(scene.poses)) == (name, edges, 60)
    assert audible_feet(scene.vertices, scene.positions).sum(axis=0).min() >= 6
    assert scene.parameters().flat() == type(scene.parameters())().flat()
