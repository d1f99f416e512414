"""A misspelt parameter is told, wherever it is left alone."""

import pytest

from polymap_ros.commands import replay
from polymap_ros.names import stray
from polymap_ros.parameter_file import load_parameters
from polymap_ros.parameters import Parameters, specifications

KNOWN = [spec.name for spec in specifications()]


@pytest.mark.parametrize(('name', 'says'), [
    ('solver.methode', 'solver.methode is no parameter of polymap_ros and is left alone; did you mean solver.method?'),
    ('sensor.frame_name', 'its group, sensor, is one of ours'),
    ('solvr.method', 'did you mean solver.method?'), ('method', 'did you mean solver.method?'),
    ('range_max_m', 'did you mean grid.range_max_m?'),
])
def test_a_name_that_may_have_been_meant_for_us(name, says):
    assert stray(name, KNOWN).endswith(says)


@pytest.mark.parametrize('name', ['solver.method', 'use_sim_time', 'qos_overrides./odom.subscription.depth',
                                  'start_type_description_service', 'robot.name', 'controller.max_speed', 'frame_id'])
def test_other_nodes_names_are_left_alone(name):
    assert stray(name, KNOWN) == ''


def test_the_tools_warn_of_each_once_and_go_on(tmp_path, capsys):
    path = tmp_path / 'p.yaml'
    path.write_text('/**:\n  ros__parameters: {solver: {methode: paper, seed: 2}, robot: {name: a}, use_sim_time: y}\n'
                    'polymap_node:\n  ros__parameters: {solvr: {seed: 3}}')
    told = []
    assert load_parameters(path, warn=told.append) == Parameters().replaced({'solver.seed': 2})
    assert told == [
        f'parameter file {path}: below /**: {stray("solver.methode", KNOWN)}',
        f'parameter file {path}: below polymap_node: {stray("solvr.seed", KNOWN)}']
    assert replay.main([str(tmp_path / 'missing'), '--params-file', str(path)]) == 2
    assert capsys.readouterr().err.splitlines()[:2] == [f'polymap_replay: warning: {text}' for text in told]
