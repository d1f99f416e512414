"""polymap_play feeds polymap_node over real DDS: what arrives, and that it is what the replay finds."""

import json
import signal
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

import shapely

from polymap_ros.commands import replay
from polymap_ros.commands.simulate import record
from polymap_ros.results.arrays import read_state
from polymap_ros.simulation.scene_file import load_scene

RELIABLE = [part for topic in ('odom', 'echo')
            for part in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]
OUTPUTS = {
    'polygon': 'geometry_msgs/msg/PolygonStamped', 'markers': 'visualization_msgs/msg/MarkerArray',
    'beam_map': 'sensor_msgs/msg/Image', 'map': 'nav_msgs/msg/OccupancyGrid',
}
TRIGGER = 'std_srvs/srv/Trigger'


def corners(polygon):
    return np.array([[point.x, point.y] for point in polygon.polygon.points])


def iou(a, b):
    a, b = shapely.Polygon(a), shapely.Polygon(b)
    return a.intersection(b).area / a.union(b).area


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """The triangular plate, 60 pings in 30 s."""
    path = tmp_path_factory.mktemp('live') / 'triangle'
    record(load_scene('triangle', None), path)
    return path


@pytest.fixture(scope='module')
def replayed(recording, tmp_path_factory):
    folder = tmp_path_factory.mktemp('replay')
    assert replay.main([str(recording), '--output', str(folder)]) == 0
    return folder


@pytest.fixture(scope='module')
def live(recording, replayed, tmp_path_factory, make_peer, starter):
    """One run: the node, the recording played at five times its speed, all outputs, a save."""
    saves = tmp_path_factory.mktemp('saves')
    node = starter('--ros-args', *RELIABLE, '-p', f'output.dir:={saves}')
    peer = make_peer()
    received = {name: peer.listen(f'/polymap_node/{name}', type_name) for name, type_name in OUTPUTS.items()}
    player = starter(str(recording), '--rate', '5', '--wait', '20', command='play', ready='')
    values = peer.diagnostics()
    peer.spin_until(lambda: values().get('pings used') == '60', 'all pings used')
    peer.spin_until(lambda: values().get('odometry received') == '245', 'all odometry')
    newest_ns = json.loads((replayed / 'polygon.json').read_text())['stamp_ns']
    peer.spin_until(lambda: stamp_ns(received['polygon'][-1:]) == newest_ns, 'the polygon of the last ping')
    peer.spin_until(lambda: stamp_ns(received['beam_map'][-1:]) == newest_ns, 'the map of the last ping')
    saved = peer.call('/polymap_node/save', TRIGGER)
    return SimpleNamespace(node=node, peer=peer, received=received, player=player, values=values(), saved=saved,
                           saves=saves)


def stamp_ns(messages):
    return messages[0].header.stamp.sec * 10**9 + messages[0].header.stamp.nanosec if messages else None


def test_polygon_is_the_plate(live, recording):
    truth = json.loads((recording / 'truth.json').read_text())['vertices']
    polygon = live.received['polygon'][-1]
    assert polygon.header.frame_id == 'odom'
    assert iou(corners(polygon), truth) > 0.95
    assert shapely.LinearRing(corners(polygon)).is_ccw
    assert all(len(each.polygon.points) >= 3 for each in live.received['polygon'])


def test_player_ends_in_peace(live):
    assert live.player.end() == 0


def test_node_and_replay_use_the_same_pings_and_find_the_same_map(live, replayed):
    assert live.saved.success
    ours, theirs = (read_state(folder / 'state.npz') for folder in (replayed, live.saves / live.saved.message))
    assert ours.keys() == theirs.keys()
    for name in ours:
        if not name.startswith('track.'):  # the odometry kept depends on nothing that matters here
            assert np.array_equal(ours[name], theirs[name]), name
    folders = replayed, live.saves / live.saved.message
    first, second = (json.loads((folder / 'polygon.json').read_text()) for folder in folders)
    assert first['pings'] == second['pings']
    assert first['stamp_ns'] == second['stamp_ns']


def test_beam_map_message_is_the_map_of_the_state(live):
    image = live.received['beam_map'][-1]
    state = read_state(live.saves / live.saved.message / 'state.npz')
    values = np.frombuffer(image.data, '<f4').reshape(image.height, image.width)
    assert image.header.frame_id == 'polymap_node/start'
    assert image.encoding == '32FC1'
    assert np.allclose(values, state['beam_map.total'] + state['beam_map.recent'], rtol=1e-6)


def test_occupancy_map_is_the_polygon(live):
    grid, polygon = live.received['map'][-1], shapely.Polygon(corners(live.received['polygon'][-1]))
    cells = np.array(grid.data).reshape(grid.info.height, grid.info.width)
    origin, step = grid.info.origin.position, grid.info.resolution
    rows, columns = np.nonzero(cells == 0)
    points = np.column_stack([origin.x + (columns + 0.5) * step, origin.y + (rows + 0.5) * step])
    assert step == pytest.approx(0.005)
    assert grid.header.frame_id == 'odom'
    assert shapely.contains_xy(polygon, points).all()
    assert len(points) * step**2 == pytest.approx(polygon.area, rel=0.05)
    assert set(np.unique(cells)) == {-1, 0, 100}


def test_markers_start_with_deleteall_and_have_no_stamp(live):
    markers = live.received['markers'][-1].markers
    assert markers[0].action == markers[0].DELETEALL
    assert [each.ns for each in markers[1:]] == ['outline', 'area', 'lines', 'free_area', 'path', 'text']
    assert all(each.header.stamp.sec == each.header.stamp.nanosec == 0 for each in markers)
    assert all(each.header.frame_id == 'odom' for each in markers)
    outline = np.array([[point.x, point.y] for point in markers[1].points])
    polygon = corners(live.received['polygon'][-1])
    assert np.allclose(outline, np.vstack([polygon, polygon[:1]]), atol=1e-6)
    assert len(markers[5].points) == 60
    assert markers[6].text.startswith('closed: ')


def test_save_answers_with_a_new_absolute_folder_each_time(live):
    again = live.peer.call('/polymap_node/save', TRIGGER)
    first, second = (live.saves / each.message for each in (live.saved, again))
    assert again.message.startswith('/')
    newest_ns = stamp_ns(live.received['polygon'][-1:])
    assert (first.name, second.name) == (f'{newest_ns}-1', f'{newest_ns}-2')
    for folder in (first, second):
        names = {path.name for path in folder.iterdir()}
        assert names == {'polygon.json', 'state.npz', 'trajectory.tum', 'map.pgm', 'map.yaml'}
    assert {path.name for path in live.saves.iterdir()} == {first.name, second.name}


def test_diagnostics_add_up(live):
    assert live.values['pings received'] == live.values['pings used'] == '60'
    assert live.values['odometry lost'] == live.values['pings waiting'] == '0'
    assert live.values['status'] == 'closed'


def test_late_joiner_gets_everything_at_once(live, make_peer):
    late = make_peer()
    received = {name: late.listen(f'/polymap_node/{name}', type_name) for name, type_name in OUTPUTS.items()}
    late.spin_until(lambda: all(received.values()), 'latched outputs', timeout_s=8.0)
    assert received['polygon'][0] == live.received['polygon'][-1]


def test_reset_clears_what_is_latched(live, make_peer):
    live.peer.call('/polymap_node/reset', TRIGGER)
    late = make_peer()
    received = {name: late.listen(f'/polymap_node/{name}', type_name) for name, type_name in OUTPUTS.items()}
    late.spin_until(lambda: all(received.values()), 'latched outputs')
    assert list(received['polygon'][0].polygon.points) == []
    assert [each.action for each in received['markers'][0].markers] == [3]
    assert list(received['map'][0].data) == [-1]
    assert not any(received['beam_map'][0].data)
    assert all(each[0].header.frame_id == 'odom' for name, each in received.items() if name in ('polygon', 'map'))


def test_node_maps_again_after_a_reset_and_ends_with_status_0(live, recording, starter):
    count = len(live.received['polygon'])
    starter(str(recording), '--rate', '10', '--wait', '20', command='play', ready='')
    live.peer.spin_until(lambda: any(len(each.polygon.points) >= 3 for each in live.received['polygon'][count:]),
                         'a polygon after the reset')  # repeats of the cleared one may come first
    assert live.node.stop(signal.SIGINT) == 0
