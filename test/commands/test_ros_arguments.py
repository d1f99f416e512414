"""ROS's own arguments are not ours to judge."""

import pytest

from polymap_ros.commands.ros import without_ros_arguments


@pytest.mark.parametrize(('given', 'left'), [
    ([], []), (['a', '--rate', '2'], ['a', '--rate', '2']), (['a', '--ros-args', '-r', 'x:=y'], ['a']),
    (['--ros-args', '-r', 'x:=y', '--', 'a'], ['a']),
    (['a', '--ros-args', '--', 'b', '--ros-args', '-p', 'c'], ['a', 'b']),
])
def test_ros_arguments_are_taken_out(given, left):
    assert without_ros_arguments(given) == left
