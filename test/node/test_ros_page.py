"""The tables of topics and services in doc/ros.md are what a running node offers."""

import re
from pathlib import Path

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from polymap_ros.echo_parameters import A_SCAN_TYPES

PAGE = (Path(__file__).parents[2] / 'doc' / 'ros.md').read_text(encoding='utf-8')
ROS_OWN = ('/rosout', '/parameter_events')


def table(heading):
    """{name: type} of the tables below a heading whose rows begin with a word in backquotes."""
    rows = re.findall(r'^\| `(\S+)` \| (.+?) \|', PAGE.split(heading)[1].split('\n## ')[0], re.MULTILINE)
    return {name.replace('~', '/polymap_node'): kind.strip('`') for name, kind in rows}


def offered(pairs):
    return {name: types[0] for name, types in pairs if name not in ROS_OWN and 'parameter' not in name}


def test_outputs_inputs_and_services(start, peer):
    start()
    node = ('polymap_node', '/')
    topics, services = table('## Outputs'), table('## Services')

    def complete():
        names = peer.node.get_node_names_and_namespaces()
        return node in names and offered(peer.node.get_service_names_and_types_by_node(*node)).keys() >= services.keys()

    peer.spin_until(complete, 'the node is not seen whole')
    peer.spin_until(lambda: len(peer.node.get_publishers_info_by_topic('/polymap_node/map')) == 1, 'no map')
    assert offered(peer.node.get_publisher_names_and_types_by_node(*node)) == topics
    services_offered = offered(peer.node.get_service_names_and_types_by_node(*node))
    assert {name: kind for name, kind in services_offered.items() if 'type_description' not in name} == services
    listened = offered(peer.node.get_subscriber_names_and_types_by_node(*node))
    assert listened == {'/odom': 'nav_msgs/msg/Odometry', '/echo': 'sensor_msgs/msg/LaserScan'}
    inputs = table('## Inputs')
    assert inputs['odom'] == listened['/odom']
    assert {name for name in inputs if '/msg/' in name} == set(A_SCAN_TYPES)
    for name in set(topics) - {'/diagnostics', '/polymap_node/pose'}:
        [info] = peer.node.get_publishers_info_by_topic(name)
        assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    for name in listened:
        [info] = peer.node.get_subscriptions_info_by_topic(name)
        assert info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
