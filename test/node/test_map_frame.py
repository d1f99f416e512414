"""Where the robot is in the map: a real node under drifting odometry, with and without a map frame and TF."""

import json
import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSProfile

from polymap_ros.acoustics.ping import Ping
from polymap_ros.evaluation.slam_experiment import CASES
from polymap_ros.geometry.alignment import alignment, path_error
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, odometry_message, transform_message
from polymap_ros.node.factory import make, message_class
from polymap_ros.simulation.waveforms import simulate

SECOND_NS = 1_000_000_000
FIRST, PINGS = 16, 24  # a search begins anew with a tenth more pings
RELIABLE = [part for topic in ('odom', 'echo')
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]


class Drive:
    """Publishes the first pings of a plate with odometry of the level `typical`."""

    def __init__(self, peer):
        self.scene = CASES['typical'].make(4, 5)
        self.odometry = peer.publisher('/odom', 'nav_msgs/msg/Odometry')
        self.echo = peer.publisher('/echo', 'sensor_msgs/msg/LaserScan')
        self.reported = self.scene.reported_poses()[:PINGS]

    def publish(self, samples, first, last):
        for k, (pose, each) in enumerate(zip(self.reported[first:last], samples[first:last], strict=True), first):
            stamp_ns = (k + 1) * SECOND_NS
            self.odometry.publish(odometry_message(make, stamp_ns, 'odom', Pose(*pose)))
            self.echo.publish(echo_message(make, Ping(stamp_ns, np.asarray(each, np.float32), self.scene.period_s)))
        self.odometry.publish(odometry_message(make, stamp_ns + SECOND_NS // 2, 'odom', Pose(*pose)))


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


def of(message):
    x, y = message.position.x, message.position.y
    return Pose(x, y, 2.0 * float(np.arctan2(message.orientation.z, message.orientation.w)))


@pytest.fixture(scope='module')
def samples():
    return simulate(CASES['typical'].make(4, 5))[:PINGS]


def driven(start, peer, samples, *arguments):
    """What a node has published once all pings are in its answer."""
    start('--ros-args', *RELIABLE, *arguments)
    paths = peer.listen('/polymap_node/path', 'nav_msgs/msg/Path')
    polygons = peer.listen('/polymap_node/polygon', 'geometry_msgs/msg/PolygonStamped')
    newest = []
    peer.node.create_subscription(PoseWithCovarianceStamped, '/polymap_node/pose', newest.append, QoSProfile(depth=100))
    values, drive = peer.diagnostics(), Drive(peer)
    drive.publish(samples, 0, FIRST)
    peer.until_used(values, FIRST)
    drive.publish(samples, FIRST, PINGS)
    peer.spin_until(lambda: values().get('pings localised') == str(PINGS) and newest
                    and seconds(newest[-1].header.stamp) == PINGS and polygons
                    and seconds(polygons[-1].header.stamp) == PINGS and paths and len(paths[-1].poses) == PINGS,
                    'not all pings are in the answer')
    return drive, paths[-1], polygons[-1], newest, values()


def corners(polygon):
    return np.array([(point.x, point.y) for point in polygon.polygon.points])


def test_in_a_map_frame_path_and_polygon_stay_where_they_are(start, peer, samples):
    drive, path, polygon, newest, values = driven(start, peer, samples, '-p', 'slam.map_frame:=map')
    assert {path.header.frame_id, polygon.header.frame_id, newest[-1].header.frame_id} == {'map'}
    poses = np.array([(each.x, each.y, each.yaw) for each in (of(entry.pose) for entry in path.poses)])
    true = drive.scene.poses[:PINGS]
    motion = alignment(poses[:, :2], true[:, :2])
    assert path_error(poses, true, motion).worst_m < 1e-3
    assert compare(motion.apply(corners(polygon)), drive.scene.vertices).right
    here = of(newest[-1].pose.pose)
    np.testing.assert_allclose((here.x, here.y), poses[-1, :2], atol=1e-9)
    covariance = np.array(newest[-1].pose.covariance).reshape(6, 6)
    assert 0.0 < covariance[0, 0] < 0.05**2
    assert 0.0 < covariance[5, 5] < 0.1**2
    assert values['pings lost'] == '0'
    assert float(values['least consistency']) > 0.8
    assert values['correction'].endswith('deg')


def test_without_one_the_robot_sees_the_walls_where_they_are_now(start, peer, samples):
    drive, path, polygon, newest, _ = driven(start, peer, samples)
    assert {path.header.frame_id, polygon.header.frame_id, newest[-1].header.frame_id} == {'odom'}
    here, reported, true = of(newest[-1].pose.pose), Pose(*drive.reported[-1]), Pose(*drive.scene.poses[PINGS - 1])
    np.testing.assert_allclose((here.x, here.y), (reported.x, reported.y), atol=1e-9)
    seen = reported.inverse().apply(corners(polygon))
    expected = true.inverse().apply(drive.scene.vertices)
    assert compare(seen, expected, 0.02, np.deg2rad(2.0)).right  # by as much the heading is off at the last ping


def test_without_tf2_msgs_it_says_so_and_goes_on(start, monkeypatch, tmp_path):
    (tmp_path / 'tf2_msgs.py').write_text('')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    process = start('--ros-args', '-p', 'slam.map_frame:=map', ready='no TF from')
    process.wait_for_line('ready:')


@pytest.mark.usefixtures('tf2_msgs')
@pytest.mark.parametrize('told', ['slam.publish_tf:=true', 'odometry.scale:=1.01', 'slam.map_origin:=first_ping'])
def test_tf_leads_from_the_odometry_as_published_to_the_pose(start, peer, samples, told):
    transforms = peer.listen('/tf', 'tf2_msgs/msg/TFMessage', QoSProfile(depth=100))
    drive, _, _, newest, _ = driven(start, peer, samples, '-p', 'slam.map_frame:=map', '-p', told)
    count = len(transforms)
    peer.spin_until(lambda: len(transforms) > count, 'TF goes on without pings')
    each = transforms[-1].transforms[0]
    assert (each.header.frame_id, each.child_frame_id) == ('map', 'odom')
    off, turn = each.transform.translation, each.transform.rotation
    found = Pose(off.x, off.y, 2.0 * float(np.arctan2(turn.z, turn.w))).compose(Pose(*drive.reported[-1]))
    here = of(newest[-1].pose.pose)
    np.testing.assert_allclose((found.x, found.y, np.sin(found.yaw)), (here.x, here.y, np.sin(here.yaw)), atol=1e-6)


@pytest.mark.usefixtures('tf2_msgs')
def test_a_second_source_of_tf_is_told_and_no_first_one(start, peer, samples):
    process = start('--ros-args', *RELIABLE, '-p', 'slam.map_frame:=map')
    transforms = peer.listen('/tf', 'tf2_msgs/msg/TFMessage', QoSProfile(depth=100))
    others = peer.publisher('/tf', 'tf2_msgs/msg/TFMessage')
    values, drive = peer.diagnostics(), Drive(peer)
    drive.publish(samples, 0, FIRST)
    peer.until_used(values, FIRST)
    count = len(transforms)
    peer.spin_until(lambda: len(transforms) > count + 5, 'TF goes on')
    for frames in (('odom', 'base_link'), ('world', 'odom')):
        other = transform_message(make, SECOND_NS, *frames, Pose(0.1, 0.2, 0.3))
        others.publish(make('tf2_msgs/msg/TFMessage', transforms=[other]))
    process.wait_for_line('somebody else')
    process.stop()
    told = [line for line in process.lines if 'somebody else' in line]
    assert len(told) == 1
    assert "TF from 'world' to 'odom'" in told[0]


@pytest.mark.usefixtures('tf2_msgs')
def test_no_tf_is_broadcast_where_nobody_asked_for_it(start, peer, samples):
    transforms = peer.listen('/tf', 'tf2_msgs/msg/TFMessage', QoSProfile(depth=100))
    driven(start, peer, samples)
    assert not transforms


@pytest.mark.usefixtures('tf2_msgs')
def test_no_tf_is_broadcast_where_somebody_else_gives_it(start, peer, samples):
    transforms = peer.listen('/tf', 'tf2_msgs/msg/TFMessage', QoSProfile(depth=100))
    driven(start, peer, samples, '-p', 'slam.map_frame:=map', '-p', 'slam.publish_tf:=false')
    assert not transforms


@pytest.mark.usefixtures('tf2_msgs')
def test_tf_comes_as_often_and_as_far_ahead_as_asked(start, peer, samples):
    """Five seconds ahead, of which the wire takes some; two seconds apart, from the first ping on."""
    ahead = []
    peer.node.create_subscription(
        message_class('tf2_msgs/msg/TFMessage'), '/tf',
        lambda message: ahead.append((seconds(message.transforms[0].header.stamp), time.time())),
        QoSProfile(depth=100))
    start('--ros-args', *RELIABLE, '-p', 'slam.map_frame:=map', '-p', 'slam.tf_period_s:=2.0',
          '-p', 'slam.tf_tolerance_s:=5.0')
    drive = Drive(peer)
    drive.publish(samples, 0, 2)
    peer.spin_until(lambda: len(ahead) >= 5, 'TF goes on')
    assert all(4.0 < stamp - received <= 5.0 for stamp, received in ahead)
    last, before = (stamp for stamp, _ in ahead[-1:-3:-1])
    assert abs(last - before - 2.0) < 0.5


@pytest.fixture
def given(tmp_path, samples):
    """A map of the plate, in a frame of its own, as it is saved."""
    frame = Pose(3.0, -1.0, 0.8)
    vertices = frame.apply(CASES['typical'].make(4, 5).vertices)
    (tmp_path / 'polygon.json').write_text(json.dumps({'status': 'closed', 'vertices': vertices.tolist()}))
    return frame, tmp_path


def test_in_a_map_that_is_given_the_robot_is_found_and_tf_leads_there(start, peer, samples, given, tf2_msgs):
    frame, folder = given
    transforms = peer.listen('/tf', 'tf2_msgs/msg/TFMessage', QoSProfile(depth=100))
    drive, _, polygon, newest, _ = driven(
        start, peer, samples, '-p', 'slam.mode:=localization', '-p', f'output.load_path:={folder}', '-p',
        'slam.map_frame:=map')
    true = frame.compose(Pose(*drive.scene.poses[PINGS - 1]))
    here = of(newest[-1].pose.pose)
    np.testing.assert_allclose((here.x, here.y), (true.x, true.y), atol=1e-3)
    assert newest[-1].header.frame_id == polygon.header.frame_id == 'map'
    assert compare(corners(polygon), frame.apply(drive.scene.vertices), 1e-5, 1e-5).right
    count = len(transforms)
    peer.spin_until(lambda: len(transforms) > count, 'TF goes on without pings')
    off, turn = transforms[-1].transforms[0].transform.translation, transforms[-1].transforms[0].transform.rotation
    found = Pose(off.x, off.y, 2.0 * float(np.arctan2(turn.z, turn.w))).compose(Pose(*drive.reported[-1]))
    np.testing.assert_allclose((found.x, found.y, np.sin(found.yaw)), (here.x, here.y, np.sin(here.yaw)), atol=1e-6)


def test_a_pose_that_is_told_is_taken_or_refused_by_name(start, peer, samples, given):
    frame, folder = given
    process = start('--ros-args', *RELIABLE, '-p', 'slam.mode:=localization', '-p', f'output.load_path:={folder}', '-p',
                    'slam.map_frame:=map')
    told = peer.publisher('/initialpose', 'geometry_msgs/msg/PoseWithCovarianceStamped')
    values, drive = peer.diagnostics(), Drive(peer)
    drive.publish(samples, 0, 3)
    peer.until_used(values, 3)
    true = frame.compose(Pose(*drive.scene.poses[2]))
    for place, frame_id, answer in ((Pose(90.0, 0.0), 'map', 'is outside of the map'),
                                    (true, 'elsewhere', "it is in frame 'elsewhere', the map is in 'map'"),
                                    (Pose(float('nan'), 0.0), 'map', 'it is no pose'),
                                    (true, 'map', 'looking for the robot within 0.30 m')):
        message = make('geometry_msgs/msg/PoseWithCovarianceStamped')
        message.header.frame_id, message.pose.covariance[0], message.pose.covariance[35] = frame_id, 0.01, 0.01
        message.pose.pose.position.x, message.pose.pose.position.y = place.x, place.y
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = np.sin(place.yaw / 2), np.cos(place.yaw / 2)
        told.publish(message)
        process.wait_for_line(answer)
    drive.publish(samples, 3, FIRST)
    peer.spin_until(lambda: values().get('pings localised') == str(FIRST), 'the pings are not localised')


def test_a_map_that_is_none_ends_the_start(start, tmp_path):
    node = start('--ros-args', '-p', 'slam.mode:=localization', '-p', f'output.load_path:={tmp_path}',
                 ready='polygon.json: cannot be read')
    assert node.end() == 2
