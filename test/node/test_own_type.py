"""A message type that is none of the four, live: by the names of its fields, over DDS."""

import pytest

pytest.importorskip('rclpy')

import numpy as np

from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import header, odometry_message
from polymap_ros.node.factory import make
from polymap_ros.recordings.writing import RecordingWriter
from polymap_ros.recordings.writing import make as make_recorded
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import simulate

ODOMETRY, JOINTS, COUNTS = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/JointState', 'std_msgs/msg/Int16MultiArray'
PERIOD = ('-p', 'echo.sample_period_s:=1.0e-6')
RELIABLE = [part for topic in ('odom', 'echo')
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]


def fields(type_name, **names):
    options = {'type': type_name, **names}
    return [part for name, value in options.items() for part in ('-p', f'echo.{name}:={value}')]


@pytest.fixture(scope='module')
def scene():
    return load_scene('triangle', None)


def test_a_stamped_type_of_ones_own_gives_the_polygon(peer, start, scene):
    start('--ros-args', *RELIABLE, *PERIOD, *fields(JOINTS, samples_field='position'), '-p', 'solver.method:=paper')
    polygons, values = peer.listen('/polymap_node/polygon', 'geometry_msgs/msg/PolygonStamped'), peer.diagnostics()
    odometry, echo = peer.publisher('/odom', ODOMETRY), peer.publisher('/echo', JOINTS)
    for stamp_ns, pose, samples in zip(scene.stamps_ns.tolist(), scene.poses, simulate(scene), strict=True):
        odometry.publish(odometry_message(make, stamp_ns, 'odom', Pose(*pose)))
        echo.publish(make(JOINTS, header=header(make, stamp_ns, 'sonar'), position=samples))
    peer.spin_until(lambda: values().get('pings used') == str(len(scene.poses)), 'all pings used')
    peer.spin_until(lambda: polygons and len(polygons[-1].polygon.points) == 3, 'the triangle')


def test_a_type_without_a_stamp_is_stamped_on_arrival(peer, start, scene):
    options = fields(COUNTS, samples_field='data', stamp_field="''", allow_unstamped='true')
    start('--ros-args', *RELIABLE, *PERIOD, *options, '-p', 'odometry.max_gap_s:=60.0')
    values = peer.diagnostics()
    odometry, echo = peer.publisher('/odom', ODOMETRY), peer.publisher('/echo', COUNTS)

    def stand():
        now_ns = peer.node.get_clock().now().nanoseconds
        odometry.publish(odometry_message(make, now_ns, 'odom', Pose(*scene.poses[0])))

    stand()
    peer.spin_until(lambda: values().get('odometry received') == '1', 'odometry before the ping')
    samples = simulate(scene)[0]
    echo.publish(make(COUNTS, data=np.round(samples / np.abs(samples).max() * 32767.0).astype(np.int16)))
    peer.spin_until(lambda: values()['pings waiting'] == '1', 'a ping that waits for its pose')
    stand()
    peer.spin_until(lambda: values()['pings used'] == '1', 'the ping used')


def test_a_recording_of_a_type_of_ones_own_is_played(peer, start, scene, tmp_path):
    with RecordingWriter(tmp_path / 'run.mcap') as writer:
        for stamp_ns, pose, samples in zip(scene.stamps_ns.tolist(), scene.poses, simulate(scene)[:10], strict=False):
            writer.write('/odom', odometry_message(make_recorded, stamp_ns, 'odom', Pose(*pose)), stamp_ns)
            message = make_recorded(JOINTS, header=header(make_recorded, stamp_ns, 'sonar'), position=samples)
            writer.write('/echo', message, stamp_ns)
    own = [*PERIOD, *fields(JOINTS, samples_field='position')]
    start('--ros-args', *RELIABLE, *own)
    values = peer.diagnostics()
    player = start(str(tmp_path / 'run.mcap'), '--rate', '5', '--wait', '20', *own, command='play', ready='')
    peer.spin_until(lambda: values().get('pings used') == '10', 'all pings used')
    assert player.end() == 0


@pytest.mark.parametrize(('options', 'says'), [
    (['echo.type:=sonar_msgs/msg/Ping', 'echo.samples_field:=data'],
     "message type sonar_msgs/msg/Ping is not installed here (No module named 'sonar_msgs'): install or build the "
     'package sonar_msgs'),
    (['echo.type:=sensor_msgs/msg/Sonar', 'echo.samples_field:=data'], 'sensor_msgs/msg/Sonar is not installed here'),
    ([f'echo.type:={JOINTS}', 'echo.samples_field:=samples'],
     "has no field 'samples', only header, name, position, velocity, effort"),
    (['echo.type:=sensor_msgs/msg/MultiEchoLaserScan', 'echo.samples_field:=intensities.echoes'],
     'echoes would be a field of sensor_msgs/msg/LaserEcho[]'),
])
def test_a_type_that_cannot_work_is_one_line_and_status_2(start, options, says):
    given = [part for option in options for part in ('-p', option)]
    node = start('--ros-args', *PERIOD, *given, '--log-level', 'warn', ready='')
    assert node.end() == 2
    assert says in node.lines[-1]
    assert len(node.lines) == 1
