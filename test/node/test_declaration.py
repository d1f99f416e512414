"""ROS parameters from the one source: types, descriptors, refusals, live changes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from polymap_ros.errors import ParameterError
from polymap_ros.node.declaration import LiveParameters, declare
from polymap_ros.parameters import Parameters, specifications


@pytest.fixture
def declared() -> Iterator[Any]:
    """Declares parameters on a real node given the arguments of a command line."""
    context = rclpy.Context()
    rclpy.init(context=context, args=[])
    nodes = []

    def run(*arguments: str) -> tuple[Node, Parameters]:
        command_line = ['--ros-args', *arguments]
        nodes.append(Node('polymap_node', context=context, cli_args=command_line,
                          automatically_declare_parameters_from_overrides=True))
        return nodes[-1], declare(nodes[-1], command_line)

    yield run
    for node in nodes:
        node.destroy_node()
    context.try_shutdown()


def test_every_parameter_is_declared_with_its_default_and_descriptor(declared):
    node, parameters = declared()
    assert parameters == Parameters()
    for spec in specifications():
        descriptor = node.describe_parameter(spec.name)
        value = node.get_parameter(spec.name).value
        assert (type(value), value) == (spec.type, spec.default)
        assert spec.text in descriptor.description
        assert spec.unit in descriptor.description
        assert descriptor.additional_constraints == spec.allowed()
        assert descriptor.read_only is not spec.live
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        if spec.maximum is not None:
            assert ranges[0].to_value == spec.maximum
        if spec.minimum is not None:
            assert ranges[0].from_value == spec.minimum


def test_int_is_taken_for_a_double_from_the_command_line_and_from_yaml(declared, tmp_path):
    path = tmp_path / 'p.yaml'
    path.write_text('polymap_node:\n  ros__parameters:\n    grid: {range_max_m: 2}\n')
    node, parameters = declared('--params-file', str(path), '-p', 'solver.period_s:=2')
    assert (parameters.grid.range_max_m, parameters.solver.period_s) == (2.0, 2.0)
    assert node.get_parameter('grid.range_max_m').type_ == Parameter.Type.DOUBLE


@pytest.mark.parametrize(('override', 'says'), [
    ('solver.methd:=paper', 'did you mean solver.method'),
    ('solver.max_edges:=2', r'solver.max_edges: 2 is out of range; allowed: integer in \[3, 64\]'),
    ('solver.max_edges:=4.0', 'of type float'), ('echo.kind:=loud', 'rf | envelope'),
    ('echo.allow_unstamped:=1', 'of type int'), ('medium.thickness_m:=0.0', r'\[1e-05, 1\] m'),
    ('grid.range_step_m:=[0.1, 0.2]', 'grid.range_step_m'), ('medium.thickness_m:=.nan', 'medium.thickness_m'),
])
def test_wrong_parameter_is_refused_with_what_is_allowed(declared, override, says):
    with pytest.raises(ParameterError, match=says):
        declared('-p', override)


FILE = """
/**:
  ros__parameters:
    {shared}: 1.0
    robot_radius: 0.2
polymap_node:
  ros__parameters:
    {own}: 0.5
"""


def test_unknown_name_for_all_nodes_is_left_alone(declared, tmp_path):
    path = tmp_path / 'p.yaml'
    path.write_text(FILE.format(shared='map.topic_rate', own='solver.period_s'))
    node, parameters = declared('--params-file', str(path))
    assert parameters.solver.period_s == 0.5
    assert not node.has_parameter('map.topic_rate')


def test_unknown_name_for_this_node_is_refused(declared, tmp_path):
    path = tmp_path / 'p.yaml'
    path.write_text(FILE.format(shared='solver.period_s', own='map.topic_rate'))
    with pytest.raises(ParameterError, match=r'map\.topic_rate: unknown'):
        declared('--params-file', str(path))


def test_file_of_a_namespaced_node_is_taken(declared, tmp_path):
    path = tmp_path / 'p.yaml'
    path.write_text('robot:\n  polymap_node:\n    ros__parameters:\n      solver: {seed: 7}\n')
    _, parameters = declared('-r', '__ns:=/robot', '--params-file', str(path))
    assert parameters.solver.seed == 7


def test_pulse_is_relative_to_its_file(declared, tmp_path):
    path = tmp_path / 'p.yaml'
    path.write_text('/**:\n  ros__parameters:\n    pulse: {kind: file, path: burst.npy}\n')
    _, parameters = declared('--params-file', str(path))
    assert parameters.folder == tmp_path
    assert declared()[1].folder == Path()


class Live:
    def __init__(self, node, parameters):
        self.applied = []
        self.node = node
        self.live = LiveParameters(node, parameters, self.applied.append)

    def set(self, name, value):
        return self.node.set_parameters([Parameter(name, value=value)])[0]


def test_live_change_is_validated_then_applied(declared):
    live = Live(*declared())
    assert live.set('solver.period_s', 0.25).successful
    assert live.applied[-1].solver.period_s == 0.25
    assert live.live.current is live.applied[-1]


def test_live_int_is_taken_for_a_double(declared):
    live = Live(*declared())
    assert live.set('solver.period_s', 3).successful
    assert live.node.get_parameter('solver.period_s').value == 3.0
    assert live.applied[-1].solver.period_s == 3.0


@pytest.mark.parametrize(('name', 'value', 'says'), [
    ('solver.max_edges', 100, 'range'), ('solver.period_s', 0.0, 'solver.period_s out of range Min: 0.001'),
    ('solver.method', 'magic', 'allowed: '), ('grid.range_max_m', 2.0, 'read-only'), ('solver.seed', 'x', 'type'),
    ('solver.seed', 1.0, 'type'),
])
def test_wrong_live_change_is_refused_with_the_reason(declared, name, value, says):
    live = Live(*declared())
    before = live.node.get_parameter(name).value
    result = live.set(name, value)
    assert not result.successful
    assert says in result.reason
    assert live.node.get_parameter(name).value == before
    assert live.applied == []


def test_parameters_of_ros_are_left_to_ros(declared):
    node, _ = declared('-p', 'use_sim_time:=true')
    assert node.get_parameter('use_sim_time').value is True
