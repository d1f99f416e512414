"""The lever arm from TF, live. tf2_ros is on no package index, so a small module stands in for it here: the calls that
the node makes of the real one (Jazzy's tf2_ros_py: Buffer.lookup_transform, TransformListener, TransformException), fed
from a topic of TransformStamped instead of /tf_static. That the real one answers alike is not tested here."""

import importlib.util
import os
import textwrap

import pytest

pytest.importorskip('rclpy')

from rclpy.qos import DurabilityPolicy, QoSProfile

from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, odometry_message
from polymap_ros.node.factory import make, message_class
from polymap_ros.results.arrays import read_state
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import pings

ODOMETRY, SCAN, TRANSFORM = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan', 'geometry_msgs/msg/TransformStamped'
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RELIABLE = [part for topic in ('odom', 'echo')
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]

STAND_IN = '''
    from geometry_msgs.msg import TransformStamped
    from rclpy.qos import DurabilityPolicy, QoSProfile

    class TransformException(Exception):
        pass

    class Buffer:
        def __init__(self):
            self.known = {}

        def lookup_transform(self, target_frame, source_frame, time):
            if time.nanoseconds or (target_frame, source_frame) not in self.known:
                raise TransformException(f'{source_frame} does not exist')
            return self.known[target_frame, source_frame]

    class TransformListener:
        def __init__(self, buffer, node):
            latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self.subscription = node.create_subscription(TransformStamped, '/stand_in', self.take, latched)
            self.buffer = buffer

        def take(self, each):
            self.buffer.known[each.header.frame_id, each.child_frame_id] = each
'''


@pytest.fixture
def tf2_ros(tmp_path, monkeypatch):
    if importlib.util.find_spec('tf2_ros') is not None:
        pytest.skip('the real tf2_ros is here')
    (tmp_path / 'tf2_ros.py').write_text(textwrap.dedent(STAND_IN))
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(filter(None, [str(tmp_path), os.environ.get('PYTHONPATH')])))


def test_pings_wait_for_tf_and_are_placed_with_it(peer, start, tf2_ros, tmp_path):
    node = start('--ros-args', *RELIABLE, '-p', 'sensor.from_tf:=true', '-p', f'output.dir:={tmp_path}/saves')
    scene = load_scene('triangle', None)
    values = peer.diagnostics()
    odometry, echo = peer.publisher('/odom', ODOMETRY), peer.publisher('/echo', SCAN)
    for ping, pose in zip(pings(scene)[:4], scene.poses, strict=False):
        base = Pose(*pose[:2], 0.5)
        odometry.publish(odometry_message(make, ping.stamp_ns, 'odom', base, child_frame_id='base_link'))
        echo.publish(echo_message(make, ping))
    line = node.wait_for_line('pings wait for TF')
    assert "pings wait for TF to connect their frame 'sensor'" in line
    peer.spin_until(lambda: values().get('pings waiting') == '4', 'all four waiting')
    transform = make(TRANSFORM, child_frame_id='sensor')
    transform.header.frame_id = 'base_link'
    transform.transform.translation.x, transform.transform.translation.y = 0.2, -0.1
    latched = peer.node.create_publisher(message_class(TRANSFORM), '/stand_in', LATCHED)
    latched.publish(transform)
    peer.spin_until(lambda: latched.get_subscription_count() > 0, 'the stand-in listens')
    k = 4

    def used_after_another_pose():
        nonlocal k
        stamp_ns = int(scene.stamps_ns[3]) + k * 1_000_000
        odometry.publish(odometry_message(make, stamp_ns, 'odom', base, child_frame_id='base_link'))
        k += 1
        return values().get('pings used') == '4'

    peer.spin_until(used_after_another_pose, 'all four used')
    saved = peer.call('/polymap_node/save', 'std_srvs/srv/Trigger').message
    start_xyyaw = read_state(tmp_path / 'saves' / saved / 'state.npz')['frame.start'][0]
    expected = Pose(*scene.poses[0][:2], 0.5).compose(Pose(0.2, -0.1))
    assert start_xyyaw.tolist() == pytest.approx([expected.x, expected.y, 0.5], abs=1e-9)


def test_an_echo_without_a_frame_is_dropped(peer, start, tf2_ros):
    start('--ros-args', *RELIABLE, '-p', 'sensor.from_tf:=true')
    values = peer.diagnostics()
    scene = load_scene('triangle', None)
    message = echo_message(make, pings(scene)[0])
    message.header.frame_id = ''
    peer.publisher('/echo', SCAN).publish(message)
    peer.spin_until(lambda: values().get('pings dropped: no_pose') == '1', 'the drop')
    assert 'the echo has no frame_id' in values()['message']


@pytest.mark.skipif(importlib.util.find_spec('tf2_ros') is not None, reason='tf2_ros is installed')
def test_without_tf2_ros_the_parameter_is_refused_with_the_remedy(start):
    node = start('--ros-args', '-p', 'sensor.from_tf:=true', '--log-level', 'warn', ready='')
    assert node.end() == 2
    assert len(node.lines) == 1
    assert 'parameter sensor.from_tf: true needs tf2_ros, which is not installed' in node.lines[0]
    assert 'ros-jazzy-tf2-ros-py' in node.lines[0]
