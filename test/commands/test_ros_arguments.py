"""ROS's own arguments are not ours to judge."""

import pytest

from polymap_ros.commands import node, play
from polymap_ros.commands.ros import without_ros_arguments


@pytest.mark.parametrize(('given', 'left'), [
    ([], []), (['a', '--rate', '2'], ['a', '--rate', '2']), (['a', '--ros-args', '-r', 'x:=y'], ['a']),
    (['--ros-args', '-r', 'x:=y', '--', 'a'], ['a']),
    (['a', '--ros-args', '--', 'b', '--ros-args', '-p', 'c'], ['a', 'b']),
])
def test_ros_arguments_are_taken_out(given, left):
    assert without_ros_arguments(given) == left


@pytest.mark.parametrize(('main', 'given', 'says'), [
    (node.main, ['-p', 'solver.seed:=2'], '-p solver.seed:=2: '), (node.main, ['-r', 'odom:=/o'], '-r odom:=/o: '),
    (node.main, ['--params-file', 'a.yaml'], '--params-file a.yaml: '), (node.main, ['-p'], '-p: '),
    (play.main, ['drive', '-r', 'echo:=/sonar'], '-r echo:=/sonar: '),
])
def test_ros_arguments_without_ros_args_are_told_with_the_remedy(capsys, main, given, says):
    assert main(given) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert says in line
    assert "ROS's own arguments follow --ros-args, as in --ros-args -" in line
