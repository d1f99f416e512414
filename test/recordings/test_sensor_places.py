"""The lever arm from /tf_static in a recording: the same map as with the place given by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import RecordingError
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.outputs import echo_message, odometry_message
from polymap_ros.parameters import Parameters
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.replay import Replay
from polymap_ros.recordings.writing import RecordingWriter, make
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

FROM_TF = {'sensor.from_tf': True, 'solver.method': 'paper'}


def static(parent, child, x, y, yaw=0.0):
    z, w = Rotation.from_euler('z', yaw).as_quat()[2:]
    each = make('geometry_msgs/msg/TransformStamped', header=make('std_msgs/msg/Header', frame_id=parent),
                child_frame_id=child, transform=make(
                    'geometry_msgs/msg/Transform', translation=make('geometry_msgs/msg/Vector3', x=x, y=y, z=0.4),
                    rotation=make('geometry_msgs/msg/Quaternion', z=z, w=w)))
    return make('tf2_msgs/msg/TFMessage', transforms=[each])


# A mast 0.1 m ahead that looks left, and the sensor 0.05 m before it: (0.1, 0.05) in the base frame.
CHAIN = [static('base_link', 'mast', 0.1, 0.0, np.pi / 2), static('mast', 'sonar', 0.05, 0.0)]
PLACE = Pose(0.1, 0.05)


@pytest.fixture(scope='module')
def scene():
    return load_scene('triangle', None)


@pytest.fixture
def record(scene, tmp_path):
    """The triangle, driven by a robot that carries the sensor at PLACE."""

    def write(transforms=CHAIN, topic='/tf_static', frame_id='sonar', at_end=False):
        samples = simulate(scene).astype(np.float32)
        with RecordingWriter(tmp_path / 'run.mcap') as writer:
            stamps = scene.stamps_ns.tolist()
            for message in transforms:
                writer.write(topic, message, stamps[-1] + 1 if at_end else stamps[0])
            for k, (stamp_ns, pose) in enumerate(zip(stamps, scene.poses.tolist(), strict=True)):
                sensor = Pose(*pose)
                offset = Pose(0.0, 0.0, sensor.yaw).compose(PLACE)
                base = Pose(sensor.x - offset.x, sensor.y - offset.y, sensor.yaw)
                writer.write('/odom', odometry_message(make, stamp_ns, 'odom', base), stamp_ns)
                ping = Ping(stamp_ns, samples[k], 1e-6, frame_id=frame_id)
                writer.write('/echo', echo_message(make, ping), stamp_ns)
        return tmp_path / 'run.mcap'

    return write


def replayed(path, scene, values):
    parameters = scene.parameters(Parameters()).replaced(values)
    mapper = PolygonMapper(parameters)
    with Recording.open(path) as recording:
        for _ in Replay(recording, mapper, parameters):
            pass
    return mapper


@pytest.mark.parametrize('options', [{}, {'topic': '/robot/tf_static'}, {'at_end': True}])
def test_the_chain_of_static_transforms_is_the_lever_arm(record, scene, options):
    path = record(**options)
    mapper = replayed(path, scene, FROM_TF)
    given = replayed(path, scene, {'sensor.x_m': PLACE.x, 'sensor.y_m': PLACE.y, 'solver.method': 'paper'})
    assert mapper.counts.used == given.counts.used == len(scene.poses)
    np.testing.assert_allclose(mapper.beam_map.values, given.beam_map.values, rtol=1e-5, atol=1e-6)
    path_xy = mapper.start_pose.apply(np.array([(each.x, each.y) for each in mapper.soundings]))
    np.testing.assert_allclose(path_xy, scene.positions, atol=1e-9)
    assert len(mapper.solve().polygon.vertices) == 3


def test_without_it_the_robots_base_is_taken_for_the_sensor(record, scene):
    mapper = replayed(record(), scene, {})
    assert np.hypot(mapper.start_pose.x - scene.poses[0][0], mapper.start_pose.y - scene.poses[0][1]) > 0.1


@pytest.mark.parametrize(('options', 'says'), [
    ({'transforms': CHAIN[:1]}, "/tf_static does not connect the echo's frame 'sonar' to the odometry's child frame "
                                "'base_link' (sensor.from_tf); it holds base_link, mast"),
    ({'frame_id': ''}, "does not connect the echo's frame ''"),
])
def test_frames_that_are_not_connected_drop_every_ping_with_their_names(record, scene, options, says):
    mapper = replayed(record(**options), scene, FROM_TF)
    assert mapper.counts.dropped == {'no_pose': len(scene.poses)}
    assert says in mapper.intake.last_drop_texts['no_pose']


def test_a_recording_without_static_transforms_is_refused_with_the_remedy(record, scene):
    path = record(transforms=[])
    with pytest.raises(RecordingError, match=r'run\.mcap: holds no tf2_msgs/msg/TFMessage on /tf_static, which '
                                             r'sensor\.from_tf needs; give sensor\.x_m and sensor\.y_m'):
        replayed(path, scene, FROM_TF)
