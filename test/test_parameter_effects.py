"""Every parameter changes something: a row for each, observed where it acts.

A row is what the parameter is changed to, what else has to be set for it to act, and where that is seen: `mapped`, what
a recording becomes in the mapper's state; `solved`, the answer; `saved`, the files. What acts in the node alone names
the live test that proves it.
"""

from pathlib import Path

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.commands import replay
from polymap_ros.errors import PolymapError
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.outputs import echo_message
from polymap_ros.parameters import Parameters, specifications
from polymap_ros.pulse_file import read_pulse
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.replay import Replay
from polymap_ros.recordings.writing import RecordingWriter, make
from polymap_ros.results.arrays import read_state
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

JOINTS, BYTES = 'sensor_msgs/msg/JointState', 'sensor_msgs/msg/CompressedImage'
FLOATS, IMAGE = 'std_msgs/msg/Float32MultiArray', 'sensor_msgs/msg/Image'
PINGS = 30
STEP_NS = 500_000_000
ROLL_RAD = np.deg2rad(5.0)
PAPER = {'solver.method': 'paper'}
PLAIN = {'solver.method': 'paper', 'odometry.max_tilt_deg': 90.0}
CHIRP = {'pulse.kind': 'chirp', 'pulse.bandwidth_hz': 4e4, 'pulse.duration_s': 1e-4}
OWN = {'echo.type': JOINTS, 'topics.echo': '/joints', 'echo.samples_field': 'position', 'echo.sample_period_s': 1e-6,
       'echo.allow_unstamped': True}
RAW = {'echo.type': BYTES, 'topics.echo': '/bytes', 'echo.samples_field': 'data', 'echo.sample_period_s': 1e-6}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A recording with several topics, two pulses, and a saved state."""
    folder = tmp_path_factory.mktemp('effects')
    scene = load_scene('pentagon')
    samples = simulate(scene).astype(np.float32)[:PINGS]
    samples[3, 900:950] = samples[3].max()  # clipped
    with RecordingWriter(folder / 'run.mcap') as writer:
        for stamp, topic, message in sorted(messages(scene.poses[:PINGS], samples), key=lambda entry: entry[0]):
            writer.write(topic, message, stamp)
    np.save(folder / 'long.npy', np.sin(2 * np.pi * 0.1 * np.arange(40)))
    np.save(folder / 'short.npy', np.sin(2 * np.pi * 0.1 * np.arange(20)))
    assert replay.main([str(folder / 'run.mcap'), '-p', 'solver.method:=paper', '--end', '10',
                        '--output', str(folder / 'first')]) == 0
    return folder


def messages(poses, samples):
    """(log time, topic, message); odometry at every second ping and after it, so that two wait, 5 cm higher at last."""
    late = PINGS // 2
    yield 0, '/tf_static', static_transform()
    for k, (pose, ping) in enumerate(zip(poses, samples, strict=True)):
        stamp = (k + 2) * STEP_NS
        if k % 2 == 0:
            height = 0.05 if k > late else 0.0
            yield stamp, '/odom', odometry(stamp, *pose, height)
            yield stamp, '/shifted', odometry(stamp, pose[0], pose[1], pose[2] + 0.3, height)
        log = stamp + (20 * 10**9 if k == 1 else -1_000_000)
        header = stamped(stamp, 'sonar')
        yield log, '/echo', echo_message(make, Ping(stamp, ping, 1e-6, frame_id='sonar'))
        yield log, '/other', echo_message(make, Ping(stamp, ping[::-1].copy(), 1e-6))
        yield log, '/image', make(IMAGE, header=header, height=1, width=ping.size, encoding='32FC1',
                                  step=4 * ping.size, data=ping.view(np.uint8))
        yield log, '/floats', make(FLOATS, data=ping)
        yield log, '/joints', make(JOINTS, header=header, position=ping.astype(float),
                                   velocity=ping[::-1].astype(float))
        yield log, '/bytes', make(BYTES, header=header, data=ping.view(np.uint8))
    end = (PINGS + 2) * STEP_NS
    yield end, '/odom', odometry(end, *poses[-1], 0.05)
    yield end, '/shifted', odometry(end, *poses[-1], 0.05)


def stamped(ns, frame_id):
    return make('std_msgs/msg/Header', frame_id=frame_id,
                stamp=make('builtin_interfaces/msg/Time', sec=ns // 10**9, nanosec=ns % 10**9))


def odometry(ns, x, y, yaw, height):
    """Rolled by `ROLL_RAD` about the robot's own x axis, all the time."""
    half, roll = yaw / 2, ROLL_RAD / 2
    turn = make('geometry_msgs/msg/Quaternion', x=np.cos(half) * np.sin(roll), y=np.sin(half) * np.sin(roll),
                z=np.sin(half) * np.cos(roll), w=np.cos(half) * np.cos(roll))
    pose = make('geometry_msgs/msg/Pose', orientation=turn,
                position=make('geometry_msgs/msg/Point', x=float(x), y=float(y), z=float(height)))
    return make('nav_msgs/msg/Odometry', header=stamped(ns, 'odom'), child_frame_id='base_link',
                pose=make('geometry_msgs/msg/PoseWithCovariance', pose=pose))


def static_transform():
    transform = make('geometry_msgs/msg/Transform', rotation=make('geometry_msgs/msg/Quaternion', w=1.0),
                     translation=make('geometry_msgs/msg/Vector3', x=0.05))
    return make('tf2_msgs/msg/TFMessage', transforms=[make(
        'geometry_msgs/msg/TransformStamped', header=stamped(0, 'base_link'), child_frame_id='sonar',
        transform=transform)])


def mapper_of(folder, values):
    parameters = Parameters(folder=folder).replaced({**PAPER, **values})
    mapper = PolygonMapper(parameters, read_pulse(parameters))
    with Recording.open(folder / 'run.mcap') as recording:
        for _ in Replay(recording, mapper, parameters):
            pass
    return mapper


def mapped(folder, values):
    """What the recording becomes; without the note of the parameters themselves."""
    state = mapper_of(folder, values).state()
    return {name: array.tobytes() for name, array in state.items() if name != 'parameters'}


def solved(folder, values):
    estimate = mapper_of(folder, values).solve()
    found = estimate.polygon or (estimate.alternatives[0] if estimate.alternatives else None)
    return estimate.status, estimate.method, None if found is None else found.vertices.tobytes()


def saved(folder, values):
    """The files that a replay without ``--output`` leaves, and what became of the pings."""
    target = Path(values.get('output.dir', folder / f'out{abs(hash(tuple(values.items())))}'))
    overrides = {**PAPER, 'output.dir': str(target), **values}
    options = [part for name, value in overrides.items() for part in ('-p', f'{name}:={value}')]
    assert replay.main([str(folder / 'run.mcap'), *options]) == 0
    files = {path.name: path.read_bytes() for path in target.iterdir() if path.name.startswith('map')}
    counts = read_state(target / 'state.npz')['queue.counts'].tolist()
    return str(target) if 'output.dir' in values else files, counts


ROWS = {
    # name: (value, where it is seen, what else is set)
    'medium.model': ('constant', mapped, {}),
    'medium.thickness_m': (0.005, mapped, {}),
    'medium.longitudinal_speed_m_s': (6000.0, mapped, {}),
    'medium.shear_speed_m_s': (3000.0, mapped, {}),
    'medium.speed_m_s': (2000.0, mapped, {'medium.model': 'constant'}),
    'medium.spreading_exponent': (1.0, mapped, {'front_end.flat_spreading': True}),
    'medium.edge': 'solvers/evidence/test_edge_phase.py: test_edges_that_are_said_to_be_real_stay_so',
    'pulse.kind': ('chirp', mapped, {'pulse.bandwidth_hz': 4e4, 'pulse.duration_s': 1e-4}),
    'pulse.frequency_hz': (90e3, mapped, {}),
    'pulse.cycles': (3.0, mapped, {}),
    'pulse.window': ('rectangular', mapped, {}),
    'pulse.bandwidth_hz': (5e4, mapped, CHIRP),
    'pulse.duration_s': (2e-4, mapped, CHIRP),
    'pulse.path': ('short.npy', mapped, {'pulse.kind': 'file', 'pulse.path': 'long.npy'}),
    'pulse.adapt': 'solvers/evidence/test_pulse_search.py: test_a_pulse_that_is_said_to_be_right_is_left',
    'echo.type': (IMAGE, mapped, {'topics.echo': '/image', 'echo.sample_period_s': 1e-6}),
    'echo.samples_field': ('velocity', mapped, OWN),
    'echo.samples_dtype': ('float32', mapped, RAW),
    'echo.stamp_field': ('', mapped, OWN),
    'echo.kind': ('envelope', mapped, {}),
    'echo.t0_s': (5e-5, mapped, {}),
    'echo.sample_period_s': (2e-6, mapped, {}),
    'echo.blanking_m': (0.3, mapped, {}),
    'echo.allow_unstamped': (True, mapped, {'echo.type': FLOATS, 'topics.echo': '/floats',
                                            'echo.sample_period_s': 1e-6}),
    'front_end.max_bad': (0.0, mapped, {}),
    'front_end.common_pings': (8, mapped, {}),
    'front_end.remove_dc': (True, mapped, {}),
    'front_end.band_low_hz': (80e3, mapped, {}),
    'front_end.band_high_hz': (120e3, mapped, {}),
    'front_end.mute_blanking': (True, mapped, {'echo.blanking_m': 0.2}),
    'front_end.gain_db_s': (5000.0, mapped, {}),
    'front_end.filter': ('wiener', mapped, {}),
    'front_end.wiener_noise': (1.0, mapped, {'front_end.filter': 'wiener'}),
    'front_end.flat_spreading': (True, mapped, {}),
    'sensor.x_m': (0.05, mapped, {}),
    'sensor.y_m': (0.05, mapped, {}),
    'sensor.from_tf': (True, mapped, {}),
    'sensor.baseline_x_m': (0.1, mapped, {}),
    'sensor.baseline_y_m': (0.1, mapped, {}),
    'sensor.baseline_z_m': (0.1, mapped, {}),
    'odometry.max_gap_s': (0.9, mapped, {}),
    'odometry.buffer_s': (5.0, mapped, {}),
    'odometry.queue_size': (1, mapped, {}),
    'odometry.plane': ('first_pose', mapped, {}),
    'odometry.max_tilt_deg': (3.0, mapped, {}),
    'odometry.max_height_m': (0.02, mapped, {}),
    'odometry.scale': (1.05, mapped, {}),
    'odometry.yaw_drift_deg_m': (3.0, mapped, {}),
    'odometry.on_jump_back': 'node/test_node.py: test_stamps_that_go_back_reset_the_map_or_are_ignored',
    'grid.range_max_m': (2.0, mapped, {}),
    'grid.range_step_m': (0.01, mapped, {}),
    'grid.angle_step_deg': (2.0, mapped, {}),
    'grid.angle_min_deg': (90.0, mapped, {}),
    'grid.angle_max_deg': (270.0, mapped, {}),
    'free_area.model': ('grid', mapped, {}),
    'free_area.false_alarm': (1e-9, mapped, {}),
    'free_area.missed': (0.5, mapped, {'free_area.model': 'grid'}),
    'free_area.cell_m': (0.05, mapped, {'free_area.model': 'grid'}),
    'solver.method': ('rectangle', solved, {}),
    'solver.max_edges': (3, solved, {}),
    'solver.outline': 'solvers/evidence/test_rings.py: test_where_only_convex_ones_are_asked_for_an_l_stays_open',
    'solver.period_s': 'node/test_diagnostics.py: test_solver_that_is_behind_is_told',
    'solver.seed': (2, solved, {'solver.iterations': 20}),
    'solver.iterations': (20, solved, {}),
    'solver.iou_weight': (0.0, solved, {}),
    'solver.edge_filter_epsilon': (0.5, solved, {}),
    'solver.neighbourhood_m': (0.5, solved, {'solver.iterations': 20}),
    'solver.neighbourhood_deg': (5.0, solved, {'solver.iterations': 20}),
    'slam.mode': 'solvers/evidence/test_drift.py: test_off_takes_the_odometry_as_exact',
    'slam.map_frame': 'node/test_map_frame.py: test_in_a_map_frame_path_and_polygon_stay_where_they_are',
    'slam.map_origin': 'mapping/test_mapper.py: test_a_map_frame_that_begins_at_the_first_ping_keeps_coordinates_small',
    'slam.publish_tf': 'node/test_map_frame.py: test_no_tf_is_broadcast_where_somebody_else_gives_it',
    'slam.tf_period_s': 'node/test_map_frame.py: test_tf_comes_as_often_and_as_far_ahead_as_asked',
    'slam.tf_tolerance_s': 'node/test_map_frame.py: test_tf_comes_as_often_and_as_far_ahead_as_asked',
    'slam.noise_m_sqrt_m': 'solvers/evidence/test_drift.py: test_more_noise_of_the_distance_expects_pings_farther_away',
    'slam.noise_deg_sqrt_m': 'solvers/evidence/test_drift.py: test_more_noise_of_the_heading_makes_less_certain',
    'slam.noise_turn': 'solvers/evidence/test_drift.py: test_more_noise_of_turns_makes_less_certain',
    'map.resolution_m': (0.02, saved, {}),
    'map.margin_m': (0.5, saved, {}),
    'output.dir': ('elsewhere', saved, {'output.dir': 'here'}),
    'output.autosave_s': 'node/test_node.py: test_autosave_keeps_the_newest_whole_map_and_saves_at_the_end',
    'output.load_path': ('first/state.npz', saved, {}),
    'topics.odom': ('/shifted', mapped, {}),
    'topics.echo': ('/other', mapped, {}),
}


def test_every_parameter_has_a_row():
    assert list(ROWS) == [spec.name for spec in specifications()]


@pytest.fixture(scope='module')
def answer(folder):
    """What is observed, or why it is refused; each question is answered once."""
    known = {}

    def ask(observe, values):
        key = observe, tuple(values.items())
        if key not in known:
            try:
                known[key] = observe(folder, values)
            except PolymapError as error:
                known[key] = str(error)
        return known[key]

    return ask


@pytest.mark.parametrize('name', [name for name, row in ROWS.items() if not isinstance(row, str)])
def test_a_parameter_changes_what_is_observed(folder, answer, monkeypatch, name):
    monkeypatch.chdir(folder)
    value, observe, others = ROWS[name]
    assert value != {**Parameters().flat(), **others}[name]
    assert answer(observe, {**others, name: value}) != answer(observe, others)


@pytest.mark.parametrize('observe', [mapped, solved])
def test_the_same_parameters_give_the_same(folder, observe):
    assert observe(folder, {}) == observe(folder, {})


@pytest.mark.parametrize('name', [name for name, row in ROWS.items() if isinstance(row, str)])
def test_the_live_test_that_is_named_uses_the_parameter(name):
    path, _, test = ROWS[name].partition(': ')
    text = (Path(__file__).parent / path).read_text(encoding='utf-8')
    body = text.split(f'def {test}(')[1].split('\ndef ')[0]
    assert name in body
