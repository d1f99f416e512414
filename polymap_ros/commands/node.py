"""polymap_node: the live mapping node."""

import signal
import sys
from collections.abc import Sequence

from polymap_ros.commands import console
from polymap_ros.commands.ros import refuse_ros_arguments, require_ros, without_ros_arguments

PROGRAM = 'polymap_node'
ROS_OPTIONS = ('-p', '--param', '-r', '--remap', '--params-file', '--log-level', '-e', '--enclave')
EXAMPLES = (
    'polymap_node',
    'polymap_node --ros-args -r odom:=/robot/odom -r echo:=/sonar/echo',
    'polymap_node --ros-args --params-file polymap.yaml -p echo.type:=sensor_msgs/msg/Image -r echo:=/sonar/raw')


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status, 0 after Ctrl-C, SIGTERM, or a terminal that closes."""
    console.one_core()  # a second thread of the linear algebra makes no solve faster, and the messages wait for it
    command_line = list(sys.argv[1:] if arguments is None else arguments)
    parser = console.Parser(
        PROGRAM, 'Map the polygon around a robot from echoes and odometry, live.',
        "Parameters, remaps and the like are ROS's own and follow --ros-args. Exit status: 0 after Ctrl-C or SIGTERM; "
        '2 wrong usage or parameter, the reason is on stderr.', EXAMPLES)
    ours = without_ros_arguments(command_line)
    if status := console.attempt(PROGRAM, lambda: refuse_ros_arguments(ours, ROS_OPTIONS)):
        return status
    parser.parse_args(ours)
    return console.attempt(PROGRAM, lambda: _run(command_line))


def _run(command_line: list[str]) -> int:
    require_ros()
    for number in (signal.SIGTERM, signal.SIGHUP):  # until the node spins
        if signal.getsignal(number) is signal.SIG_DFL:  # as SIGHUP is not under nohup
            signal.signal(number, signal.default_int_handler)
    try:
        from polymap_ros.node.running import run

        run(command_line)
    except KeyboardInterrupt:
        console.complain(PROGRAM, 'interrupted while starting')
    return console.DONE


if __name__ == '__main__':
    sys.exit(main())
