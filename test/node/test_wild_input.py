"""Odometry and echoes that are not what they should be, live: wild stamps, a robot off the plane, a lidar as echo."""

import pytest

pytest.importorskip('rclpy')

import numpy as np
from scipy.spatial.transform import Rotation

from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, header, odometry_message
from polymap_ros.node.factory import make
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import pings

ODOMETRY, SCAN = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan'
RELIABLE = [part for topic in ('odom', 'echo')
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]
RELIABLE += ['-p', 'solver.method:=paper']


class Drive:
    """Publishes the triangle's poses and pings."""

    def __init__(self, peer):
        self.scene = load_scene('triangle', None)
        self.pings = pings(self.scene)
        self.odometry, self.echo = peer.publisher('/odom', ODOMETRY), peer.publisher('/echo', SCAN)

    def pose(self, k, ahead_ns=0, z=0.0, roll=0.0):
        x, y, yaw = self.scene.poses[k]
        message = odometry_message(make, self.pings[k].stamp_ns + ahead_ns, 'odom', Pose(x, y, yaw))
        names = dict(zip('xyzw', Rotation.from_euler('ZYX', [yaw, 0.0, roll]).as_quat().tolist(), strict=True))
        message.pose.pose.orientation = make('geometry_msgs/msg/Quaternion', **names)
        message.pose.pose.position.z = z
        self.odometry.publish(message)

    def go(self, first, last, **how):
        for k in range(first, last):
            self.pose(k, **how)
            self.echo.publish(echo_message(make, self.pings[k]))


@pytest.mark.parametrize('action', ['reset', 'ignore'])
@pytest.mark.parametrize(('stamp_ns', 'line'), [
    (10**18, 'stamped far ahead of the next one'), (0, 's before the newest, alone')])
def test_one_wild_stamp_of_the_odometry_neither_resets_nor_stops_the_map(peer, start, action, stamp_ns, line):
    node = start('--ros-args', *RELIABLE, '-p', f'odometry.on_jump_back:={action}')
    values, drive = peer.diagnostics(), Drive(peer)
    drive.go(0, 10)
    drive.pose(9, ahead_ns=stamp_ns - drive.pings[9].stamp_ns)
    drive.go(10, 20)
    peer.spin_until(lambda: values().get('pings used') == '20', 'all pings used')
    assert values()['odometry received'] == '21'
    assert values()['odometry refused'] == '1'
    assert 'pings dropped' not in ' '.join(values())
    node.wait_for_line(line)
    assert not any('went back' in line for line in node.lines)


def test_pings_off_the_plane_are_dropped_with_the_reason(peer, start):
    start('--ros-args', *RELIABLE)
    values, drive = peer.diagnostics(), Drive(peer)
    drive.go(0, 5)
    peer.spin_until(lambda: values().get('pings used') == '5', 'pings on the plane')
    drive.go(5, 8, roll=0.5)
    peer.spin_until(lambda: values().get('pings dropped: off_plane') == '3', 'tilted pings')
    assert 'tilted by 28.6 deg off the mapping plane' in values()['message']
    drive.go(8, 10, z=0.4)
    peer.spin_until(lambda: values()['pings dropped: off_plane'] == '5', 'lifted pings')
    assert '0.400 m off the mapping plane' in values()['message']
    drive.go(10, 12)
    peer.spin_until(lambda: values()['pings used'] == '7', 'pings on the plane again')


def test_an_upright_polygon_is_published_where_it_is(peer, start):
    """A wall in the odometry's x-z plane: the robot is rolled by 90 degrees from the first pose on."""
    start('--ros-args', *RELIABLE, '-p', 'odometry.plane:=first_pose')
    polygons = peer.listen('/polymap_node/polygon', 'geometry_msgs/msg/PolygonStamped')
    maps = peer.listen('/polymap_node/map', 'nav_msgs/msg/OccupancyGrid')
    values, drive = peer.diagnostics(), Drive(peer)
    upright = Rotation.from_euler('x', 90, degrees=True)
    for k, ping in enumerate(drive.pings):
        x, y, yaw = drive.scene.poses[k]
        message = odometry_message(make, ping.stamp_ns, 'odom', Pose(x, 0.0, 0.0))
        message.pose.pose.position.z = y
        turned = (upright * Rotation.from_euler('z', yaw)).as_quat()
        message.pose.pose.orientation = make('geometry_msgs/msg/Quaternion', **dict(zip('xyzw', turned.tolist(),
                                                                                       strict=True)))
        drive.odometry.publish(message)
        drive.echo.publish(echo_message(make, ping))
    peer.spin_until(lambda: values().get('pings used') == str(len(drive.pings)), 'all pings used')
    peer.spin_until(lambda: polygons and len(polygons[-1].polygon.points) == 3 and maps, 'the triangle and its map')
    corners = np.array([[point.x, point.y, point.z] for point in polygons[-1].polygon.points])
    np.testing.assert_allclose(corners[:, 1], 0.0, atol=1e-6)
    truth = np.asarray(drive.scene.vertices)
    distances = np.linalg.norm(corners[:, None, [0, 2]] - truth[None], axis=2)
    assert distances.min(axis=1).max() < 0.03
    origin = maps[-1].info.origin.orientation
    normal = Rotation.from_quat([origin.x, origin.y, origin.z, origin.w]).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(normal, [0.0, -1.0, 0.0], atol=1e-9)


def test_a_lidar_wired_to_echo_is_refused_in_diagnostics_and_log(peer, start):
    node = start('--ros-args', *RELIABLE)
    values, drive = peer.diagnostics(), Drive(peer)
    drive.pose(0)
    scan = make(SCAN, header=header(make, drive.pings[0].stamp_ns, 'laser'), ranges=np.ones(360, np.float32),
                time_increment=1e-5, range_max=10.0)
    drive.echo.publish(scan)
    peer.spin_until(lambda: values().get('pings dropped: wrong_type') == '1', 'the scan dropped')
    assert 'echo has 360 ranges: that is a lidar scan' in values()['message']
    assert values()['level'] == '2'
    assert 'that is a lidar scan' in node.wait_for_line('pings dropped, wrong_type')
