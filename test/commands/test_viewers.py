"""polymap.rviz and polymap.foxglove.json: their topics are those that result.mcap holds, as what they take them for.

The programs themselves cannot run here. That the node publishes the same topics is in test/node/test_ros_page.py.
"""

import importlib
import json
from pathlib import Path

import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability

import polymap_ros

CONFIG = Path(polymap_ros.__file__).parent / 'config'
TAKES = {
    'rviz_default_plugins/Map': 'nav_msgs/msg/OccupancyGrid',
    'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'rviz_default_plugins/Polygon': 'geometry_msgs/msg/PolygonStamped',
    'rviz_default_plugins/Odometry': 'nav_msgs/msg/Odometry',
    'rviz_default_plugins/Image': 'sensor_msgs/msg/Image',
    'rviz_default_plugins/Path': 'nav_msgs/msg/Path',
    'rviz_default_plugins/PoseWithCovariance': 'geometry_msgs/msg/PoseWithCovarianceStamped',
}
DRAWN_IN_3D = {'nav_msgs/msg/OccupancyGrid', 'visualization_msgs/msg/MarkerArray', 'geometry_msgs/msg/PolygonStamped',
               'nav_msgs/msg/Odometry', 'nav_msgs/msg/Path', 'geometry_msgs/msg/PoseWithCovarianceStamped'}


@pytest.fixture(scope='module')
def recorded(triangle, tmp_path_factory):
    """Types and QoS by topic of result.mcap, the markers' namespaces, and the frames of what is drawn in space."""
    folder = tmp_path_factory.mktemp('viewers') / 'out'
    main = importlib.import_module('polymap_ros.commands.replay').main
    assert main([str(triangle), '--output', str(folder), '--record', '-p', 'solver.method:=paper',
                 '-p', 'solver.iterations:=60']) == 0
    with AnyReader([folder / 'result.mcap']) as reader:
        connections = {each.topic: each for each in reader.connections}
        messages = {each.topic: reader.deserialize(raw, each.msgtype) for each, _, raw in reader.messages()}
    return connections, messages


@pytest.fixture(scope='module')
def rviz():
    return yaml.safe_load((CONFIG / 'polymap.rviz').read_text(encoding='utf-8'))['Visualization Manager']


@pytest.fixture(scope='module')
def layout():
    return json.loads((CONFIG / 'polymap.foxglove.json').read_text(encoding='utf-8'))


def displays(rviz):
    return {entry['Topic']['Value']: entry for entry in rviz['Displays'] if 'Topic' in entry}


def test_rviz_shows_every_topic_as_what_it_is(rviz, recorded):
    connections, _ = recorded
    assert {topic: TAKES[entry['Class']] for topic, entry in displays(rviz).items()} == {
        topic: connection.msgtype for topic, connection in connections.items() if topic != '/diagnostics'}


def test_rviz_gets_what_is_latched_and_loses_no_odometry(rviz, recorded):
    connections, _ = recorded
    for topic, entry in displays(rviz).items():
        [offered] = connections[topic].ext.offered_qos_profiles
        latched = offered.durability == QosDurability.TRANSIENT_LOCAL
        assert latched == (topic not in ('/odom', '/polymap_node/pose'))
        assert entry['Topic']['Durability Policy'] == ('Transient Local' if latched else 'Volatile')
        assert offered.reliability == QosReliability.RELIABLE
        # Odometry may be best effort on a robot, which a reliable subscriber would not get.
        assert entry['Topic']['Reliability Policy'] == ('Reliable' if latched else 'Best Effort')
        assert entry['Topic']['History Policy'] == 'Keep Last'


def test_everything_in_space_is_in_the_fixed_frame(rviz, layout, recorded):
    """So both programs can draw it without tf, which a recording of the answer does not hold."""
    connections, messages = recorded
    frames = {messages[topic].header.frame_id for topic in connections
              if connections[topic].msgtype in DRAWN_IN_3D - {'visualization_msgs/msg/MarkerArray'}}
    frames |= {marker.header.frame_id for marker in messages['/polymap_node/markers'].markers}
    assert frames == {rviz['Global Options']['Fixed Frame']} == {layout['configById']['3D!polymap1']['followTf']}


def test_rviz_knows_the_markers_namespaces(rviz, recorded):
    _, messages = recorded
    drawn = {marker.ns for marker in messages['/polymap_node/markers'].markers if marker.action == 0}
    known = displays(rviz)['/polymap_node/markers']['Namespaces']
    assert drawn | {'holes', 'inner_walls'} == known.keys()
    assert all(known.values())


def test_foxglove_panels_are_all_placed(layout):
    def leaves(tree):
        return [tree] if isinstance(tree, str) else leaves(tree['first']) + leaves(tree['second'])

    assert sorted(leaves(layout['layout'])) == sorted(layout['configById'])


def test_foxglove_shows_every_topic_as_what_it_is(layout, recorded):
    connections, _ = recorded
    room, image, diagnostics = (layout['configById'][name] for name in (
        '3D!polymap1', 'Image!polymap2', 'DiagnosticSummary!polymap3'))
    assert {connections[topic].msgtype for topic in room['topics']} == DRAWN_IN_3D
    assert connections[image['imageMode']['imageTopic']].msgtype == 'sensor_msgs/msg/Image'
    assert connections[diagnostics['topicToRender']].msgtype == 'diagnostic_msgs/msg/DiagnosticArray'
    assert {*room['topics'], image['imageMode']['imageTopic'], diagnostics['topicToRender']} == {*connections}
