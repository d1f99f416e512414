"""The node as its users meet it: signals, wrong input, parameters, services, time jumps, namespaces."""

import json
import signal
import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.parameter import Parameter

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.messages.outputs import echo_message, odometry_message, time_message
from polymap_ros.node.factory import make
from polymap_ros.results.arrays import read_state
from polymap_ros.simulation.scene_file import load_scene
from polymap_ros.simulation.waveforms import pings, simulate

ODOMETRY, SCAN = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/LaserScan'
POLYGON, TRIGGER, SET = 'geometry_msgs/msg/PolygonStamped', 'std_srvs/srv/Trigger', 'rcl_interfaces/srv/SetParameters'
RELIABLE = [part for topic in ('odom', 'echo')
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]
RELIABLE += ['-p', 'solver.method:=paper']
FAST = ['-p', 'solver.period_s:=0.2']
PERIOD_NS = 500_000_000


def test_no_odometry_is_lost_while_it_maps_and_solves(peer, start, riding):
    """200 Hz odometry and 10 Hz pings of 4,096 samples, reliable, the solver as busy as it can be."""
    start('--ros-args', *RELIABLE, '-p', 'solver.period_s:=0.05', '-p', 'solver.iterations:=2000')
    values, ride = peer.diagnostics(), riding()
    samples = np.concatenate([ride.samples, ride.samples], axis=1)
    begun_s, begun_ns, poses, pings = time.monotonic(), 10**9, 0, 0
    while poses < 600:
        stamp_ns = begun_ns + poses * 5_000_000
        ride.pose(stamp_ns, poses // 20)
        if poses % 20 == 0:
            ride.ping(stamp_ns, samples[pings])
            pings += 1
        poses += 1
        peer.executor.spin_once(timeout_sec=0.0)
        time.sleep(max(0.0, begun_s + poses * 0.005 - time.monotonic()))
    peer.until_used(values, pings)
    peer.spin_until(lambda: values()['odometry received'] == str(poses), 'all odometry')
    assert values()['odometry lost'] == values()['odometry refused'] == '0'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signal_ends_a_busy_node_with_status_0(peer, start, number, riding):
    node = start('--ros-args', *RELIABLE, *FAST)
    ride, polygons = riding(), peer.listen('/polymap_node/polygon', POLYGON)
    ride.publish(0, 30)
    peer.spin_until(lambda: polygons, 'a polygon')
    ride.publish(30, 60)
    assert node.stop(number) == 0
    assert not any('Traceback' in line for line in node.lines)


def test_signal_while_starting_ends_with_status_0(start):
    node = start('--ros-args', ready='parameters:')
    assert node.stop(signal.SIGTERM) == 0
    assert not any('Traceback' in line for line in node.lines)


def test_bad_pings_are_dropped_under_their_reason_and_counts_add_up(peer, start, riding):
    node = start('--ros-args', *RELIABLE)
    values, ride = peer.diagnostics(), riding()
    good = ride.samples[0]
    ride.publish(0, 3)
    peer.until_used(values, 3)
    stamp = 10 * 10**9
    ride.ping(stamp, good, ranges=make(SCAN, ranges=np.ones(4, np.float32)).ranges)
    ride.ping(stamp + 1, np.full(2048, np.nan))
    ride.ping(stamp + 2, np.zeros(2048))
    ride.ping(stamp + 3, good, time_increment=0.0)
    ride.ping(stamp + 4, good[:3])
    ride.ping(PERIOD_NS, good)
    ride.ping(0, good)
    ride.ping(10**12, good)
    names = {'wrong_type': 1, 'bad_samples': 2, 'bad_shape': 1, 'too_short': 1, 'duplicate': 1, 'no_pose': 1}
    peer.spin_until(lambda: values()['pings received'] == '11', 'all pings received')
    assert {name: int(values()[f'pings dropped: {name}']) for name in names} == names
    assert (values()['pings used'], values()['pings waiting']) == ('3', '1')
    assert values()['level'] in ('1', '2')  # a warning as long as others were used in the last five seconds
    assert 'lidar' in node.wait_for_line('wrong_type')


def test_silence_is_explained(peer, start):
    """Nobody on one topic; on the other best effort where reliable is asked for; then another type."""
    node = start('--ros-args', *RELIABLE, '-r', '__node:=deaf')
    values = peer.diagnostics('deaf')
    peer.node.create_publisher(type(odometry_message(make, 0, '', Pose(0.0, 0.0))), 'odom', best_effort())
    peer.node.create_publisher(type(make('sensor_msgs/msg/PointCloud2')), 'echo', 1)
    node.wait_for_line('incompatible QoS')
    peer.spin_until(lambda: values().get('level') == '2', 'an error')
    assert 'incompatible QoS on /odom' in values()['message']
    assert 'wrong type on /echo: published is sensor_msgs/msg/PointCloud2' in values()['message']
    assert values()['publishers with incompatible QoS'] == '1'
    node.wait_for_line('wrong type on /echo')


def best_effort():
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def test_parameters_change_live_or_are_refused(peer, start, riding):
    start('--ros-args', *RELIABLE, *FAST)
    values, ride = peer.diagnostics(), riding()
    polygons = peer.listen('/polymap_node/polygon', POLYGON)
    ride.publish(0, 60)
    peer.spin_until(lambda: values().get('method') == 'paper', 'an answer')

    def change(name, value):
        parameter = Parameter(name, value=value).to_parameter_msg()
        return peer.call('/polymap_node/set_parameters', SET, parameters=[parameter]).results[0]

    assert change('solver.method', 'rectangle').successful
    peer.spin_until(lambda: values()['method'] == 'rectangle', 'an answer of the other method')
    assert len(polygons[-1].polygon.points) == 4
    assert change('solver.period_s', 1).successful
    refused = change('grid.range_max_m', 2.0)
    assert not refused.successful
    assert 'read-only' in refused.reason
    refused = change('solver.max_edges', 2)
    assert not refused.successful
    refused = change('solver.method', 'magic')
    assert not refused.successful
    assert "'magic' is not known; allowed: " in refused.reason
    assert values()['method'] == 'rectangle'


def test_answer_that_no_longer_closes_is_withdrawn(peer, make_peer, start):
    """The four walls of a rectangle are more than three edges can close."""
    start('--ros-args', *RELIABLE[:-2], *FAST, '-p', 'slam.mode:=off')
    outputs = {'polygon': POLYGON, 'map': 'nav_msgs/msg/OccupancyGrid'}
    received = {name: peer.listen(f'/polymap_node/{name}', kind) for name, kind in outputs.items()}
    scene = load_scene('rectangle', None)
    odometry, echo = peer.publisher('/odom', ODOMETRY), peer.publisher('/echo', SCAN)
    for ping, pose in zip(pings(scene), scene.poses, strict=True):
        odometry.publish(odometry_message(make, ping.stamp_ns, 'odom', Pose(*pose)))
        echo.publish(echo_message(make, ping))
    values = peer.diagnostics()
    peer.until_used(values, len(scene.poses))
    peer.spin_until(lambda: values().get('status') == 'closed' and all(received.values()), 'a polygon and its map')
    change = Parameter('solver.max_edges', value=3).to_parameter_msg()
    assert peer.call('/polymap_node/set_parameters', SET, parameters=[change]).results[0].successful
    peer.spin_until(lambda: list(received['map'][-1].data) == [-1], 'the withdrawn map')
    assert list(received['polygon'][-1].polygon.points) == []
    peer.spin_until(lambda: values()['status'] != 'closed', 'the open answer')
    late = make_peer()
    latched = {name: late.listen(f'/polymap_node/{name}', kind) for name, kind in outputs.items()}
    late.spin_until(lambda: all(latched.values()), 'latched outputs', timeout_s=8.0)
    assert list(latched['polygon'][0].polygon.points) == []
    assert list(latched['map'][0].data) == [-1]


def test_clock_that_goes_back_a_little_keeps_the_map(peer, start, riding):
    node = start('--ros-args', *RELIABLE, '-p', 'use_sim_time:=true')
    values, ride = peer.diagnostics(), riding()
    clock = peer.publisher('/clock', 'rosgraph_msgs/msg/Clock')
    looks = peer.listen('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', 10)

    def tick(ns):
        def told():  # again and again, as /clock is volatile and the node may not have met its publisher yet
            clock.publish(make('rosgraph_msgs/msg/Clock', clock=time_message(make, ns)))
            return looks and looks[-1].header.stamp == time_message(make, ns)
        peer.spin_until(told, 'the time taken over')

    tick(10**10)
    ride.publish(0, 5)
    peer.until_used(values, 5)
    tick(10**10 - 10**6)
    tick(10**10 - 2 * 10**9)
    assert 'went back by 1.999 s' in node.wait_for_line('went back by')
    peer.until_used(values, 0)


def test_pause_counts_pings_and_lets_odometry_go_on(peer, start, riding):
    start('--ros-args', *RELIABLE)
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 5)
    peer.until_used(values, 5)
    pause = {'name': '/polymap_node/pause', 'type_name': 'std_srvs/srv/SetBool'}
    assert peer.call(**pause, data=True).success
    ride.publish(5, 8)
    peer.spin_until(lambda: values().get('pings dropped: paused') == '3', 'paused pings')
    assert values()['message'] == 'paused'
    assert peer.call(**pause, data=False).success
    ride.publish(8, 10)
    peer.until_used(values, 7)
    assert values()['odometry refused'] == '0'


@pytest.mark.parametrize(('action', 'left'), [('reset', 3), ('ignore', 10)])
def test_stamps_that_go_back_reset_the_map_or_are_ignored(peer, start, action, left, riding):
    node = start('--ros-args', *RELIABLE, '-p', f'odometry.on_jump_back:={action}')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 10)
    peer.until_used(values, 10)
    ride.ping_at(0)
    peer.spin_until(lambda: values()['pings received'] == '11', 'the first ping of the second round')
    ride.publish(1, 4)
    node.wait_for_line('odometry went back by')  # it is the second odometry that confirms
    received = 3 if action == 'reset' else 14
    peer.spin_until(lambda: values()['pings received'] == str(received), 'the second round')
    peer.until_used(values, left)


def test_looping_recording_resets_the_map_in_simulated_time(peer, start, tmp_path):
    """And without /clock the timers go on."""
    from polymap_ros.recordings.writing import RecordingWriter
    from polymap_ros.recordings.writing import make as make_recorded

    scene = load_scene('triangle', None)
    samples = simulate(scene)
    with RecordingWriter(tmp_path / 'loop.mcap') as writer:
        for k in range(20):
            stamp = (k + 1) * PERIOD_NS
            writer.write('/odom', odometry_message(make_recorded, stamp, 'odom', Pose(*scene.poses[k])), stamp)
            ping = Ping(stamp, samples[k].astype(np.float32), 1e-6)
            writer.write('/echo', echo_message(make_recorded, ping), stamp)
    node = start('--ros-args', *RELIABLE, *FAST, '-p', 'use_sim_time:=true')
    values = peer.diagnostics()
    peer.spin_until(values, 'diagnostics before the first /clock')
    polygons = peer.listen('/polymap_node/polygon', POLYGON)
    start(str(tmp_path / 'loop.mcap'), '--rate', '4', '--loop', '--wait', '20', command='play', ready='')
    node.wait_for_line('went back by')
    peer.spin_until(lambda: any(not each.polygon.points for each in polygons), 'the cleared polygon')
    count = len(polygons)
    peer.spin_until(lambda: len(polygons) > count and polygons[-1].polygon.points, 'a polygon of the second round')
    assert int(values()['pings received']) <= 21


def test_saved_map_is_continued_as_if_nothing_had_happened(peer, start, tmp_path, riding):
    """Save, stop, load, go on; against one uninterrupted run."""
    options = [*RELIABLE, '-p', f'output.dir:={tmp_path}']
    node = start('--ros-args', *options)
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 10)
    peer.until_used(values, 10)
    first = peer.call('/polymap_node/save', TRIGGER).message
    ride.publish(10, 20)
    peer.until_used(values, 20)
    whole = peer.call('/polymap_node/save', TRIGGER).message
    assert node.stop() == 0
    start('--ros-args', *options, '-p', f'output.load_path:={first}/state.npz')
    polygons = peer.listen('/polymap_node/polygon', POLYGON)
    peer.spin_until(lambda: polygons, 'the polygon of the loaded map')
    values, ride = peer.diagnostics(), riding()  # not what the first node said last
    ride.publish(10, 20)
    peer.until_used(values, 20)
    again = peer.call('/polymap_node/save', TRIGGER).message
    one, other = (read_state(tmp_path / folder / 'state.npz') for folder in (whole, again))
    assert one.keys() == other.keys()
    for name in one:
        assert np.array_equal(one[name], other[name]), name


@pytest.mark.parametrize(('action', 'line', 'used'), [
    ('reset', 'before the loaded map ends: the map is kept', 14), ('ignore', 'is dropped', 10)])
def test_saved_map_is_kept_where_the_stamps_begin_before_it(peer, start, tmp_path, riding, action, line, used):
    """A jump back while it runs is one as ever."""
    options = [*RELIABLE, '-p', f'output.dir:={tmp_path}', '-p', f'odometry.on_jump_back:={action}']
    node = start('--ros-args', *options)
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 10)
    peer.until_used(values, 10)
    saved = peer.call('/polymap_node/save', TRIGGER).message
    assert node.stop() == 0
    node = start('--ros-args', *options, '-p', f'output.load_path:={saved}/state.npz')
    ride = riding()
    ride.publish(0, 4)
    node.wait_for_line(line)
    peer.spin_until(lambda: values()['pings received'] == '14', 'the second round')
    peer.until_used(values, used)
    ride.ping_at(0)
    peer.spin_until(lambda: values()['pings received'] == '15', 'the first ping of the third round')
    ride.publish(1, 3)
    if action == 'reset':
        node.wait_for_line('the map is reset')
        peer.until_used(values, 2)  # but for the one before the second odometry, which confirms


@pytest.mark.parametrize('folder', ['file', 'loop'])
def test_save_that_fails_says_why_and_the_node_goes_on(peer, start, tmp_path, riding, folder):
    (tmp_path / 'file').write_text('in the way')
    (tmp_path / 'loop').symlink_to('loop')
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path}/{folder}')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 5)
    peer.until_used(values, 5)
    saved = peer.call('/polymap_node/save', TRIGGER)
    assert not saved.success
    assert saved.message.startswith('cannot save: ')
    assert any('nothing can be saved (output.dir): ' in line for line in node.lines)  # told at the start
    ride.publish(5, 8)
    peer.until_used(values, 8)
    assert 'cannot save: ' in node.wait_for_line('cannot save')
    assert node.stop() == 0
    assert not any('Traceback' in line for line in node.lines)


def test_autosave_keeps_the_newest_whole_map_and_saves_at_the_end(peer, start, tmp_path, riding):
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path}', '-p', 'output.autosave_s:=0.5')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 5)
    peer.spin_until(lambda: values().get('saved'), 'an automatic save')
    ride.publish(5, 8)
    peer.until_used(values, 8)
    assert node.stop(signal.SIGTERM) == 0
    folders = list(tmp_path.iterdir())
    assert [folder.name.partition('-')[0] for folder in folders] == [f'{8 * PERIOD_NS}']
    assert read_state(folders[0] / 'state.npz')['queue.counts'].tolist() == [8, 8]


def test_after_a_reset_the_new_map_is_saved_beside_the_old_one(peer, start, tmp_path, riding):
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path}', '-p', 'output.autosave_s:=0.2')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 8)
    peer.spin_until(lambda: values().get('status') and values().get('saved'), 'an answer and an automatic save')
    assert peer.call('/polymap_node/reset', TRIGGER).success
    ride.publish(10, 14)
    peer.until_used(values, 4)
    peer.spin_until(lambda: f'{14 * PERIOD_NS}-' in values()['saved'], 'a save of the new map')
    ride.publish(14, 16)
    peer.until_used(values, 6)
    assert node.stop(signal.SIGTERM) == 0
    counts = {int(folder.name.partition('-')[0]): read_state(folder)['queue.counts'].tolist()[0]
              for folder in tmp_path.iterdir()}
    assert counts == {8 * PERIOD_NS: 8, 16 * PERIOD_NS: 6}


def test_the_answer_that_comes_after_the_last_ping_is_saved_too(peer, start, tmp_path, riding):
    start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path}', '-p', 'output.autosave_s:=0.2')
    values, ride = peer.diagnostics(), riding()
    ride.publish(0, 8)
    peer.spin_until(lambda: values().get('status'), 'an answer')

    def saved():
        folders = [folder for folder in tmp_path.iterdir() if folder.name[0].isdigit()]
        return folders and json.loads((folders[0] / 'polygon.json').read_text())['stamp_ns'] > 0

    peer.spin_until(saved, 'a save of that answer')


def test_an_automatic_save_that_fails_is_tried_again(peer, start, tmp_path, riding):
    (tmp_path / 'place').write_text('in the way')
    node = start('--ros-args', *RELIABLE, '-p', f'output.dir:={tmp_path}/place', '-p', 'output.autosave_s:=0.2')
    values, ride = peer.diagnostics(), riding()
    peer.spin_until(lambda: 'nothing can be saved (output.dir): ' in values().get('message', ''), 'the problem at once')
    ride.publish(0, 5)
    node.wait_for_line('cannot save: ')
    (tmp_path / 'place').unlink()
    peer.spin_until(lambda: values().get('saved'), 'an automatic save')


def test_two_nodes_in_two_namespaces_do_not_disturb_each_other(peer, start, riding):
    for name in ('a', 'b'):
        qos = [option.replace('./', f'./{name}/') for option in RELIABLE]
        start('--ros-args', '-r', f'__ns:=/{name}', *qos)
    first, second = peer.diagnostics('a/polymap_node'), peer.diagnostics('b/polymap_node')
    ride_a, ride_b = riding('/a'), riding('/b')
    ride_a.publish(0, 4)
    ride_b.publish(0, 6)
    peer.until_used(first, 4)
    peer.until_used(second, 6)
    assert peer.call('/a/polymap_node/reset', TRIGGER).success
    peer.spin_until(lambda: first()['pings used'] == '0', 'the reset')
    assert second()['pings used'] == '6'
