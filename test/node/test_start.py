"""Starting: parameter files that are for others, and what cannot work, which is one line and status 2."""

from pathlib import Path

import pytest

pytest.importorskip('rclpy')

TEXT = str(Path(__file__).with_name('text.yaml'))
TRIANGLE = str(Path(__file__).parents[2] / 'bags' / 'triangle')


def test_names_for_other_nodes_are_left_alone(start, tmp_path):
    file = tmp_path / 'all.yaml'
    file.write_text('/**: {ros__parameters: {map: {file: foo.yaml}, solver: {max_edges: 7, methode: paper}}}\n'
                    'other_node: {ros__parameters: {map: {folder: bar}}}\n')
    node = start('--ros-args', '--params-file', str(file))
    assert any('solver.max_edges: 7' in line for line in node.lines)
    told = [line for line in node.lines if 'WARN' in line and 'is left alone' in line]
    assert [line.partition('; ')[2] for line in told] == ['its group, map, is one of ours',
                                                          'did you mean solver.method?']


@pytest.mark.parametrize(('rule', 'key', 'warned'), [
    ('__ns:=/a', 'polymap_node', True), ('__node:=mapper', 'polymap_node', True),
    ('__ns:=/a', '/a/polymap_node', False), ('__ns:=/a', '/**/polymap_node', False),
    ('__ns:=/a', '/*/polymap_node', False), ('__ns:=/a', '/**', False)])
def test_a_parameter_file_that_is_for_another_node_is_told(start, tmp_path, rule, key, warned):
    file = tmp_path / 'mine.yaml'
    file.write_text(f'{key}: {{ros__parameters: {{solver: {{max_edges: 7}}}}}}\n')
    node = start('--ros-args', '-r', rule, '--params-file', str(file))
    told = any('nothing in it is for this node' in line for line in node.lines)
    applied = any('solver.max_edges: 7' in line for line in node.lines)
    assert (told, applied) == (warned, not warned)


@pytest.mark.parametrize(('arguments', 'says'), [
    (['-p', 'solver.methd:=paper'], 'parameter solver.methd: unknown; did you mean solver.method?'),
    (['--params-file', 'nowhere.yaml'], 'nowhere.yaml'),
    (['-p', 'output.load_path:=nowhere.npz'], 'nowhere.npz: cannot be read'),
    (['-p', 'qos_overrides./odom.subscription.reliability:=maybe'], 'qos_overrides./odom.subscription.*: '),
    (['-p', 'qos_overrides./odom.subscription.depth:=few'], 'qos_overrides./odom.subscription.*: '),
    (['--params-file', TEXT], f'{TEXT}: is not a ROS parameter file'),
    (['-r', 'odom'], "remap rule: '-r odom'"),
    (['--odom'], "unknown ROS arguments: ['--odom']"),
])
def test_start_that_cannot_work_is_one_line_and_status_2(start, arguments, says):
    node = start('--ros-args', *arguments, '--log-level', 'warn', ready='')
    assert node.end() == 2
    assert says in node.lines[-1]
    assert len(node.lines) == 1


@pytest.mark.parametrize(('remaps', 'says'), [
    (['odom:=x', 'echo:=x'], 'odom and echo are both remapped to /x'), (['odom:=/diagnostics'], 'type'),
    (['~/polygon:=/odom'], '/odom cannot be subscribed to as nav_msgs/msg/Odometry'),
])
def test_a_topic_of_two_types_is_told(start, remaps, says):
    node = start('--ros-args', *(part for remap in remaps for part in ('-r', remap)), ready='')
    assert node.end() == 2
    assert node.lines[-1].startswith('polymap_node: error: ')
    assert says in node.lines[-1]
    assert not any('Traceback' in line for line in node.lines)


def test_a_parameter_file_that_is_no_text_is_told(start, tmp_path):
    (tmp_path / 'wide.yaml').write_bytes('polymap_node:\n'.encode('utf-16'))
    node = start('--ros-args', '--params-file', str(tmp_path / 'wide.yaml'), ready='')
    assert node.end() == 2
    assert 'wide.yaml' in node.lines[-1]
    assert not any('Traceback' in line for line in node.lines)


@pytest.mark.parametrize('command', [['node'], ['play', TRIANGLE]])
@pytest.mark.parametrize('folders', [[], ['enclaves', 'public', 'private']])
def test_where_dds_security_is_asked_for_and_cannot_be_had_it_is_told(start, tmp_path, monkeypatch, command, folders):
    """No node joins in the open, then."""
    for folder in folders:
        (tmp_path / folder).mkdir()
    for name, value in {'ENABLE': 'true', 'STRATEGY': 'Enforce', 'KEYSTORE': str(tmp_path)}.items():
        monkeypatch.setenv(f'ROS_SECURITY_{name}', value)
    process = start(*command[1:], command=command[0], ready='')
    assert process.end() == 2
    assert 'security' in process.lines[-1].lower()
    assert not any('Traceback' in line for line in process.lines)


def test_wrong_option_is_one_line_and_status_2(start):
    node = start('--parameters', 'x', ready='')
    assert node.end() == 2
    assert len(node.lines) == 1


def test_a_folder_for_the_log_that_cannot_be_is_told_with_the_remedy(start, monkeypatch):
    monkeypatch.setenv('ROS_LOG_DIR', '/dev/null/log')
    node = start('--ros-args', ready='')
    assert node.end() == 2
    assert 'set ROS_LOG_DIR to a folder that can be written' in node.lines[-1]
